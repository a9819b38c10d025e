import itertools
import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import HOME, STILL, panda

from armguard.joint_glance import NOBODY, find_runaway
from armguard.joint_states import JointStates
from armguard.verdict import ReasonKind

TIMEOUT = 0.05
MALFORMED = ReasonKind.JOINT_STATE_MALFORMED
BEYOND = ReasonKind.JOINT_STATE_BEYOND_LIMITS
JUMPED = ReasonKind.JOINT_STATE_JUMPED
GAP = ReasonKind.JOINT_STATE_GAP
BACKWARDS = ReasonKind.TIME_BACKWARDS


@pytest.fixture
def states():
    return JointStates(panda(), TIMEOUT)


def changed(vector, joint, value):
    vector = vector.copy()
    vector[joint] = value
    return vector


def kind_of(reason):
    return None if reason is None else reason.kind


@pytest.mark.parametrize(
    "wrap", [np.array, list, tuple, lambda a: np.array(a)[::-1][::-1], lambda a: np.float32(a)]
)
def test_numbers_are_taken_in_any_container(states, wrap):
    assert states.receive(1.0, wrap(HOME), wrap(STILL), 1.0) is None
    assert states.q == pytest.approx(HOME, rel=1e-6)
    assert states.receive(1.001, wrap(HOME), [0] * 7, 1.001) is None


def test_what_is_taken_is_a_copy(states):
    q = HOME.copy()
    states.receive(1.0, q, STILL, 1.0)
    q += 9.0
    assert (states.q == HOME).all()


@pytest.mark.parametrize(
    "bad",
    [
        None,
        "0000000",
        b"0000000",
        ["0"] * 7,
        [None] * 7,
        3.0,
        [],
        [0.0] * 6,
        [0.0] * 8,
        np.zeros((7, 1)),
        np.zeros((1, 7)),
        [[0.0], [0.0, 1.0]],
        [1j] * 7,
        np.zeros(7, dtype=complex),
        [True] * 7,
        [10**400] * 7,
        [Fraction(1, 3)] * 7,
        {"q": 1.0},
        pytest.param(object(), id="object"),
        np.array(["2026-01-01"] * 7, dtype="datetime64[D]"),
        np.ma.masked_array(np.zeros(7), mask=[0, 0, 1, 0, 0, 0, 0]),
        np.ma.masked_array([None] * 7),
    ],
    ids=lambda bad: repr(bad)[:30],
)
def test_what_is_no_vector_of_numbers(states, bad):
    for q, v in ((bad, STILL), (HOME, bad)):
        assert kind_of(states.receive(1.0, q, v, 1.0)) is MALFORMED


class Explosive:
    def __array__(self, *_, **__):
        raise RuntimeError("no array today")


def test_an_object_that_raises_is_no_vector(states):
    assert kind_of(states.receive(1.0, Explosive(), STILL, 1.0)) is MALFORMED


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("joint", range(7))
def test_a_number_that_is_not_finite_names_its_joint(states, bad, joint):
    for q, v, name in (
        (changed(HOME, joint, bad), STILL, "q"),
        (HOME, changed(STILL, joint, bad), "v"),
    ):
        reason = states.receive(1.0, q, v, 1.0)
        assert reason.kind is MALFORMED
        assert reason.subject == panda().joints[joint]
        assert name in reason.detail
        assert np.isfinite(states.q).all()
        assert np.isfinite(states.v).all()


@pytest.mark.parametrize(("joint", "sign"), list(itertools.product(range(7), (1.0, -1.0))))
def test_limits_hold_up_to_their_errors_and_no_further(joint, sign):
    robot = panda()
    edges = robot.upper_position_limit if sign > 0.0 else robot.lower_position_limit
    error = robot.position_error[joint]
    fastest = robot.velocity_limit[joint] + robot.velocity_error[joint]
    for share, expected in ((0.999, None), (1.001, BEYOND)):
        q = changed(HOME, joint, edges[joint] + sign * share * error)
        reason = JointStates(robot, TIMEOUT).receive(0.0, q, STILL, 0.0)
        assert kind_of(reason) is expected
        v = changed(STILL, joint, sign * fastest * (1.0 + (share - 1.0) * 1e-6))
        fast = JointStates(robot, TIMEOUT).receive(0.0, HOME, v, 0.0)
        assert kind_of(fast) is expected
        for found in (reason, fast):
            assert found is None or found.subject == robot.joints[joint]


