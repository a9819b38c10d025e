import os

import msgspec
import pytest

from armguard.messages.events import StaticObstacle
from armguard.messages.incoming import ResetMessage
from armguard.recording import Recording
from armguard.recording.events import FORMAT, NUMBERS, JointState, Log, Time
from armguard.recording.packing import ATTACHED, NOTED, pack_record
from armguard.recording.ring import Ring, create_memory
from armguard.recording.scene import Scene
from armguard.recording.settings import describe_settings
from armguard.recording.writer import PatientFile, RecordingWriter, write_recording
from armguard.robot.portable import describe_robot
from support import eventful_runs


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


def open_file(path):
    return PatientFile(os.open(path, os.O_WRONLY | os.O_CREAT, 0o644))


def test_what_a_full_disk_did_not_take_is_in_the_file_once_it_does(start, tmp_path, monkeypatch):
    path = tmp_path / "run.mcap"
    write, is_full = os.write, [False]

    def take(descriptor, data):
        if is_full[0]:
            raise OSError(28, "No space left on device")
        return write(descriptor, bytes(data[:1000]))

    monkeypatch.setattr(os, "write", take)
    writer = RecordingWriter(open_file(path))
    for entry in start:
        send(writer, *entry)
    for number in range(3000):
        is_full[0] = 1000 <= number < 2000
        log = Log(timestamp=Time(0, number), level=3, message="a line")
        send(writer, NUMBERS[Log], number, log)
        if number % 100 == 0:
            writer.flush()
    writer.finish()
    events = [event for _, event, _ in Recording(path).events()]
    assert [event.timestamp.nsec for event in events] == list(range(3000))


def test_times_never_go_back_in_the_file(start, tmp_path):
    path = tmp_path / "run.mcap"
    writer = RecordingWriter(open_file(path))
    for entry in start:
        send(writer, *entry)
    for time in (5, 3, 3, 9):
        send(writer, NUMBERS[ResetMessage], time, ResetMessage(""))
    writer.finish()
    assert [time for time, _, _ in Recording(path).events()] == [5, 6, 7, 9]


def test_a_picture_that_cannot_be_drawn_costs_the_recording_nothing_else(
    start, tmp_path, monkeypatch, capsys
):
    def fail(self, event):
        raise ValueError("no picture")

    monkeypatch.setattr(Scene, "take_static", fail)
    path = tmp_path / "run.mcap"
    writer = RecordingWriter(open_file(path))
    for entry in start:
        send(writer, *entry)
    told = StaticObstacle(id="post", position=bytes(24), radius=0.1), ResetMessage("")
    for event in told:
        send(writer, NUMBERS[type(event)], 7, event)
    writer.finish()
    assert tuple(event for _, event, _ in Recording(path).events()) == told
    assert "no scene from here on: ValueError('no picture')" in capsys.readouterr().err


def test_events_in_the_ring_are_written_even_when_nobody_is_left_to_end_it(start, tmp_path):
    path, memory = tmp_path / "run.mcap", create_memory(1 << 20)
    ring = Ring(memory)
    state = JointState(0.0, list("abcdefg"), bytes(56), bytes(56), now=0.0)
    for entry in (*start, (NUMBERS[JointState], 7, state)):
        assert ring.write(pack_record(*entry))
    nobody = 2**22 + 1
    assert write_recording(Ring(memory), open_file(path), nobody) == 0
    os.close(memory)
    recording = Recording(path)
    assert [event for _, event, _ in recording.events()] == [state]
    assert not recording.is_cut_off
