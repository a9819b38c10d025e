import itertools
import json
import os
import select
import signal
import subprocess
import time
from pathlib import Path
from types import SimpleNamespace

import coal
import numpy as np
import pytest

import armguard
from armguard.exceptions import ArmguardError
from armguard.messages.answers import VerdictMessage, to_verdict_message
from armguard.messages.events import FaultsTaken, StaticObstacle
from armguard.messages.incoming import IgnoreMessage, ObstaclesMessage, WatchMessage
from armguard.messages.proof import Proof
from armguard.obstacles import Obstacles, Source
from armguard.recording import Recorder, Rotation, replay, verify, writer
from armguard.recording import recorder as recorder_module
from armguard.recording.events import BodiesChanged, Gap, JointState, Log, MalformedState
from armguard.recording.recorder import check_new
from armguard.recording.signing import read_signing_key, write_signing_pair
from armguard.scheduling import FullSchedule
from armguard.verdict import ReasonKind
from support import eventful_runs
from support.eventful_runs import PERIOD, stand
from support.panda_monitor import HOME, STILL, make_monitor
from support.recordings_made import is_running, read_events, read_verdicts, record
from support.waiting import wait_until


def start(path, **options):
    """A recorder of a monitor whose camera sees nothing."""
    obstacles, monitor = make_monitor(obstacles=Obstacles(sources=["camera"]))
    return Recorder(path, monitor, **options), obstacles, monitor


def test_every_input_and_every_verdict_is_in_the_file(tmp_path, monkeypatch):
    monkeypatch.setattr(recorder_module, "subprocess", subprocess)  # the real process
    path = tmp_path / "run.mcap"
    verdicts, _ = record(path, ticks=200, start=300)
    events = read_events(path)
    kinds = [type(event) for event in events]
    told = [event for event in events if isinstance(event, VerdictMessage)]
    assert repr(told) == repr([to_verdict_message(verdict) for verdict in verdicts])
    assert kinds.count(JointState) + kinds.count(MalformedState) == 200
    assert kinds.count(ObstaclesMessage) >= 40
    statics = [event for event in events if isinstance(event, StaticObstacle)]
    assert len(statics) == 3
    assert sum(event.speed is not None for event in statics) == 1, "an entrance"
    assert kinds.count(FaultsTaken) == 1, "what the monitor itself takes is not told"
    assert len(read_verdicts(path)) == len(verdicts)


def test_the_tools_of_the_field_can_read_it(tmp_path):
    from mcap.reader import make_reader

    path = tmp_path / "run.mcap"
    record(path, ticks=200)
    with path.open("rb") as file:
        reader = make_reader(file)
        summary = reader.get_summary()
        counts = summary.statistics.channel_message_counts
        topics = {summary.channels[number].topic: count for number, count in counts.items()}
        assert topics["/armguard/verdict"] == topics["/armguard/joint_state"] == 200
        assert {"/armguard/scene", "/armguard/obstacles", "/armguard/statics"} <= set(topics)
        assert {channel.message_encoding for channel in summary.channels.values()} == {"json"}
        assert {schema.encoding for schema in summary.schemas.values()} == {"jsonschema"}
        last = 0
        for schema, channel, message in reader.iter_messages():
            content = json.loads(message.data)
            assert set(json.loads(schema.data)["required"]) <= set(content), channel.topic
            assert message.log_time > last or channel.topic == "/armguard/scene"
            last = message.log_time
        scenes = list(reader.iter_messages(topics=["/armguard/scene"]))
    schema, _, message = scenes[-1]
    assert schema.name == "foxglove.SceneUpdate"
    entities = {entity["id"]: entity for entity in json.loads(message.data)["entities"]}
    assert len(entities["arm"]["spheres"]) > 10
    assert "part0" in [text["text"] for text in entities["obstacles"]["texts"]]


def test_a_recorder_is_no_part_of_the_answer(tmp_path):
    _, obstacles, monitor = eventful_runs.make_monitor("joint")
    expected, _ = eventful_runs.drive(monitor, obstacles, ticks=150)
    verdicts, _ = record(tmp_path / "run.mcap", ticks=150)
    assert repr(verdicts) == repr(expected)


def test_tools_are_recorded_too(tmp_path):
    path, robot = tmp_path / "run.mcap", armguard.Robot.load("panda")
    obstacles, monitor = make_monitor(robot=robot)
    obstacles.add_static("post", [0.7, 0.3, 0.6], 0.05)
    with Recorder(path, monitor):
        stand(monitor, 5)
        robot.attach("gripper", "panda_hand", coal.Box(0.2, 0.2, 0.2))
        stand(monitor, 5, 5)
        robot.detach("gripper")
        stand(monitor, 5, 10)
    assert sum(isinstance(event, BodiesChanged) for event in read_events(path)) == 2
    assert replay(path).is_identical


