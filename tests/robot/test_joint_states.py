import itertools
import math

import numpy as np
import pytest

from armguard.robot import JointStates
from armguard.robot.joint_acceptance import NO_JOINT, find_runaway
from armguard.verdict import ReasonKind
from support.joint_states import TIMEOUT, changed, kind_of, receive
from support.panda_monitor import HOME, STILL, panda

MALFORMED = ReasonKind.JOINT_STATE_MALFORMED
BEYOND = ReasonKind.JOINT_STATE_BEYOND_LIMITS
JUMPED = ReasonKind.JOINT_STATE_JUMPED
GAP = ReasonKind.JOINT_STATE_GAP
BACKWARDS = ReasonKind.TIME_BACKWARDS


@pytest.fixture
def states():
    return JointStates(panda(), TIMEOUT)


@pytest.mark.hazard("H-17")
@pytest.mark.parametrize(("joint", "sign"), list(itertools.product(range(7), (1.0, -1.0))))
def test_limits_hold_up_to_their_errors_and_no_further(joint, sign):
    robot = panda()
    edges = robot.upper_position_limit if sign > 0.0 else robot.lower_position_limit
    error = robot.position_error[joint]
    fastest = robot.velocity_limit[joint] + robot.velocity_error[joint]
    for share, expected in ((0.999, None), (1.001, BEYOND)):
        q = changed(HOME, joint, edges[joint] + sign * share * error)
        reason = receive(JointStates(robot, TIMEOUT), 0.0, q, STILL, 0.0)
        assert kind_of(reason) is expected
        v = changed(STILL, joint, sign * fastest * (1.0 + (share - 1.0) * 1e-6))
        fast = receive(JointStates(robot, TIMEOUT), 0.0, HOME, v, 0.0)
        assert kind_of(fast) is expected
        for found in (reason, fast):
            assert found is None or found.subject == robot.joints[joint]


def snapshot_of(states):
    guard = states.guard
    kept = guard.q, guard.v, guard.heard, guard.standing, *guard.history
    return [array.copy() for array in kept]


REFUSED = {
    "no array": (0.002, None, STILL, 0.002),
    "short": (0.002, HOME[:6], STILL, 0.002),
    "not finite": (0.002, changed(HOME, 6, math.nan), STILL, 0.002),
    "v not finite": (0.002, HOME, changed(STILL, 6, math.inf), 0.002),
    "beyond limits": (0.002, changed(HOME, 6, 99.0), STILL, 0.002),
    "too fast": (0.002, HOME, changed(STILL, 6, 99.0), 0.002),
    "backwards": (0.0, HOME, STILL, 0.002),
    "old": (0.002, HOME, STILL, 0.06),
    "far ahead": (1e9, HOME, STILL, 0.002),
    "jumped": (0.002, changed(HOME, 6, 1.0), STILL, 0.002),
    "jumped in velocity": (0.002, HOME, changed(STILL, 6, 1.0), 0.002),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_refused_state_leaves_nothing_behind(states, name):
    """Neither in what others read, nor in what the next one is held against."""
    assert receive(states, 0.001, HOME, STILL, 0.001) is None
    before = snapshot_of(states)
    assert receive(states, *REFUSED[name]) is not None
    for kept, now in zip(before, snapshot_of(states), strict=True):
        assert np.array_equal(kept, now)
    assert receive(states, 0.003, HOME, STILL, 0.003) is None


def test_a_gap_is_one_fault(states):
    """What comes after it is held against what was believed before, but is no gap again."""
    assert receive(states, 1.0, HOME, STILL, 1.0) is None
    q = HOME + 0.01
    assert kind_of(receive(states, 1.2, q, STILL, 1.2)) is GAP
    assert (states.q == HOME).all()
    again = receive(states, 1.2, q, STILL, 1.201)
    assert again is None
    assert (states.q == q).all()
    assert kind_of(receive(states, 1.3, q + 1.0, STILL, 1.3)) is GAP
    assert kind_of(receive(states, 1.301, q + 1.0, STILL, 1.301)) is JUMPED


@pytest.mark.parametrize("way", [-1.0, 1.0])
def test_a_joint_runs_into_its_stop_if_it_may_be_as_fast_as_its_error_allows(way):
    """At 0.5 rad/s, right to 0.1 rad/s, it needs 0.6² / 2a to stop short of it."""
    guard = JointStates(panda(), TIMEOUT).guard._replace(
        lower=np.full(1, -1.0), upper=np.full(1, 1.0), velocity_error=np.full(1, 0.1),
        acceleration_limit=np.ones(1),
    )  # fmt: skip
    for spare, found in ((1e-9, NO_JOINT), (-1e-9, 0)):
        q = way * np.full(1, 1.0 - 0.18 - spare)
        assert find_runaway(guard, q, way * np.full(1, 0.5)) == found
    # One that reads as if it came back may go on.
    at_stop = way * np.full(1, 1.0 - 1e-9)
    assert find_runaway(guard, at_stop, -way * np.full(1, 0.05)) == 0
    assert find_runaway(guard, at_stop, -way * np.full(1, 0.11)) == NO_JOINT
