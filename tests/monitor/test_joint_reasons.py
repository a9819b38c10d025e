import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from armguard.monitor.joint_reasons import describe_runaway
from armguard.robot import JointStates, Robot
from armguard.verdict import ReasonKind
from support.joint_states import TIMEOUT, changed, kind_of, receive
from support.panda_monitor import HOME, STILL, panda

MALFORMED = ReasonKind.JOINT_STATE_MALFORMED
BEYOND = ReasonKind.JOINT_STATE_BEYOND_LIMITS
JUMPED = ReasonKind.JOINT_STATE_JUMPED


@pytest.fixture
def states():
    return JointStates(panda(), TIMEOUT)


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
        assert kind_of(receive(states, 1.0, q, v, 1.0)) is MALFORMED


class Explosive:
    def __array__(self, *_, **__):
        raise RuntimeError("no array today")


def test_an_object_that_raises_is_no_vector(states):
    assert kind_of(receive(states, 1.0, Explosive(), STILL, 1.0)) is MALFORMED


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("joint", range(7))
def test_a_number_that_is_not_finite_names_its_joint(states, bad, joint):
    for q, v, name in (
        (changed(HOME, joint, bad), STILL, "q"),
        (HOME, changed(STILL, joint, bad), "v"),
    ):
        reason = receive(states, 1.0, q, v, 1.0)
        assert reason.kind is MALFORMED
        assert reason.subject == panda().joints[joint]
        assert name in reason.detail
        assert np.isfinite(states.q).all()
        assert np.isfinite(states.v).all()


@pytest.mark.parametrize(
    ("q", "v", "stamp", "said"),
    [
        (HOME, changed(STILL, 5, 0.31), 0.001, "changed its velocity by 0.31 rad/s in 1 ms, limit"),
        (changed(HOME, 5, 1.7), STILL, 0.001, "moved by 0.1 rad in 1 ms, limit"),
        (changed(HOME, 5, 1.61), changed(STILL, 5, 0.2), 0.03, "deviated from its motion by"),
    ],
)
def test_a_jump_is_told_in_numbers(states, q, v, stamp, said):
    robot = panda()
    assert receive(states, 0.0, HOME, STILL, 0.0) is None
    for k in range(1, 30):
        if stamp > 0.02:
            assert receive(states, k * 0.001, HOME, STILL, k * 0.001) is None
    reason = receive(states, stamp, q, v, stamp)
    assert reason.subject == robot.joints[5]
    if "motion" not in said:
        assert reason.detail.startswith(said)
        rate = robot.acceleration_limit[5] if "velocity" in said else robot.velocity_limit[5]
        error = robot.velocity_error[5] if "velocity" in said else robot.position_error[5]
        limit = float(reason.detail.split("limit ")[1].split()[0])
        assert limit == pytest.approx(rate * 0.001 + 2.0 * error, rel=0.01)
        assert reason.detail.endswith("rad/s" if "velocity" in said else "rad")
    else:
        assert reason.kind is JUMPED


def test_a_joint_that_slides_is_told_in_metres():
    robot = Robot.load("tiago")
    assert robot.joints[0] == "torso_lift_joint"
    middle = 0.5 * (robot.lower_position_limit + robot.upper_position_limit)
    still = np.zeros(len(robot.joints))
    states = JointStates(robot, TIMEOUT)
    assert receive(states, 0.0, middle, still, 0.0) is None
    reason = receive(states, 0.001, changed(middle, 0, middle[0] + 0.05), still, 0.001)
    assert "moved by 0.05 m in 1 ms, limit" in reason.detail
    assert reason.detail.endswith(" m")
    reason = receive(states, 0.001, middle, changed(still, 0, 9.0), 0.001)
    assert reason.kind is BEYOND
    assert "9 m/s" in reason.detail


def test_numbers_that_differ_look_different(states):
    robot = panda()
    edge = robot.velocity_limit[0] + robot.velocity_error[0]
    reason = receive(states, 0.0, HOME, changed(STILL, 0, edge * (1.0 + 1e-9)), 0.0)
    found, limit = reason.detail.split(" is ")[1].split()[0], reason.detail.split()[-2]
    assert float(found) > float(limit)


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
    assert receive(states, 0.0, q, v, 0.0) is None
    reason = describe_runaway(states)
    running = list(plain_stopping(q, v))
    assert (reason is None) == (not running)
    if reason is not None:
        assert reason.kind is ReasonKind.JOINT_STOP_AHEAD
        assert reason.subject == running[0]