def test_exemptions_that_were_told_before_are_recorded_too(tmp_path):
    """Their beginnings and ends as well, in lines for people."""
    path, zone = tmp_path / "run.mcap", np.vstack([np.zeros(3), np.eye(3)])
    obstacles, monitor = make_monitor(rate=1.0 / PERIOD)
    obstacles.add_static("post", [0.2, 0.2, 0.2], 0.05)
    first = monitor.ignore("panda_hand", "post", zone=zone)
    with Recorder(path, monitor):
        stand(monitor, 5)
        monitor.watch(first)
        monitor.ignore("*", "post", until=3 * PERIOD + 0.5)
        verdicts = stand(monitor, 5, 5)
    assert any(one.kind is ReasonKind.PAIR_IGNORED for one in verdicts[-1].reasons)
    events = read_events(path)
    told = [event for event in events if isinstance(event, IgnoreMessage)]
    assert [(one.number, one.link, one.ids) for one in told] == [
        (1, "panda_hand", "post"),
        (2, "*", "post"),
    ]
    assert [event.number for event in events if isinstance(event, WatchMessage)] == [1]
    lines = [event.message for event in events if isinstance(event, Log)]
    assert len(lines) == 3
    assert all("and post" in line for line in lines)
    report = replay(path)
    assert report.is_identical, report.difference
    with pytest.raises(ArmguardError, match="has already ended exemptions"):
        Recorder(tmp_path / "late.mcap", ended(make_monitor()[1]))


def ended(monitor):
    """A monitor with an exemption that has ended already."""
    monitor.watch(monitor.ignore("*", "post", until=1.0))
    return monitor


def test_what_cannot_be_recorded_is_a_gap_and_harms_nobody(tmp_path, monkeypatch):
    path = tmp_path / "run.mcap"
    recorder, _, monitor = start(path)

    def fail(*arguments):
        raise ValueError("no bytes")

    monkeypatch.setattr(recorder_module, "pack_record", fail)
    verdicts = stand(monitor, 2)
    monkeypatch.undo()
    assert verdicts[-1].sequence == 2
    assert recorder.close()
    assert recorder.lost == 4
    assert replay(path).lost == 4


def test_names_that_no_file_can_hold_are_refused_by_name_and_leave_no_gap(tmp_path):
    path = tmp_path / "run.mcap"
    recorder, obstacles, monitor = start(path)
    for ids, source in ((["\ud800"], "camera"), (["ball"], "\udfff")):
        with pytest.raises(ArmguardError, match=r"'\\ud(800|fff)'.*UTF-8"):
            obstacles.update(ids, 0.0, [[3.0, 0.0, 0.0]], radius=0.1, source=source)
    with pytest.raises(ArmguardError, match=r"'\\ud800'.*UTF-8"):
        obstacles.remove(["\ud800"])
    with pytest.raises(ArmguardError, match=r"'\\ud800'.*UTF-8"):
        Source("\ud800")
    verdict = stand(monitor, 1)[0]
    assert any("\\ud800" in str(reason) for reason in verdict.reasons)
    assert recorder.close() == ""
    assert replay(path).is_identical


def test_what_a_loop_defers_is_written_in_order_when_it_says_so_or_in_its_next_tick(tmp_path):
    path = tmp_path / "run.mcap"
    recorder, obstacles, monitor = start(path)
    recorder.defer()
    written = []
    write = recorder._ring.write
    recorder._ring.write = lambda record: (written.append(record), write(record))[1]
    expected = stand(monitor, 1)
    assert not written
    recorder.write_pending()
    recorder.write_pending()
    assert len(written) == 2
    obstacles.update([], PERIOD, source="camera")
    expected += stand(monitor, 1, 1)
    monitor.reset()
    assert len(written) == 2
    expected += stand(monitor, 1, 2)
    assert len(written) == 2 + 4, "a message, a tick, and the reset"
    recorder.note("a line")
    assert recorder.close() == ""
    names = [type(event).__name__ for event in read_events(path)]
    tick = ["JointState", "VerdictMessage"]
    assert names == [*tick, "ObstaclesMessage", *tick, "ResetMessage", *tick, "Log"]
    assert repr(read_verdicts(path)) == repr(expected)
    assert replay(path).is_identical


