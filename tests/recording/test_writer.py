import itertools
import os
import random
import time

import msgspec
import pytest

from armguard.exceptions import ArmguardError
from armguard.messages.events import StaticObstacle
from armguard.messages.incoming import ResetMessage
from armguard.monitor.portable import describe_settings
from armguard.recording import Recording, Rotation, verify
from armguard.recording import writer as writer_module
from armguard.recording.events import FORMAT, NUMBERS, JointState, Log, Time
from armguard.recording.packing import ATTACHED, NOTED, WriterOptions, pack_record
from armguard.recording.parts import open_file
from armguard.recording.ring import Ring, create_memory
from armguard.recording.scene import Scene
from armguard.recording.signing import write_signing_pair
from armguard.recording.writer import PatientFile, RecordingWriter, write_recording
from armguard.robot.portable import describe_robot
from support import eventful_runs, forked_writers


@pytest.fixture(scope="module")
def start():
    """What stands in front of each recording."""
    robot, _, monitor = eventful_runs.make_monitor("joint")
    made = {"settings.json": describe_settings(monitor), "robot.json": describe_robot(robot)}
    return [
        (NOTED, 1, ("armguard", {"format": str(FORMAT)})),
        *((ATTACHED, 1, (name, "", msgspec.json.encode(data))) for name, data in made.items()),
    ]


def send(writer, kind, nanoseconds, content):
    """Have a writer write a message, or what stands in front of all."""
    writer.take(pack_record(kind, nanoseconds, content))


def open_writer(path, **options):
    """A writer, and its file."""
    file = PatientFile(os.open(path, os.O_WRONLY | os.O_CREAT, 0o644))
    return RecordingWriter(file, WriterOptions(str(path), **options)), file


def test_what_a_full_disk_did_not_take_is_in_the_file_once_it_does(start, tmp_path, monkeypatch):
    path = tmp_path / "run.mcap"
    write, is_full = os.write, [False]

    def take(descriptor, data):
        if is_full[0]:
            raise OSError(28, "No space left on device")
        return write(descriptor, bytes(data[:1000]))

    monkeypatch.setattr(os, "write", take)
    writer = open_writer(path)[0]
    for entry in start:
        send(writer, *entry)
    for number in range(3000):
        is_full[0] = 1000 <= number < 2000
        log = Log(timestamp=Time(0, number), level=3, message="a line")
        send(writer, NUMBERS[Log], number, log)
        if number % 100 == 0:
            writer.flush(0.01 * number)
    writer.finish()
    events = [event for _, event, _ in Recording(path).events()]
    assert [event.timestamp.nsec for event in events] == list(range(3000))


def test_times_never_go_back_in_the_file(start, tmp_path):
    path = tmp_path / "run.mcap"
    writer = open_writer(path)[0]
    for entry in start:
        send(writer, *entry)
    for nanoseconds in (5, 3, 3, 9):
        send(writer, NUMBERS[ResetMessage], nanoseconds, ResetMessage(""))
    writer.finish()
    assert [time for time, _, _ in Recording(path).events()] == [5, 6, 7, 9]


def test_a_picture_that_cannot_be_drawn_costs_the_recording_nothing_else(
    start, tmp_path, monkeypatch, capsys
):
    def fail(self, event):
        raise ValueError("no picture")

    monkeypatch.setattr(Scene, "take_static", fail)
    path = tmp_path / "run.mcap"
    writer = open_writer(path)[0]
    for entry in start:
        send(writer, *entry)
    told = StaticObstacle(id="post", position=bytes(24), radius=0.1), ResetMessage("")
    for event in told:
        send(writer, NUMBERS[type(event)], 7, event)
    writer.finish()
    assert tuple(event for _, event, _ in Recording(path).events()) == told
    assert "scene of the recording ends here: ValueError('no picture')" in capsys.readouterr().err


def test_events_in_the_ring_are_written_even_when_nobody_is_left_to_end_it(start, tmp_path):
    path, memory = tmp_path / "run.mcap", create_memory(1 << 20)
    ring = Ring(memory)
    state = JointState(0.0, list("abcdefg"), bytes(56), bytes(56), now=0.0)
    for entry in (*start, (NUMBERS[JointState], 7, state)):
        assert ring.write(pack_record(*entry))
    nobody = 2**22 + 1
    assert write_recording(Ring(memory), *open_writer(path), nobody) == 0
    os.close(memory)
    recording = Recording(path)
    assert [event for _, event, _ in recording.events()] == [state]
    assert not recording.is_cut_off


