"""A first look at joint states must say what the closer one would."""

import math

import numpy as np
import pytest
from scenes import HOME, STILL, panda

from armguard.joint_glance import BELIEVED, DOUBTFUL, FAST, RUNAWAY
from armguard.joint_states import JointStates

PERIOD, TIMEOUT, HORIZON, REACTION, DELAY = 1e-3, 0.05, 0.003, 0.02, 0.4


def make_states():
    states = JointStates(panda(), TIMEOUT, HORIZON, REACTION)
    states.delay_braking(DELAY)
    return states


@pytest.fixture
def states():
    states = make_states()
    assert states.receive(0.0, HOME, STILL, 0.0) is None
    return states


def test_before_the_first_state_there_is_nothing_to_compare_with():
    states = make_states()
    assert states.glance(0.0, HOME, STILL, 0.0) == (DOUBTFUL, math.inf, math.inf)
    for timeout in (TIMEOUT, math.inf):
        states = JointStates(panda(), timeout)
        assert states.glance(1e9, HOME, STILL, 1e9)[0] == DOUBTFUL


def test_a_usual_state_is_taken_with_both_stop_times(states):
    v = 0.2 * panda().velocity_limit
    v = np.minimum(v, panda().acceleration_limit * PERIOD)
    found, soon, late = states.glance(PERIOD, HOME, v, PERIOD)
    assert found == BELIEVED
    assert (soon, late) == states.stop_times(0.0)
    assert (states.v == v).all()
    assert soon < late
    states.delay_braking(0.0)
    assert states.stop_times(0.0) == (soon, soon)
    # What is told to brake later is as an older state, and as much later.
    states.delay_braking(DELAY)
    assert late == pytest.approx(states.stop_times(DELAY)[0] + DELAY)


@pytest.mark.parametrize(
    "wrap", [np.float32, list, np.ma.array, lambda a: a[:3], lambda a: a.astype(">f8")]
)
def test_what_is_no_plain_array_calls_for_a_closer_look(states, wrap):
    assert states.glance(PERIOD, wrap(HOME), STILL, PERIOD)[0] == DOUBTFUL
    assert states.glance(PERIOD, HOME, wrap(STILL), PERIOD)[0] == DOUBTFUL


def test_strides_do_not_matter(states):
    table = np.zeros((7, 3))
    table[:, 1] = HOME
    states.glance(PERIOD, table[:, 1], np.zeros(14)[::-2], PERIOD)
    assert (states.q == HOME).all()
    states.glance(2 * PERIOD, HOME[::-1].copy()[::-1], STILL, 2 * PERIOD)
    assert (states.q == HOME).all()


def wander(rng, robot):
    """Joint states as they are, and as they never should be."""
    q, v, stamp = HOME.copy(), STILL.copy(), 0.0
    while True:
        stamp += rng.choice([PERIOD, PERIOD, PERIOD, 0.0, 0.02, 0.06, -PERIOD])
        now = stamp + rng.choice([0.0, 0.0, 1e-4, -1e-4, 0.04, 0.06])
        v = v + rng.uniform(-1.0, 1.0, 7) * robot.acceleration_limit * PERIOD
        q = q + v * PERIOD
        given_q, given_v = q.copy(), v.copy()
        if rng.random() < 0.1:
            some = rng.choice([given_q, given_v])
            some[rng.integers(7)] = rng.choice([math.nan, math.inf, 99.0, -99.0, 2.0])
        if rng.random() < 0.02:
            q, v = robot.upper_position_limit - rng.choice([0.5, 1e-6]), STILL.copy()
        yield stamp, given_q, given_v, now


def test_it_believes_what_the_closer_look_believes_and_nothing_else():
    robot, rng = panda(), np.random.default_rng(3)
    quick, close = make_states(), make_states()
    world, seen = wander(rng, robot), set()
    for _ in range(4000):
        stamp, q, v, now = next(world)
        found, *stop_times = quick.glance(stamp, q, v, now)
        reason = close.receive(stamp, q, v, now)
        if found & DOUBTFUL:
            assert quick.receive(stamp, q, v, now) == reason
        else:
            assert reason is None
            assert tuple(stop_times) == close.stop_times(now - stamp)
            assert bool(found & RUNAWAY) == (close.stopping() is not None)
            assert bool(found & FAST) == bool((np.abs(v) > robot.velocity_limit).any())
            assert (quick.q == q).all()
            assert (quick.v == v).all()
        seen.add((found, reason is None))
        if reason is not None:
            quick.reset()
            close.reset()
    assert {(BELIEVED, True), (DOUBTFUL, True), (DOUBTFUL, False), (RUNAWAY, True)} <= seen