def test_ctrl_c_while_what_was_left_is_written_writes_nothing_twice(tmp_path):
    path = tmp_path / "run.mcap"
    recorder, _, monitor = start(path)
    recorder.defer()
    stand(monitor, 3)
    put, count = recorder._ring.write, []

    def write(record):
        count.append(record)
        answer = put(record)
        if len(count) == 2:
            raise KeyboardInterrupt
        return answer

    recorder._ring.write = write
    with pytest.raises(KeyboardInterrupt):
        recorder.write_pending()
    assert "not complete" in recorder.close() or recorder.lost == 1
    told = [event for event in read_events(path) if isinstance(event, VerdictMessage)]
    assert len(told) == 3


def test_what_is_deferred_is_bounded(tmp_path, monkeypatch):
    monkeypatch.setattr(recorder_module, "MOST_PENDING", 10)
    path = tmp_path / "run.mcap"
    recorder, obstacles, monitor = start(path)
    recorder.defer()
    for k in range(100):
        obstacles.update([], PERIOD * k, source="camera")
        assert len(recorder._pending) <= 10
    stand(monitor, 1, 100)
    assert recorder.close() == ""
    assert sum(isinstance(event, ObstaclesMessage) for event in read_events(path)) == 100


def test_no_proof_is_made_in_less_time_than_one_took(tmp_path, monkeypatch):
    """The assumed time is halved where it prevents a proof, later each time it was too short."""
    recorder, obstacles, monitor = start(tmp_path / "run.mcap", proof_interval=0.0)
    recorder.defer()
    present, used, proved = [100.0], [0.0], []

    def prove(verdict):
        used[0] += 1e-3
        proved.append(verdict.sequence)

    clock = SimpleNamespace(
        monotonic=lambda: present[0],
        thread_time=lambda: used[0],
        monotonic_ns=time.monotonic_ns,
        time_ns=time.time_ns,
    )
    monkeypatch.setattr(recorder_module, "time", clock)
    monkeypatch.setattr(monitor, "prove", prove)
    recorder._halve_at = 101.0
    ticks = itertools.count()

    def try_one(idle):
        tick = next(ticks)
        obstacles.update(["ball"], tick * PERIOD, [[0.9, 0.0, 0.5]], source="camera", radius=0.1)
        (verdict,) = stand(monitor, 1, tick)
        recorder.write_pending()
        recorder.prove_pending(idle)
        return proved[-1:] == [verdict.sequence]

    assert not any(try_one(0.8e-3) for _ in range(5))  # the first assumption is longer
    assert try_one(2e-3)
    waits = []
    for _ in range(10):
        since = present[0]
        while not try_one(0.8e-3):
            present[0] += 0.25
        waits.append(present[0] - since)
    # Each took longer than there was, and makes the next one wait for longer.
    assert waits[1:] == sorted(waits[1:])
    assert waits[-1] >= 60.0
    assert not any(try_one(value) for value in (0.9e-3, 0.0, -1.0, float("nan")))
    monkeypatch.undo()
    recorder.close()


def test_a_loop_that_defers_proves_its_last_verdict_when_it_says_so(tmp_path):
    path = tmp_path / "run.mcap"
    recorder, obstacles, monitor = start(path, proof_interval=0.01)
    recorder.defer()
    proved = []
    for tick in range(30):
        obstacles.update(["ball"], tick * PERIOD, [[0.9, 0.0, 0.5]], source="camera", radius=0.1)
        verdict = stand(monitor, 1, tick)[0]
        if tick != 5:
            recorder.write_pending()
        if tick == 10 or tick > 12:
            # The first of these is due since the start; what nobody proved in time is left out.
            recorder.prove_pending()
            proved.append(verdict.sequence)
    assert recorder.close() == ""
    events = read_events(path)
    proofs = [event for event in events if isinstance(event, Proof)]
    numbers = [proof.sequence for proof in proofs]
    assert numbers[0] == 11
    assert len(numbers) > 2
    assert {*numbers} <= {*proved}
    assert (np.diff([proof.now for proof in proofs]) > 0.01 - 1e-9).all()
    for place, event in enumerate(events):
        if isinstance(event, Proof):
            assert isinstance(events[place - 1], VerdictMessage)
            assert events[place - 1].sequence == event.sequence
    assert replay(path).is_identical


def test_a_proof_that_cannot_be_made_is_told_in_the_file(tmp_path, monkeypatch):
    path = tmp_path / "run.mcap"
    recorder, obstacles, monitor = start(path)

    def fail(verdict):
        raise ZeroDivisionError

    monkeypatch.setattr(monitor, "prove", fail)
    obstacles.update(["ball"], 0.0, [[0.9, 0.0, 0.5]], source="camera", radius=0.1)
    assert stand(monitor, 1)[0].reasons
    assert recorder.close() == ""
    told = [event.message for event in read_events(path) if isinstance(event, Log)]
    assert told == ["tick 1 could not be proved: ZeroDivisionError()"]
    assert replay(path).is_identical


