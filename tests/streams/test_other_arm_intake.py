import math

import pytest

from armguard.obstacles import FaultKind
from armguard.streams import StampClock
from armguard.streams.stamp_clocks import HELD_UP
from support.stream_messages import (
    MONOTONIC,
    joints,
    obstacles,
    plan,
    two_arms,
)


def test_joint_states_go_to_the_arm_that_they_name():
    world, told = two_arms()
    state = {"names": ["tip", "base"], "q": [0.2, 0.1], "v": [0.4, 0.3]}
    world.send(joints(arm="left"), joints(arm="right", **state))
    assert world.edge.joints.state.q.tolist() == [1.0, 2.0]
    ((stamp, q, v),) = told
    assert stamp == pytest.approx(5.0, abs=1e-6)
    assert stamp <= world.clock.now()
    assert (q.tolist(), v.tolist()) == ([0.1, 0.2], [0.3, 0.4])
    assert world.faults.total == 0


def test_of_several_states_of_another_arm_each_is_told():
    world, told = two_arms()
    names = {"arm": "right", "names": ["base", "tip"], "v": [0.0, 0.0]}
    states = [[0.1, 0.0], [math.nan, 0.0], [0.2, 0.0], [0.3, 0.0]]
    world.send(*(joints(q=q, **names) for q in states))
    nan = pytest.approx(math.nan, nan_ok=True)
    assert [q[0] for _, q, _ in told] == [0.1, nan, 0.2, 0.3]
    assert world.kinds() == ["not finite"]


def other_state(ahead):
    state = {"names": ["base", "tip"], "q": [0.0, 0.0], "v": [0.0, 0.0]}
    return joints(arm="right", stamp=MONOTONIC + 5.0 + ahead, **state)


def test_a_state_of_another_arm_that_is_ahead_by_the_clock_error_counts_as_of_now():
    world, told = two_arms(joint_clock=StampClock("monotonic", 0.0, 0.01))
    world.send(other_state(0.009))
    assert told[0][0] == 5.0
    assert world.kinds() == ["stamp ahead"]
    assert world.obstacles.fault_count == 0


@pytest.mark.hazard("H-18")
@pytest.mark.parametrize("ahead", [0.011, 3600.0, math.inf])
def test_a_state_of_another_arm_from_the_future_is_none_and_reaches_the_verdict(ahead):
    world, told = two_arms(joint_clock=StampClock("monotonic", 0.0, 0.01))
    world.send(other_state(ahead))
    assert told == []
    assert "stamp ahead" in world.kinds()
    (fault,) = world.obstacles.take_faults()
    assert (fault.kind, fault.source) == (FaultKind.MALFORMED, "right")
    assert f"{ahead:.3g} s ahead" in fault.value


def test_a_malformed_state_of_another_arm_and_obstacles_in_its_name_reach_the_verdict():
    world, told = two_arms()
    world.send(joints(arm="right"), obstacles(source="right"))
    assert not told
    assert len(world.obstacles) == 0
    assert [fault.kind for fault in world.obstacles.take_faults()] == [FaultKind.MALFORMED] * 2


def test_a_plan_that_is_shared_goes_to_the_other_arms_and_is_no_question():
    world, told = two_arms(joint_clock=StampClock("monotonic", 0.03, 0.01))
    shared = plan(ask="share", until=MONOTONIC + 5.5, names=["tip", "base"])
    shared |= {"q": [[0.0, 0.1], [0.2, 0.3]], "velocity_tracking_error": [0.4, 0.5]}
    world.send(shared | {"arm": "right"}, shared | {"arm": "left"})
    ((request, until, clock_error),) = told
    assert request.stamp == pytest.approx(5.0, abs=1e-6)
    assert until == pytest.approx(5.5, abs=1e-6)
    assert clock_error == pytest.approx(0.04 + HELD_UP), "joint states may be younger by latency"
    assert request.q.tolist() == [[0.1, 0.0], [0.3, 0.2]]
    assert request.velocity_tracking_error.tolist() == [0.5, 0.4]
    assert world.edge.requests.plans == []
    assert world.faults.total == 0


@pytest.mark.parametrize("named", [{}, {"arm": "middle"}, {"arm": "right", "names": ["tip"]}])
def test_a_plan_that_no_other_arm_can_share_is_counted(named):
    world, told = two_arms()
    world.send(plan(ask="share", until=MONOTONIC + 5.5) | named)
    assert told == []
    assert world.kinds() == ["malformed"]


def test_nothing_is_promised_by_arrival():
    world, told = two_arms(joint_clock=StampClock("arrival", 0.03))
    shared = plan(ask="share", until=MONOTONIC + 5.5, names=["tip", "base"])
    shared |= {"q": [[0.0, 0.1], [0.2, 0.3]], "velocity_tracking_error": [0.4, 0.5]}
    world.send(shared | {"arm": "right"})
    assert told == []
    assert world.kinds() == ["plan refused"]
