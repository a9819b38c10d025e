"""`armguard commission` from a recording to lines that the parsers take."""

import itertools
import re

import numpy as np
import pytest

from armguard import Monitor, Obstacles, Recorder, Robot
from armguard.app.cell import Cell
from armguard.app.cli import main
from armguard.lab.commission.command import CELL_FILE, ROBOT_FILE
from armguard.lab.commission.findings import commission
from armguard.lab.commission.observations import observe
from armguard.recording import Recording
from armguard.recording.replay import Replay
from armguard.robot.description import read_description
from armguard.verdict import ReasonKind
from support import commissioned_runs
from support.cell_texts import ROBOT


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    path = tmp_path_factory.mktemp("commission") / "run.mcap"
    return path, *commissioned_runs.record(path)


def test_a_recording_shows_the_arm_as_it_is(recorded):
    path, told, arm = recorded
    found = commission(observe(Recording(path)))
    assert [stop.told for stop in found.seen.stops] == pytest.approx(told)
    assert arm.latency <= found.response <= 1.1 * arm.latency
    names = found.seen.robot.joints
    assert set(found.brakes) == {name for name in names if name != names[4]}
    for name, (entry,) in found.brakes.items():
        joint = names.index(name)
        time = arm.velocity[joint] / arm.braking[joint]
        assert 0.95 * arm.velocity[joint] <= entry.speed <= arm.velocity[joint]
        # Some of these stops take but 80 ms, and a few states more count.
        assert time <= entry.stopping_time <= 1.15 * time
        assert 0.9 * arm.braking[joint] <= entry.deceleration <= arm.braking[joint]
        kept = found.limits[name]
        assert arm.velocity[joint] <= kept.velocity <= 1.1 * arm.velocity[joint]
        assert arm.acceleration[joint] <= kept.acceleration <= 1.1 * arm.acceleration[joint]
    camera = found.sources["camera"]
    assert camera.rate == pytest.approx(100.0)
    assert camera.longest_silence == pytest.approx(commissioned_runs.SILENCE, abs=0.02)
    assert 0.004 <= camera.spread <= 0.006
    assert any(names[4] in line and "brakes" in line for line in found.missing)
    assert any("tracking" in line for line in found.missing)


def test_the_command_writes_lines_that_the_parsers_take(recorded, tmp_path, capsys):
    path, _, arm = recorded
    assert main(["commission", str(path), "--out", str(tmp_path / "found")]) == 0
    out = capsys.readouterr().out
    assert "not found: panda_joint5, brakes" in out
    assert "in 2 stops" in out
    assert {one.name for one in (tmp_path / "found").iterdir()} == {CELL_FILE, ROBOT_FILE}
    cell = Cell.from_text(ROBOT + (tmp_path / "found" / CELL_FILE).read_text())
    _, _, monitor = cell.build()
    settings = monitor.settings
    assert settings.reaction_time + settings.latency >= arm.latency
    assert settings.operating.velocity[0] >= arm.velocity[0]
    assert set(cell.sources) == {"camera"}
    description = read_description(tmp_path / "found" / ROBOT_FILE)
    assert len(description.joints) == 7
    entries = description.brake_entries()
    assert len(entries["panda_joint5"]) > 1
    assert "not found" in entries["panda_joint5"][0].source
    assert 4.5 <= entries["panda_joint1"][0].deceleration <= 5.0


@pytest.mark.parametrize(
    ("stated", "uncovered"), [(0.3, False), (0.1, True)], ids=["kept", "broken at times"]
)
def test_the_timeout_that_is_proposed_stops_no_arm_that_was_not_stopped(
    stated, uncovered, tmp_path, capsys
):
    """A camera at 50 Hz that is held up five times for 0.23 s, its messages in a burst after."""
    path = tmp_path / "run.mcap"
    obstacles = Obstacles(sources=["camera"])
    monitor = Monitor(Robot.load("panda"), obstacles, rate=200.0, source_timeout=stated)
    still = np.zeros(7)
    with Recorder(path, monitor) as recorder:
        waiting = []
        for tick in range(4000):
            now = tick / 200.0
            if tick % 4 == 0:
                waiting.append(now)
            if not any(0.0 <= now - held < 0.23 for held in (2.0, 5.0, 9.0, 13.0, 17.0)):
                for stamp in waiting:
                    obstacles.update(
                        ["ball"], stamp, [[4.0, 3.0, 0.5]], radius=0.1, source="camera"
                    )
                waiting.clear()
            monitor.step(now, commissioned_runs.READY, still)
        assert recorder.close() == ""
    assert main(["commission", str(path)]) == 0
    lines = capsys.readouterr().out
    assert ("; not covered: 5 up to 0.2" in lines) == uncovered
    (timeout,) = re.findall(r"^timeout = ([\d.]+)", lines, re.MULTILINE)
    begun = []
    for changes in ({}, {"source_timeout": timeout}):
        verdicts = [tick.replayed for tick in Replay(Recording(path), changes).ticks()]
        silent = [
            any(one.kind is ReasonKind.SOURCE_SILENT for one in verdict.reasons)
            for verdict in verdicts
        ]
        begun.append(sum(now and not before for before, now in itertools.pairwise(silent)))
    # Where the arm was stopped, it is stopped again, and nowhere else.
    assert begun == ([5, 5] if uncovered else [0, 0])


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda data: data[:200], "no recording|ends before"),
        (lambda data: b"", "is empty"),
        (lambda data: b"nothing of the kind", "no MCAP file"),
        (lambda data: data[:4000] + bytes(400) + data[4400:], "damaged|cannot be read|ends before"),
    ],
)
def test_a_file_that_is_none_is_one_line_and_exit_code_2(recorded, tmp_path, spoil, words, capsys):
    bad = tmp_path / "bad.mcap"
    bad.write_bytes(spoil(recorded[0].read_bytes()))
    assert main(["commission", str(bad)]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert re.fullmatch(rf"armguard: [^\n]*bad\.mcap[^\n]*({words})[^\n]*\n", err)