def test_stamps_never_run_backwards_but_may_stand(states):
    assert states.receive(1.0, HOME, STILL, 1.0) is None
    assert states.receive(1.0, HOME, STILL, 1.001) is None
    earlier = math.nextafter(1.0, 0.0)
    assert kind_of(states.receive(earlier, HOME, STILL, 1.002)) is BACKWARDS


@pytest.mark.parametrize("start", [0.0, 5.0, 1.7e9, -3.0])
def test_a_gap_between_stamps(start):
    for share, expected in ((0.99, None), (1.01, GAP)):
        states = JointStates(panda(), TIMEOUT)
        assert states.receive(start, HOME, STILL, start) is None
        later = start + share * TIMEOUT
        assert kind_of(states.receive(later, HOME, STILL, later)) is expected


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_age_of_a_state_either_way(sign):
    for share, expected in ((0.99, None), (1.01, GAP)):
        states = JointStates(panda(), TIMEOUT)
        now = 1.0 + sign * share * TIMEOUT
        assert kind_of(states.receive(1.0, HOME, STILL, now)) is expected


def test_a_stamp_that_stands_grows_old(states):
    found = [states.receive(1.0, HOME, STILL, 1.0 + 0.012 * i) for i in range(6)]
    assert [kind_of(reason) for reason in found] == [None] * 5 + [GAP]


def test_jumps_that_limits_do_not_allow(states):
    robot = panda()
    assert states.receive(0.0, HOME, STILL, 0.0) is None
    farther = HOME[2] + 2.0 * robot.position_error[2] + robot.velocity_limit[2] * 0.001 + 1e-6
    reason = states.receive(0.001, changed(HOME, 2, farther), STILL, 0.001)
    assert reason.kind is JUMPED
    assert reason.subject == robot.joints[2]
    states.reset()
    assert states.receive(0.0, HOME, STILL, 0.0) is None
    faster = robot.acceleration_limit[4] * 0.001 + 2.0 * robot.velocity_error[4] + 1e-6
    reason = states.receive(0.001, HOME, changed(STILL, 4, faster), 0.001)
    assert reason.kind is JUMPED
    assert reason.subject == robot.joints[4]


def test_a_refused_state_is_no_history(states):
    assert states.receive(0.0, HOME, STILL, 0.0) is None
    assert kind_of(states.receive(0.001, HOME + 0.5, STILL, 0.001)) is JUMPED
    assert states.receive(0.002, HOME, STILL, 0.002) is None


def test_a_reset_forgets_states_and_stamps(states):
    assert states.receive(10.0, HOME, STILL, 10.0) is None
    states.reset()
    assert states.receive(1.0, HOME + 0.5, STILL, 1.0) is None
    states.reset()
    assert states.receive(100.0, HOME - 0.5, STILL, 100.0) is None


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
        assert states.receive(stamp, read_q, read_v, stamp) is None


def plain_stopping(q, v):
    """The rule as it is written down, joint by joint, in exact numbers."""
    robot = panda()
    for j in range(7):
        accel, error = Fraction(robot.acceleration_limit[j]), Fraction(robot.velocity_error[j])
        for sign, edge in ((1, robot.upper_position_limit[j]), (-1, robot.lower_position_limit[j])):
            speed = max(sign * Fraction(v[j]) + error, Fraction(0))
            room = sign * (Fraction(edge) - Fraction(q[j])) + Fraction(robot.position_error[j])
            if speed * speed > 2 * accel * room:
                yield robot.joints[j]


@settings(deadline=None)
@given(
    st.lists(st.floats(0.0, 1.0), min_size=7, max_size=7),
    st.lists(st.floats(-1.0, 1.0), min_size=7, max_size=7),
)
def test_a_joint_that_cannot_stop_in_time_is_told(places, speeds):
    robot = panda()
    q = robot.lower_position_limit + np.array(places) * (
        robot.upper_position_limit - robot.lower_position_limit
    )
    v = np.array(speeds) * robot.velocity_limit
    states = JointStates(robot, TIMEOUT)
    assert states.receive(0.0, q, v, 0.0) is None
    reason = states.stopping()
    running = list(plain_stopping(q, v))
    assert (reason is None) == (not running)
    if reason is not None:
        assert reason.kind is ReasonKind.JOINT_STOP_AHEAD
        assert reason.subject == running[0]


def test_a_joint_without_stops_runs_into_none():
    q, v = np.zeros(1), np.array([5.0])
    endless = np.full(1, np.inf)
    assert find_runaway(q, v, -endless, endless, np.zeros(1), np.ones(1)) == NOBODY
