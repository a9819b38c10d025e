import math
import re

import numpy as np
import pytest

from armguard.messages.incoming import decode
from armguard.streams import StampClock
from armguard.streams.joint_intake import JointOrder
from support.stream_messages import (
    JOINTS,
    MONOTONIC,
    UNIX,
    World,
    joints,
    make_held_up_world,
    obstacles,
    pack,
)


@pytest.mark.parametrize(("holds", "is_taken"), [([0.008] * 100, False), ([0.008] * 3, True)])
def test_a_joint_state_is_dated_to_microseconds_or_refused(holds, is_taken):
    world = make_held_up_world(joint_clock=StampClock("unix"), drain_time=math.inf)
    world.clock.holds = [0.0, *holds]
    world.send(joints(stamp=UNIX + 4.999))
    if is_taken:
        assert 4.999 - 60e-6 <= world.edge.joints.state.stamp <= 4.999 + 3e-7
        assert world.faults.total == 0
    else:
        assert world.edge.joints.state is None
        assert world.kinds() == ["clocks held up"]
    assert len(world.clock.readings) < 30


@pytest.mark.parametrize("field", ["q", "v"])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_an_impossible_joint_state_is_not_hidden_by_a_good_one_after_it(field, value):
    world = World()
    good = [joints(stamp=MONOTONIC + later) for later in (5.001, 5.0015)]
    world.send(joints(**{field: [value, 0.0, -value]}), *good)
    assert not math.isfinite(getattr(world.edge.joints.state, field)[1])
    assert world.kinds() == ["not finite"]
    world.send(joints(stamp=MONOTONIC + 5.002))
    assert world.edge.joints.state.q.tolist() == [1.0, 2.0]


def test_joint_stamps_that_go_back_are_told():
    world = World()
    world.send(joints(), joints(stamp=MONOTONIC + 4.0))
    assert world.kinds() == ["stamp went back"]


def test_a_backlog_at_the_start_is_dropped_and_counted():
    world = World(joint_timeout=0.05)
    old = [joints(stamp=MONOTONIC + 5.0 - age, seq=n) for n, age in enumerate([8.0, 0.2, 0.051])]
    world.send(*old)
    assert world.edge.joints.state is None
    assert world.edge.joints.dropped_age == pytest.approx(0.051)
    assert world.faults.count("backlog") == 3
    assert "joints message 0: joint state is 8 s old, expected at most 0.05 s" in world.lines[0]
    # Obstacles of a backlog are states of some time ago, and go through.
    world.send(obstacles(stamp=MONOTONIC + 1.0))
    assert world.stamp() == pytest.approx(1.0)
    world.send(joints(stamp=MONOTONIC + 4.96, seq=3))
    assert world.edge.joints.state.stamp == pytest.approx(4.96)
    # From here on a state that is old is the monitor's business, whatever it says.
    world.clock.sleep_until(5.5)
    world.send(joints(stamp=MONOTONIC + 4.97, seq=4))
    assert world.edge.joints.state.stamp == pytest.approx(4.97)
    assert world.faults.total == 3


@pytest.mark.parametrize("rate", [1000.0, 500.0, 250.0])
@pytest.mark.parametrize("seconds", [0.055, 0.2, 8.0])
def test_the_first_joint_states_after_a_backlog_leave_no_gap(rate, seconds):
    """The first that is taken is fresh, and none after it is a gap: both would latch."""
    world = World(joint_timeout=0.05)
    waiting, number = int(seconds * rate), 0
    taken = []
    for tick in range(400):
        now = 5.0 + 0.001 * tick
        world.clock.sleep_until(now)
        while number / rate <= seconds + 0.001 * tick:
            stamp = MONOTONIC + 5.0 - seconds + number / rate
            world.input.waiting.append(pack(joints(stamp=stamp, seq=number)))
            number += 1
        before = world.edge.received
        end = world.edge.drain([world.input])
        assert world.edge.received - before <= 64
        if world.edge.joints.state is not None:
            taken.append(world.edge.joints.state.stamp)
            assert end - taken[-1] <= 0.05
    assert len(taken) > 100
    assert np.diff(taken).max() <= 0.05
    # Those that were sent while the backlog was worked off may have grown old, too.
    assert waiting - 51 <= world.faults.count("backlog") <= waiting + 150