class TimedRing:
    """A ring into which a record comes every 10 ms; the time is that of a manual clock.

    Args:
        records: In front of all others.
        clock: A list with the time in [s].
        end: When the process is killed, in [s].
    """

    is_finished = is_empty = False

    def __init__(self, records, clock, end):
        self._records, self._clock, self._end = list(records), clock, end
        self._next = 0

    def beat(self):
        if self._clock[0] >= self._end:
            raise SystemExit

    def read(self):
        if self._records:
            return pack_record(*self._records.pop(0))
        if self._next * 0.01 > self._clock[0]:
            return None
        time = self._next * 10_000_000
        self._next += 1
        log = Log(timestamp=Time(0, time), level=3, message="a line")
        return pack_record(NUMBERS[Log], time, log)


@pytest.mark.hazard("H-11")
@pytest.mark.parametrize("end", [1.3, 2.0, 3.33])
@pytest.mark.parametrize("rotation", [Rotation(), Rotation(duration=1.2)])
def test_a_process_that_is_killed_loses_the_last_second_at_most(
    start, tmp_path, monkeypatch, end, rotation
):
    """By a manual clock; and what is left verifies, up to its missing end."""
    path, clock = tmp_path / "run.mcap", [0.0]

    def sleep(duration):
        clock[0] += duration

    monkeypatch.setattr(writer_module.time, "monotonic", lambda: clock[0])
    monkeypatch.setattr(writer_module.time, "sleep", sleep)
    writer, file = open_writer(path, rotation=rotation)
    with pytest.raises(SystemExit):
        write_recording(TimedRing(start, clock, end), writer, file, os.getppid())
    monkeypatch.undo()
    recording = Recording(path)
    times = [time for time, *_ in recording.events()]
    assert recording.is_cut_off
    assert times[-1] * 1e-9 > end - 1.0
    assert len(times) == round(times[-1] / 10_000_000) + 1, "all that was told before is there"
    *before, last = verify(path)
    assert all(one.is_intact for one in before)
    assert bool(before) == (end > 3.0 and rotation.duration is not None)
    (told,) = last.problems
    assert "the end is missing" in told
    assert last.last == times[-1]


def test_a_recording_goes_on_in_one_file_where_there_can_be_no_other(start, tmp_path, capsys):
    path = tmp_path / "run.mcap"
    (tmp_path / "run.2.mcap").write_text("precious")
    writer, _ = open_writer(path, rotation=Rotation(duration=1.0))
    for entry in start:
        send(writer, *entry)
    for second in range(4):
        send(writer, NUMBERS[ResetMessage], second, ResetMessage(""))
        writer.flush(float(second))
    writer.finish()
    assert (tmp_path / "run.2.mcap").read_text() == "precious"
    assert capsys.readouterr().err.count("stays in one file") == 1
    assert len(list(Recording(path).events())) == 4
    assert verify(path)[0].is_intact


def test_a_full_disk_loses_nothing_where_a_recording_goes_on(start, tmp_path, monkeypatch):
    path = tmp_path / "run.mcap"
    write, is_full = os.write, [False]

    def take(descriptor, data):
        if is_full[0]:
            raise OSError(28, "No space left on device")
        return write(descriptor, data)

    monkeypatch.setattr(os, "write", take)
    writer, file = open_writer(path, rotation=Rotation(size=20_000))
    for entry in start:
        send(writer, *entry)
    for number in range(3000):
        is_full[0] = 500 <= number < 2500
        log = Log(timestamp=Time(0, number), level=3, message=f"line {number * 7919}")
        send(writer, NUMBERS[Log], number, log)
        if number % 100 == 0:
            writer.flush(0.0)
            assert bool(file.problem) == is_full[0]
    writer.finish()
    results = verify(path)
    assert len(results) > 3
    assert all(one.is_intact for one in results)
    events = [event for _, event, _ in Recording(path).events()]
    assert [event.timestamp.nsec for event in events] == list(range(3000))


def watch_disk(monkeypatch, folder):
    """What is on the disk after each step by which it changes: bytes by name, in order."""
    states, names, contents = [{}], {}, {}
    write, opened = os.write, writer_module.open_file

    def take(descriptor, data):
        contents[names[descriptor]] += bytes(data)
        states.append(dict(contents))
        return write(descriptor, data)

    def follow(path):
        descriptor = opened(path)
        names[descriptor] = path.name
        contents[path.name] = b""
        states.append(dict(contents))
        return descriptor

    monkeypatch.setattr(writer_module, "open_file", follow)
    monkeypatch.setattr(os, "write", take)
    return states, follow


