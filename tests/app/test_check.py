import copy
import itertools
import json
import subprocess
import sys
from pathlib import Path

import pytest

import armguard
from armguard.app import check as command
from armguard.app.cli import main
from armguard.messages.proof import Proof
from armguard.recording.reading import Recording
from support.panda_monitor import HOME, STILL, panda

PERIOD = 1e-3


def record(path, *, ticks=400, **options):
    """A ball that comes near a Panda at rest."""
    obstacles = armguard.Obstacles(sources=["camera"], accel=10.0, speed=1.6)
    monitor = armguard.Monitor(panda(), obstacles, rise_delay=0.0, rate=1.0 / PERIOD)
    with armguard.Recorder(path, monitor, **options):
        for tick in range(ticks):
            if tick % 10 == 0:
                place = [[1.6 - 0.4 * PERIOD * tick, 0.0, 0.5]]
                obstacles.update(
                    ["ball"], tick * PERIOD, place, [[-0.4, 0.0, 0.0]], source="camera", radius=0.1
                )
            monitor.step(tick * PERIOD, HOME, STILL)
    return path


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return record(tmp_path_factory.mktemp("proved") / "run.mcap")


def run(words, **options):
    return subprocess.run(
        [*map(str, words)], capture_output=True, text=True, check=False, **options
    )


def read_proofs(path):
    return [event for _, event, _ in Recording(path).events() if isinstance(event, Proof)]


def test_all_proofs_of_a_recording_are_verified(recording, capsys):
    proofs = read_proofs(recording)
    # Ten a second of a little less than 0.4 s.
    assert len(proofs) in (3, 4)
    assert main(["check", str(recording)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == f"{len(proofs)} proofs, {len(proofs)} verified"
    count = str(len(proofs))
    assert [line.split()[0] for line in lines[1:5]] == [count, count, count, "0"]
    assert lines[-1] == f"trusted: arm {proofs[0].arm.digest}, {len(proofs)} proofs"


def test_the_interval_is_a_setting(tmp_path):
    stamps = [one.now for one in read_proofs(record(tmp_path / "a.mcap", proof_interval=0.02))]
    steps = [b - a for a, b in itertools.pairwise(stamps)]
    assert len(stamps) > 10
    assert min(steps) > 0.02 - 1e-9
    assert max(steps) < 0.02 + 2 * PERIOD
    assert not read_proofs(record(tmp_path / "b.mcap", ticks=200, proof_interval=float("inf")))
    with pytest.raises(armguard.ArmguardError, match="proof_interval"):
        record(tmp_path / "c.mcap", proof_interval=-1.0)


def test_the_first_that_does_not_hold_is_named(recording, monkeypatch, capsys):
    events = list(Recording(recording).events())
    proofs = [one for one in events if isinstance(one.event, Proof)]
    spoiled = json.loads(proofs[1].data)
    spoiled["motions"][-1]["high"][40] -= 0.1
    changed = [
        one._replace(data=json.dumps(spoiled).encode()) if one is proofs[1] else one
        for one in events
    ]
    monkeypatch.setattr(command.Recording, "events", lambda self: iter(changed))
    assert main(["check", str(recording)]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == f"{len(proofs)} proofs, {len(proofs) - 1} verified"
    assert f"tick {spoiled['sequence']} at" in lines[-1]
    assert "can leave the tube" in lines[-1]
    assert main(["check", "--json", str(recording)]) == 1
    found = json.loads(capsys.readouterr().out)
    assert found["first_refused"]["proof"] == 2


def test_a_proof_of_something_else_is_no_verification(recording, monkeypatch, capsys):
    events = list(Recording(recording).events())
    place = next(k for k, one in enumerate(events) if isinstance(one.event, Proof))
    event = copy.deepcopy(events[place].event)
    event.obstacle = "another"
    events[place] = events[place]._replace(event=event, data=event.to_json())
    monkeypatch.setattr(command.Recording, "events", lambda self: iter(events))
    assert main(["check", str(recording)]) == 1
    lines = capsys.readouterr().out.splitlines()
    count = sum(isinstance(one.event, Proof) for one in events)
    assert lines[0] == f"{count} proofs, {count} verified"
    assert lines[1].startswith(f"{count - 1} agree")
    assert lines[-1].startswith(f"first proof that does not agree: tick {event.sequence} at")
    assert lines[-1].endswith("obstacle is another, that of the verdict is ball")
    assert main(["check", "--json", str(recording)]) == 1
    found = json.loads(capsys.readouterr().out)
    assert (found["verified"], found["agreeing"]) == (count, count - 1)
    assert found["first_disagreeing"]["obstacle"] == "another"


def test_a_recording_without_proofs_shows_nothing(recording, monkeypatch):
    monkeypatch.setattr(command.Recording, "events", lambda self: iter(()))
    assert main(["check", str(recording)]) == 1


def test_mistakes_at_the_command_line(tmp_path, capsys):
    nothing = tmp_path / "nothing.mcap"
    assert main(["check", str(nothing)]) == 2
    assert "cannot be read" in capsys.readouterr().err
    nothing.write_bytes(b"text")
    assert main(["check", str(nothing)]) == 2


def test_a_damaged_recording_is_one_line(recording, tmp_path):
    damaged, data = tmp_path / "damaged.mcap", bytearray(recording.read_bytes())
    data[-len(data) // 3] ^= 1
    damaged.write_bytes(data)
    found = run([sys.executable, "-m", "armguard", "check", damaged])
    assert (found.returncode, found.stdout) == (2, "")
    assert len(found.stderr.splitlines()) == 1
    assert "is damaged" in found.stderr


def test_nothing_of_the_working_directory_takes_the_place_of_the_checker(recording, tmp_path):
    """Who checks in a folder that they were sent runs nothing that lies there."""
    forged = tmp_path / "armguard_check"
    forged.mkdir()
    for path in (forged / "__init__.py", forged / "__main__.py", tmp_path / "hashlib.py"):
        path.write_text("raise SystemExit('forged')")
    main_program = str(Path(sys.executable).with_name("armguard"))
    found = run([main_program, "check", recording], cwd=tmp_path)
    assert found.returncode == 0, found.stderr
    assert "forged" not in found.stdout + found.stderr


def test_a_checker_that_ends_early_is_no_verification(recording, monkeypatch, capsys):
    monkeypatch.setattr(command.sys, "executable", "/bin/false")
    assert main(["check", str(recording)]) == 2
    assert "armguard_check" in capsys.readouterr().err


def test_lines_are_those_that_the_library_writes(recording):
    events = [one for one in Recording(recording).events() if isinstance(one.event, Proof)]
    assert all(json.loads(one.event.to_json()) == json.loads(one.data) for one in events)