def test_a_state_that_becomes_stale_in_its_drain_is_no_beginning():
    world = make_held_up_world(joint_timeout=0.05, drain_time=math.inf)
    world.clock.holds = [0.0, 0.2]  # between its message and the end of the drain
    world.send(joints(stamp=MONOTONIC + 4.999))
    assert world.edge.joints.state is None
    assert world.kinds() == ["backlog"]
    world.send(joints(stamp=MONOTONIC + 5.2))
    assert world.edge.joints.state.stamp == pytest.approx(5.2)


def test_a_joint_state_at_the_start_whose_time_is_no_number_is_for_the_monitor_to_refuse():
    world = World(joint_timeout=0.05)
    world.send(joints(stamp=math.nan))
    assert math.isnan(world.edge.joints.state.stamp)
    assert world.kinds() == ["not finite"]


@pytest.mark.parametrize("age", [0.01, 3.0])
def test_after_a_reset_a_stale_joint_state_is_none(age):
    """The controller may come back after the reset: what it said before would latch again."""
    world = World(joint_timeout=0.05, reset_token="sesame")
    world.send(joints())
    world.clock.sleep_until(5.0 + age)
    world.send({"type": "reset", "token": "sesame"})
    assert world.edge.requests.is_reset
    assert (world.edge.joints.state is None) == (age > 0.05)
    world.edge.requests.is_reset = False
    world.send(joints(stamp=MONOTONIC + 5.0 + age))
    assert world.edge.joints.state.stamp == pytest.approx(5.0 + age)
    assert world.faults.total == 0


def test_joint_names_in_any_order_with_extras():
    world = World()
    world.send(joints())
    state = world.edge.joints.state
    assert state.q.tolist() == [1.0, 2.0]
    assert state.v.tolist() == [0.1, 0.2]
    assert state.stamp == pytest.approx(5.0)
    packed = joints(names=JOINTS, q=np.array([3.0, 4.0]).tobytes(), v=[0.0, 0.0])
    world.send(packed)
    assert world.edge.joints.state.q.tolist() == [3.0, 4.0]
    assert world.faults.total == 0


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"names": ["elbow", "gripper", "wrist"]}, "'shoulder' .missing"),
        ({"names": ["elbow", "elbow", "shoulder"]}, "'elbow' .named twice"),
        ({"names": []}, "missing"),
        ({"q": [1.0, 2.0]}, "q is 2 values"),
        ({"v": b"\0" * 9}, "v is 9 bytes"),
    ],
)
def test_joints_that_do_not_fit_are_refused_by_name(changes, text):
    world = World()
    world.send(joints(seq=3, **changes))
    assert world.edge.joints.state is None
    assert world.kinds() == ["malformed"]
    assert "joints message 3" in world.lines[0]
    assert re.search(text, world.lines[0])


def read(order, message):
    """Values as a list, each of which may be written."""
    q, v = order.read(message)
    assert q.flags.writeable
    assert v.flags.writeable
    return [q.tolist(), v.tolist()]


@pytest.mark.parametrize("is_packed", [True, False])
def test_values_stand_in_the_order_of_the_joints_however_they_are_written(is_packed):
    write = (lambda values: np.array(values).tobytes()) if is_packed else list
    message = decode(pack(joints(q=write([2.0, 9.0, 1.0]), v=write([0.2, 0.9, 0.1]))))
    order = JointOrder(JOINTS)
    assert read(order, message) == [[1.0, 2.0], [0.1, 0.2]]
    # A sender may change its order.
    turned = decode(pack(joints(names=JOINTS, q=write([3.0, 4.0]), v=write([0.3, 0.4]))))
    assert read(order, turned) == [[3.0, 4.0], [0.3, 0.4]]
    assert read(order, message) == [[1.0, 2.0], [0.1, 0.2]]