@pytest.mark.hazard("H-11")
def test_what_a_power_cut_leaves_at_any_moment_verifies_and_reads_up_to_there(
    start, tmp_path, monkeypatch
):
    """At each write and around each rotation, with the last write whole or torn anywhere."""
    (tmp_path / "run").mkdir()
    path = tmp_path / "run" / "run.mcap"
    states, follow = watch_disk(monkeypatch, path.parent)
    file = PatientFile(follow(path))
    writer = RecordingWriter(file, WriterOptions(str(path), rotation=Rotation(duration=1.0)))
    for entry in start:
        send(writer, *entry)
    for half_second in range(6):
        log = Log(timestamp=Time(0, half_second), level=3, message="a line")
        send(writer, NUMBERS[Log], half_second, log)
        writer.flush(0.5 * half_second)
    monkeypatch.undo()
    assert len(states[-1]) == 3
    rng, told, left = random.Random(0), set(), tmp_path / "run.mcap"
    for before, after in itertools.pairwise(states[1:]):
        (name,) = (one for one in after if after[one] != before.get(one))
        size = len(before.get(name, b""))
        for length in (size, rng.randrange(size, len(after[name]) + 1), len(after[name])):
            for one, data in {**after, name: after[name][:length]}.items():
                (tmp_path / one).write_bytes(data)
            if not is_whole(left):
                continue
            *whole, last = check_cut(left)
            told.add((len(whole), last.chunks > 0, last.problems[0].split()[0]))
            recording = Recording(left)
            count = sum(1 for _ in recording.events())
            # A chunk may be whole whose link is torn.
            assert count - sum(one.chunks for one in (*whole, last)) in (0, 1)
            assert recording.is_cut_off
    assert {(1, False, "run.2.mcap,"), (1, False, "the"), (1, True, "the")} <= told
    assert {(2, False, "run.3.mcap,")} <= told


def check_cut(path, key=None):
    """Verify what a cut has left: nothing was lost but the end."""
    results = verify(path, key)
    *whole, last = results
    for one in whole[:-1]:
        assert one.is_intact
    for one in whole[-1:]:
        assert one.is_intact or one.problems == (
            "the index at the end of the file was cut off; no chunk is lost",
        )
    (told,) = last.problems
    assert "at most its last second is lost" in told
    return results


@pytest.mark.hazard("H-11")
def test_what_a_kill_leaves_at_random_moments_verifies(start, tmp_path, monkeypatch):
    """A process that goes on in another file all the time, and signs; ended by SIGKILL."""
    monkeypatch.setattr(writer_module, "FLUSH_INTERVAL", 0.01)
    monkeypatch.setattr(writer_module, "PAUSE", 0.001)
    secret, _, key = write_signing_pair("recorder", tmp_path)
    rng, parts = random.Random(0), set()
    for number in range(12):
        path, memory = tmp_path / f"{number}.mcap", create_memory(1 << 20)
        options = WriterOptions(str(path), str(secret), Rotation(duration=0.03))
        ring, descriptor = Ring(memory), open_file(path)
        for entry in start:
            assert ring.write(pack_record(*entry))
        arguments = *map(str, (memory, descriptor, os.getpid())), msgspec.json.encode(options)
        process = forked_writers.Popen(
            ["python", "-P", "-m", "armguard.recording", *arguments],
            stdin=forked_writers.DEVNULL,
            pass_fds=(memory, descriptor),
            start_new_session=True,
        )
        os.close(memory)
        os.close(descriptor)
        count, end, begun = 0, None, time.monotonic()
        while end is None or time.monotonic() < end:
            for _ in range(20):
                log = Log(timestamp=Time(0, count), level=3, message="a line")
                count += ring.write(pack_record(NUMBERS[Log], time.time_ns(), log))
            time.sleep(0.001)
            assert time.monotonic() < begun + 60.0
            if end is None and is_whole(path):
                end = time.monotonic() + rng.uniform(0.0, 0.2)
        process.kill()
        process.wait()
        results = check_cut(path, key)
        parts.add(len(results))
        told = [event.timestamp.nsec for _, event, _ in Recording(path).events()]
        assert told == list(range(len(told)))
    assert max(parts) > 2


def is_whole(path):
    """Whether what stands in front of the first chunk is there."""
    try:
        verify(path)
    except ArmguardError:
        return False
    return True


def test_what_retention_removes_is_noted(start, tmp_path):
    now = time.time()
    olds = [tmp_path / f"armguard-20260101T0000{number}-1.mcap" for number in range(10, 30)]
    for number, old in enumerate(olds):
        old.write_text("x")
        os.utime(old, (now - 400.0 * (20 - number),) * 2)
    path = tmp_path / "armguard-20260101T000030-1.mcap"
    writer, _ = open_writer(path, rotation=Rotation(keep=3600.0))
    for entry in start:
        send(writer, *entry)
    writer.flush(0.0)
    writer.finish()
    removed = [old.name for old in reversed(olds) if not old.exists()]
    assert removed
    lines = [event.message for _, event, _ in Recording(path).events()]
    assert lines == [f"removed, since its time to keep has passed: {name}" for name in removed]
    assert verify(path)[0].is_intact
