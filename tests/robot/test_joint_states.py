import itertools
import math

import numpy as np
import pytest

from armguard.jit import pack
from armguard.robot import JointStates
from armguard.robot.joint_acceptance import NO_JOINT, find_runaway
from armguard.robot.portable import LIMITS
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


@pytest.mark.parametrize(
    "wrap", [np.array, list, tuple, lambda a: np.array(a)[::-1][::-1], lambda a: np.float32(a)]
)
def test_numbers_are_taken_in_any_container(states, wrap):
    assert receive(states, 1.0, wrap(HOME), wrap(STILL), 1.0) is None
    assert states.q == pytest.approx(HOME, rel=1e-6)
    assert receive(states, 1.001, wrap(HOME), [0] * 7, 1.001) is None


def test_what_is_taken_is_a_copy(states):
    q = HOME.copy()
    receive(states, 1.0, q, STILL, 1.0)
    q += 9.0
    assert (states.q == HOME).all()


def test_limits_of_less_precision_need_no_kernels_of_their_own(monkeypatch):
    expected = pack(JointStates(panda(), TIMEOUT).guard).kind
    for name in LIMITS:  # other tests share the robot
        monkeypatch.setattr(panda(), name, np.float32(getattr(panda(), name)))
    states = JointStates(panda(), TIMEOUT)
    assert pack(states.guard).kind is expected
    assert states.guard.fastest == pytest.approx(
        np.float64(panda().velocity_limit) + np.float64(panda().velocity_error), rel=1e-15
    )


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


def test_stamps_never_run_backwards_but_may_stand(states):
    assert receive(states, 1.0, HOME, STILL, 1.0) is None
    assert receive(states, 1.0, HOME, STILL, 1.001) is None
    earlier = math.nextafter(1.0, 0.0)
    assert kind_of(receive(states, earlier, HOME, STILL, 1.002)) is BACKWARDS


@pytest.mark.parametrize("start", [0.0, 5.0, 1.7e9, -3.0])
def test_a_gap_between_stamps(start):
    for share, expected in ((0.99, None), (1.01, GAP)):
        states = JointStates(panda(), TIMEOUT)
        assert receive(states, start, HOME, STILL, start) is None
        later = start + share * TIMEOUT
        assert kind_of(receive(states, later, HOME, STILL, later)) is expected


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_age_of_a_state_either_way(sign):
    for share, expected in ((0.99, None), (1.01, GAP)):
        states = JointStates(panda(), TIMEOUT)
        now = 1.0 + sign * share * TIMEOUT
        assert kind_of(receive(states, 1.0, HOME, STILL, now)) is expected


def test_a_stamp_that_stands_grows_old(states):
    found = [receive(states, 1.0, HOME, STILL, 1.0 + 0.012 * i) for i in range(6)]
    assert [kind_of(reason) for reason in found] == [None] * 5 + [GAP]


def test_jumps_that_limits_do_not_allow(states):
    robot = panda()
    assert receive(states, 0.0, HOME, STILL, 0.0) is None
    farther = HOME[2] + 2.0 * robot.position_error[2] + robot.velocity_limit[2] * 0.001 + 1e-6
    reason = receive(states, 0.001, changed(HOME, 2, farther), STILL, 0.001)
    assert reason.kind is JUMPED
    assert reason.subject == robot.joints[2]
    states.reset()
    assert receive(states, 0.0, HOME, STILL, 0.0) is None
    faster = robot.acceleration_limit[4] * 0.001 + 2.0 * robot.velocity_error[4] + 1e-6
    reason = receive(states, 0.001, HOME, changed(STILL, 4, faster), 0.001)
    assert reason.kind is JUMPED
    assert reason.subject == robot.joints[4]


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


def test_a_refused_state_is_no_history(states):
    assert receive(states, 0.0, HOME, STILL, 0.0) is None
    assert kind_of(receive(states, 0.001, HOME + 0.5, STILL, 0.001)) is JUMPED
    assert receive(states, 0.002, HOME, STILL, 0.002) is None


def test_a_reset_forgets_states_and_stamps(states):
    assert receive(states, 10.0, HOME, STILL, 10.0) is None
    states.reset()
    assert receive(states, 1.0, HOME + 0.5, STILL, 1.0) is None
    states.reset()
    assert receive(states, 100.0, HOME - 0.5, STILL, 100.0) is None


def test_feasible_motion_is_believed():
    """Bang-bang within the limits, read with errors as large as they may be."""
    robot, rng, states = panda(), np.random.default_rng(1), JointStates(panda(), TIMEOUT)
    q, v, accel = HOME.copy(), STILL.copy(), STILL.copy()
    room = np.minimum(robot.upper_position_limit - HOME, HOME - robot.lower_position_limit)
    reach = np.minimum(0.8 * room, 1.0)
    for i in range(3000):
        if i % 50 == 0:
            accel = robot.acceleration_limit * rng.choice([-1.0, 1.0], 7)
        # Turn back towards home where the allowed room ends.
        braking = v * np.abs(v) / (2.0 * robot.acceleration_limit)
        away = np.abs(q - HOME + braking) > 0.5 * reach
        accel = np.where(away, -np.sign(q - HOME + braking) * robot.acceleration_limit, accel)
        faster = np.clip(v + accel * 1e-3, -0.5 * robot.velocity_limit, 0.5 * robot.velocity_limit)
        q += 0.5 * (v + faster) * 1e-3
        v = faster
        read_q = q + rng.uniform(-1.0, 1.0, 7) * robot.position_error
        read_v = v + rng.uniform(-1.0, 1.0, 7) * robot.velocity_error
        stamp = 1.7e9 + i * 1e-3
        assert receive(states, stamp, read_q, read_v, stamp) is None


@pytest.mark.parametrize("way", [-1.0, 1.0])
def test_a_joint_runs_into_its_stop_if_it_may_be_as_fast_as_its_error_allows(way):
    """At 0.5 rad/s, right to 0.1 rad/s, it needs 0.6² / 2a to stop short of it."""
    lower, upper, error, accel = np.full(1, -1.0), np.full(1, 1.0), np.full(1, 0.1), np.ones(1)
    for spare, found in ((1e-9, NO_JOINT), (-1e-9, 0)):
        q = way * np.full(1, 1.0 - 0.18 - spare)
        assert find_runaway(q, way * np.full(1, 0.5), lower, upper, error, accel) == found
    # One that reads as if it came back may go on.
    at_stop = way * np.full(1, 1.0 - 1e-9)
    assert find_runaway(at_stop, -way * np.full(1, 0.05), lower, upper, error, accel) == 0
    assert find_runaway(at_stop, -way * np.full(1, 0.11), lower, upper, error, accel) == NO_JOINT


def test_a_joint_without_stops_runs_into_none():
    q, v = np.zeros(1), np.array([5.0])
    endless = np.full(1, np.inf)
    assert find_runaway(q, v, -endless, endless, np.zeros(1), np.ones(1)) == NO_JOINT
