import math
import random
import time

import numpy as np
import pytest

from armguard.lab.faults.disturbance import (
    Disturbance,
    DisturbedPublisher,
    disturb,
)
from armguard.messages.incoming import JointsMessage, ObstaclesMessage, decode
from armguard.streams import SocketInput
from support.stream_sockets import attend

NOW = 100.0
IMAGE = ObstaclesMessage(
    ["a", "b"], 99.5, "camera", 7, position=np.arange(6.0).tobytes(), radius=0.1
)
STATE = JointsMessage(99.5, ["x", "y"], np.array([1.0, 2.0]).tobytes(), bytes(16), 7)
PATIENCE = 20.0


def make(kind, **options):
    return Disturbance(kind=kind, begin=99.0, end=101.0, **options)


def apply(message, disturbance, number=0):
    return disturb(message, disturbance, NOW, number, random.Random(1))


def change(message, disturbance, number=0):
    ((when, changed),) = apply(message, disturbance, number)
    assert when == NOW
    return changed


def only(message, changed):
    """The fields in which two messages differ."""
    names = message.__struct_fields__
    return {name for name in names if getattr(message, name) != getattr(changed, name)}


@pytest.mark.parametrize("message", [IMAGE, STATE])
def test_a_message_is_dropped_held_back_or_sent_twice(message):
    assert apply(message, make("drop")) == []
    assert apply(message, make("repeat")) == [(NOW, message)] * 2
    assert apply(message, make("late", value="0.5")) == [(NOW + 0.5, message)]
    assert apply(message, make("swap", value="0.5"), 0) == [(NOW + 0.5, message)]
    assert apply(message, make("swap", value="0.5"), 1) == [(NOW, message)]
    delays = {apply(message, make("delay", value="0.5"))[0][0] - NOW for _ in range(3)}
    assert all(0.0 <= delay <= 0.5 for delay in delays)


@pytest.mark.parametrize("message", [IMAGE, STATE])
def test_a_clock_jumps_or_runs_wrong(message):
    jumped = change(message, make("clock", value="-1"))
    assert (only(message, jumped), jumped.stamp) == ({"stamp"}, 98.5)
    drifted = change(message, make("drift", value="0.2"))
    assert drifted.stamp == pytest.approx(99.5 + 0.2 * 0.5)


@pytest.mark.parametrize(
    ("message", "field"),
    [
        *((IMAGE, field) for field in ("stamp", "position", "radius", "accel", "position_error")),
        *((STATE, field) for field in ("stamp", "q", "v")),
    ],
)
@pytest.mark.parametrize("value", ["nan", "inf"])
def test_a_number_is_set_in_one_field(message, field, value):
    changed = change(message, make("set", field=field, value=value))
    assert only(message, changed) == {field}
    found = getattr(changed, field)
    if isinstance(found, bytes):
        array = np.frombuffer(found)
        assert len(found) == len(getattr(message, field))
        assert not np.isfinite(array[0])
        assert np.isfinite(array[1:]).all()
    else:
        assert not math.isfinite(found)


def test_names_places_frames_and_lengths_are_wrong():
    assert change(IMAGE, make("exchange")).ids == ["b", "a"]
    assert change(STATE, make("exchange")).names == ["y", "x"]
    assert change(IMAGE, make("frame", field="shelf")).frame == "shelf"
    assert len(change(IMAGE, make("shorten")).position) == len(IMAGE.position) - 8
    assert len(change(STATE, make("shorten")).q) == len(STATE.q) - 8
    assert change(IMAGE, make("teleport", value="1"), 0) == IMAGE
    there = np.frombuffer(change(IMAGE, make("teleport", value="1"), 1).position)
    assert there.tolist() == [1.0, 1.0, 2.0, 3.0, 4.0, 5.0]


@pytest.fixture
def wire(tmp_path):
    """A disturbed publisher that is connected, and where its messages come in."""
    source = SocketInput(f"ipc://{tmp_path}/in")
    with DisturbedPublisher(source.address, "camera") as publisher:
        attend(source, lambda: publisher.wait(0.01))
        yield publisher, source
    source.close()


def receive(source, count):
    messages, deadline = [], time.monotonic() + PATIENCE
    while len(messages) < count:
        assert time.monotonic() < deadline
        data = source.receive()
        if data is None:
            time.sleep(0.001)
        else:
            messages.append(decode(data))
    return messages


def test_a_disturbance_strikes_in_its_time_and_one_message_at_least(wire):
    publisher, source = wire
    now = time.monotonic()
    publisher.disturbance = Disturbance(kind="drop", begin=now + 900.0, end=now + 1000.0)
    publisher.update([], 1.0, [])
    publisher.disturbance = Disturbance(kind="drop", begin=now, end=now + 1000.0)
    publisher.update([], 2.0, [])
    publisher.disturbance = Disturbance(kind="drop", begin=now - 2.0, end=now - 1.0)
    for stamp in (3.0, 4.0):
        publisher.update([], stamp, [])
    assert [(one.stamp, one.seq) for one in receive(source, 2)] == [(1.0, 1), (4.0, 4)]


def test_what_is_held_back_is_sent_when_its_time_has_come(wire):
    publisher, source = wire
    now = time.monotonic()
    publisher.disturbance = Disturbance(kind="swap", begin=now, end=now + 1000.0, value="500")
    publisher.update([], 1.0, [])
    publisher.update([], 2.0, [])
    assert [one.seq for one in receive(source, 1)] == [2]
    publisher.flush(now + 2000.0)
    assert [one.seq for one in receive(source, 1)] == [1]