def is_waiting(pid):
    """Whether a process waits in writing to a pipe, as far as the system tells."""
    calls = set()
    for _ in range(20):
        calls.add(Path(f"/proc/{pid}/wchan").read_text())
        time.sleep(0.01)
    return len(calls) == 1 and any("pipe" in call or call in ("", "0") for call in calls)


@pytest.mark.hazard("H-09")
def test_a_slow_disk_leaves_a_gap_and_never_holds_up_the_loop(tmp_path):
    """A pipe that nothing reads is a disk that takes nothing: by count, not by time."""
    path, copy = tmp_path / "pipe", tmp_path / "run.mcap"
    os.mkfifo(path)
    reading = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    recorder, obstacles, monitor = start(path, capacity=1 << 20)
    positions = np.random.default_rng(0).uniform(5.0, 9.0, (200, 3))
    names = [f"ball {number}" for number in range(200)]
    ticks = 0

    def fill():
        """Go on until there is no room."""
        nonlocal ticks
        before = recorder.lost
        while recorder.lost < before + 100:
            obstacles.update(names, PERIOD * ticks, positions, radius=0.1, source="camera")
            monitor.step(PERIOD * ticks, HOME, STILL)
            ticks += 1
            assert ticks < 100_000

    fill()
    # It has begun to write, and once the pipe is full it waits for ever.
    wait_until(lambda: select.select([reading], [], [], 0.0)[0])
    wait_until(lambda: is_waiting(recorder.pid))
    fill()
    told = recorder.lost
    stand(monitor, 50, ticks)
    assert recorder.lost == told + 100, "each call comes back, and what it told is counted"
    os.set_blocking(reading, True)
    with os.fdopen(reading, "rb") as pipe, copy.open("wb") as file:
        copier = subprocess.Popen(["cat"], stdin=pipe, stdout=file)
        # The disk takes everything again.
        wait_until(lambda: recorder._ring.free > recorder._ring.capacity // 2)
        lost = recorder.lost
        stand(monitor, 20, ticks + 50)
        assert recorder.lost == lost
        assert "gaps" in recorder.close()
    copier.wait()
    events = read_events(copy)
    gaps = [event for event in events if isinstance(event, Gap)]
    assert sum(gap.events for gap in gaps) == lost
    after = events[events.index(gaps[-1]) :]
    assert sum(isinstance(event, JointState) for event in after) == 20
    report = replay(copy)
    assert report.lost == lost
    assert report.difference is None
    assert not report.is_identical


def test_the_process_that_writes_is_ended_by_the_loop_and_not_by_a_signal_to_both(
    tmp_path, monkeypatch
):
    monkeypatch.setattr(recorder_module, "subprocess", subprocess)  # the real process
    path = tmp_path / "run.mcap"
    recorder, _, monitor = start(path)
    stand(monitor, 20)
    wait_until(lambda: path.stat().st_size > 0)
    os.kill(recorder.pid, signal.SIGTERM)
    time.sleep(0.2)
    assert is_running(recorder.pid)
    stand(monitor, 20, 20)
    assert recorder.close() == ""
    assert replay(path).compared == 40


def test_a_context_is_not_left_in_silence_where_the_file_is_not_complete(tmp_path):
    recorder, _, monitor = start(tmp_path / "run.mcap")
    recorder.__enter__()
    stand(monitor, 5)
    os.kill(recorder.pid, signal.SIGKILL)
    with pytest.warns(RuntimeWarning, match="is not complete"):
        recorder.__exit__(None, None, None)


def test_it_must_be_made_before_anything_is_told_that_a_replay_needs(tmp_path):
    obstacles, monitor = make_monitor(obstacles=Obstacles())
    stand(monitor, 1)
    with pytest.raises(ArmguardError, match="already judged 1 joint states"):
        Recorder(tmp_path / "a.mcap", monitor)
    obstacles, monitor = make_monitor(obstacles=Obstacles())
    obstacles.update(["ball"], 0.0, [[1, 1, 1]], radius=0.1)
    with pytest.raises(ArmguardError, match="were already reported"):
        Recorder(tmp_path / "a.mcap", monitor)
    recorder, _, monitor = start(tmp_path / "b.mcap")
    with pytest.raises(ArmguardError, match="recorded already"):
        Recorder(tmp_path / "a.mcap", monitor)
    recorder.close()
    with pytest.raises(ArmguardError, match=r"armguard\.Monitor"):
        Recorder(tmp_path / "a.mcap", "monitor")
    assert not (tmp_path / "a.mcap").exists()


def test_a_capacity_without_room_for_the_robot_is_refused(tmp_path):
    with pytest.raises(ArmguardError, match="capacity: is 1000 bytes"):
        start(tmp_path / "run.mcap", capacity=1000)


def test_no_recording_is_written_over(tmp_path):
    path = tmp_path / "run.mcap"
    path.write_bytes(b"something")
    with pytest.raises(ArmguardError, match="there already"):
        start(path)
    assert path.read_bytes() == b"something"
    with pytest.raises(ArmguardError, match="no folder"):
        check_new(tmp_path / "nowhere" / "run.mcap")


def test_a_folder_gets_a_file_named_by_the_time(tmp_path):
    recorder, _, _ = start(tmp_path)
    assert recorder.close() == ""
    assert [recorder.path] == list(tmp_path.glob("armguard-*T*.mcap"))


def test_what_keeps_the_file_from_being_written_is_found_while_it_lasts(tmp_path, monkeypatch):
    monkeypatch.setattr(recorder_module, "SILENT_TIMEOUT", 0.3)
    recorder, _, _ = start(tmp_path / "run.mcap")
    wait_until(lambda: recorder._ring.beats > 0)
    assert recorder.find_trouble() == ""
    os.kill(recorder.pid, signal.SIGSTOP)
    wait_until(lambda: "blocked" in recorder.find_trouble())
    os.kill(recorder.pid, signal.SIGCONT)
    wait_until(lambda: not recorder.find_trouble())
    os.kill(recorder.pid, signal.SIGKILL)
    wait_until(lambda: "has ended" in recorder.find_trouble())
    assert recorder.close()
    assert recorder.find_trouble() == "", "and that is what `close` says"


def test_without_its_packages_it_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setattr(recorder_module.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(ArmguardError, match=r"pip install 'armguard\[record\]'"):
        start(tmp_path / "run.mcap")


def test_a_schedule_of_the_applications_own_cannot_be_recorded(tmp_path):
    class Own(FullSchedule):
        pass

    _, monitor = make_monitor(Own())
    with pytest.raises(ArmguardError, match="Own of the application's own"):
        Recorder(tmp_path / "run.mcap", monitor)


def test_a_disk_without_room_is_told_and_harms_nobody(tmp_path, capfd):
    if not os.path.exists("/dev/full"):
        pytest.skip("no /dev/full here")
    recorder, _, monitor = start("/dev/full")
    stand(monitor, 20)
    assert "not complete" in recorder.close()
    assert "No space left" in capfd.readouterr().err


def test_a_recording_that_goes_on_in_further_files_is_signed_and_replayed_as_one(
    tmp_path, monkeypatch
):
    monkeypatch.setattr(writer, "FLUSH_INTERVAL", 0.0)
    secret, public, _ = write_signing_pair("recorder", tmp_path)
    path = tmp_path / "run.mcap"
    options = {"key": secret, "rotation": Rotation(size=150_000)}
    verdicts, _ = record(path, ticks=200, recorder_options=options)
    results = verify(path, read_signing_key(public))
    assert len(results) > 1
    assert [one.problems for one in results] == [()] * len(results)
    report = replay(path)
    assert report.is_identical
    assert report.compared == len(verdicts)
    with pytest.raises(ArmguardError, match="is part 2 of a recording"):
        replay(tmp_path / "run.2.mcap")
    for later in tmp_path.glob("run.*.mcap"):
        later.unlink()
    report = replay(path)
    assert report.is_cut_off
    assert report.difference is None


def test_what_a_killed_writer_leaves_verifies(tmp_path):
    recorder, _, monitor = start(tmp_path / "run.mcap")
    stand(monitor, 200)
    wait_until(lambda: recorder.path.stat().st_size > 0)
    os.kill(recorder.pid, signal.SIGKILL)
    assert "not complete" in recorder.close()
    (result,) = verify(recorder.path)
    (told,) = result.problems
    assert "the end is missing" in told


def test_a_key_or_a_rotation_that_cannot_be_used_is_told_before_there_is_a_file(tmp_path):
    for options in ({"key": tmp_path / "nowhere"}, {"rotation": Rotation(size=-1.0)}):
        with pytest.raises(ArmguardError):
            start(tmp_path / "run.mcap", **options)
    assert not list(tmp_path.iterdir())
