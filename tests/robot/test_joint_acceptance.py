"""The compiled acceptance of joint states: what it answers, and what it takes."""

import functools
import math

import numpy as np
import pytest

from armguard.bounds import BrakingMotion
from armguard.jit.numerics import POSITION_BY_ACCEL, POSITION_BY_SPEED, VELOCITY_BY_ACCEL
from armguard.monitor.joint_reasons import describe_refusal
from armguard.robot import JointStates, Robot
from armguard.robot.joint_acceptance import (
    BELIEVED,
    FAST,
    GAP,
    NO_JOINT,
    POSITION_BEYOND_LIMITS,
    POSITION_NOT_FINITE,
    RUNAWAY,
    STAMP_BACKWARDS,
    STAMP_STANDS,
    TOO_OLD,
    UNBRAKED,
    VELOCITY_BEYOND_LIMITS,
    VELOCITY_NOT_FINITE,
    WRONG_LENGTH,
)
from support.panda_monitor import HOME, STILL, panda

PERIOD, TIMEOUT, HORIZON, REACTION, DELAY = 1e-3, 0.05, 0.003, 0.02, 0.4


def make_states(robot=None):
    states = JointStates(robot or panda(), TIMEOUT, HORIZON, REACTION, PERIOD)
    states.delay_braking(DELAY)
    return states


@pytest.fixture
def states():
    states = make_states()
    assert states.accept(0.0, HOME, STILL, 0.0)[0] == BELIEVED
    return states


def test_the_first_state_is_held_against_limits_alone():
    for timeout in (TIMEOUT, math.inf):
        for stamp in (-1e9, 0.0, 1e9):
            states = JointStates(panda(), timeout)
            assert states.accept(stamp, HOME, STILL, stamp)[:2] == (BELIEVED, NO_JOINT)
            assert (states.q == HOME).all()
    states = make_states()
    assert states.accept(0.0, HOME * 9.0, STILL, 0.0)[:2] == (-POSITION_BEYOND_LIMITS, 1)
    assert states.accept(0.0, HOME, STILL, 9.0)[:2] == (-TOO_OLD, NO_JOINT)
    assert (states.q == 0.0).all()
    assert states.accept(0.0, HOME, STILL, 0.0)[0] == BELIEVED


@pytest.mark.parametrize("age", [0.0, 0.02, -0.002, -0.02])
def test_stop_times_are_the_ends_of_the_tables_of_such_stops(states, age):
    """Of a state that is yet to be measured as well: brakes may bite before."""
    braking = BrakingMotion(panda(), REACTION)
    states.delay_braking(0.03)
    states.v[:] = 0.2 * panda().velocity_limit
    for horizon, stop_time in zip((HORIZON, HORIZON + 0.03), states.stop_times(age), strict=True):
        table = braking.tabulate(HOME, states.v, age, horizon)
        assert stop_time == pytest.approx(table.time[-1], rel=1e-12)


class Plain:
    """The same decisions as they are written down, state by state, all states kept."""

    def __init__(self, robot):
        self.robot, self.believed = robot, []
        self.counted_from = self.first_now = self.last_now = None
        self.ticks = 0

    def accept(self, stamp, q, v, now):
        r, last = self.robot, self.counted_from
        if not (len(q) == len(v) == 7):
            return {-WRONG_LENGTH}
        if not np.isfinite(q).all():
            return {-POSITION_NOT_FINITE}
        if not np.isfinite(v).all():
            return {-VELOCITY_NOT_FINITE}
        low, high = r.lower_position_limit, r.upper_position_limit
        if ((q < low - r.position_error) | (q > high + r.position_error)).any():
            return {-POSITION_BEYOND_LIMITS}
        if (np.abs(v) > r.velocity_limit + r.velocity_error).any():
            return {-VELOCITY_BEYOND_LIMITS}
        if last is not None and stamp < last:
            return {-STAMP_BACKWARDS}
        if abs(now - stamp) > TIMEOUT:
            return {-TOO_OLD}
        stood = last == stamp and not now > self.last_now
        ticks = self.ticks + 1 if stood else 0
        if last is not None and stamp - last > TIMEOUT:
            self.counted_from, self.first_now, self.last_now = stamp, now, now
            self.ticks = 0
            return {-GAP}
        if last == stamp and max(now - self.first_now, ticks * PERIOD) > TIMEOUT:
            return {-STAMP_STANDS}
        for s, q0, v0 in self.believed:
            h = stamp - s
            far = np.abs(q - q0) - r.velocity_limit * h - 2.0 * r.position_error
            fast = np.abs(v - v0) - r.acceleration_limit * h - 2.0 * r.velocity_error
            if (far > 1e-3).any() or (fast > 1e-9).any():
                return {-POSITION_BY_SPEED, -POSITION_BY_ACCEL, -VELOCITY_BY_ACCEL}
        self.believed = [*self.believed[-20:], (stamp, q.copy(), v.copy())]
        if last != stamp:
            self.first_now = now
        self.counted_from, self.last_now, self.ticks = stamp, now, ticks
        flags = FAST if (np.abs(v) > r.velocity_limit).any() else 0
        free = max(now - stamp, 0.0) + HORIZON + REACTION
        gained = r.acceleration_limit * max(free, stamp - now)
        top = np.maximum(r.velocity_limit, np.abs(v))
        fastest = np.minimum(top, np.abs(v) + r.velocity_error + gained)
        ranges = [max(one.speed for one in r.brakes.entries[joint]
                      if one.load == r.brakes.most_payload) for joint in r.joints]  # fmt: skip
        flags |= UNBRAKED if (fastest > ranges).any() else 0
        return {flags, flags | RUNAWAY}


def wander(rng, robot):
    """Joint states as they are, and as they never should be."""
    q, v, stamp, now = HOME.copy(), STILL.copy(), 0.0, 0.0
    while True:
        stamp += rng.choice([PERIOD, PERIOD, PERIOD, 0.0, 0.02, 0.06, -PERIOD])
        now = max(now, stamp + rng.choice([0.0, 0.0, 1e-4, -1e-4, 0.04, 0.06]))
        v = v + rng.uniform(-1.0, 1.0, 7) * robot.acceleration_limit * PERIOD
        q = q + v * PERIOD
        given_q, given_v = q.copy(), v.copy()
        if rng.random() < 0.1:
            some = rng.choice([0, 1])
            (given_q, given_v)[some][rng.integers(7)] = rng.choice(
                [math.nan, math.inf, 99.0, -99.0, 2.0]
            )
        if rng.random() < 0.01:
            given_q = given_q[:6]
        if rng.random() < 0.02:
            q, v = robot.upper_position_limit - rng.choice([0.5, 1e-6]), STILL.copy()
        if rng.random() < 0.02:
            stamp = now = max(stamp, now)
        yield stamp, given_q, given_v, now


def test_it_believes_what_the_rules_believe_and_nothing_else():
    robot, rng = panda(), np.random.default_rng(3)
    states, plain = make_states(), Plain(robot)
    world, codes = wander(rng, robot), set()
    for _ in range(6000):
        stamp, q, v, now = next(world)
        before = states.q.copy(), states.v.copy()
        found, joint, *stop_times = states.accept(stamp, q, v, now)
        expected = plain.accept(stamp, q, v, now)
        if -POSITION_BY_ACCEL in expected or found in (-POSITION_BY_ACCEL, -POSITION_BY_SPEED):
            # Only what the plain rules refuse must be refused: they know no reference states.
            assert found < 0
            plain = Plain(robot)
            states.reset()
        else:
            assert found in expected
        codes.add(found)
        if found < 0:
            assert (states.q == before[0]).all()
            assert (states.v == before[1]).all()
            assert stop_times == [math.inf, math.inf]
            assert describe_refusal(states, found, joint, stamp, q, v).detail
        else:
            assert (states.q == q).all()
            assert (states.v == v).all()
            assert bool(found & RUNAWAY) == (states.find_runaway() != NO_JOINT)
        if rng.random() < 0.05:
            plain = Plain(robot)
            states.reset()
    assert codes >= {
        BELIEVED, RUNAWAY, -WRONG_LENGTH, -POSITION_NOT_FINITE, -VELOCITY_NOT_FINITE,
        -POSITION_BEYOND_LIMITS, -VELOCITY_BEYOND_LIMITS, -STAMP_BACKWARDS, -TOO_OLD, -GAP,
    }  # fmt: skip


@pytest.mark.parametrize("ahead", [0.0, 0.04])
def test_a_stamp_that_stands_while_the_clock_goes_on(ahead):
    """One ahead of the clock would take so much longer to look old."""
    states = make_states()
    stamp, found, k = 7.0 + ahead, BELIEVED, 0
    while found == BELIEVED:
        found, joint, *_ = states.accept(stamp, HOME, STILL, 7.0 + k * PERIOD)
        k += 1
    assert found == (-STAMP_STANDS if ahead else -TOO_OLD)
    assert k - 1 in (50, 51)
    if ahead:
        detail = describe_refusal(states, found, joint, stamp, HOME, STILL).detail
        assert "7.04" in detail
        assert "0.05" in detail
    if ahead:
        assert states.accept(stamp + PERIOD, HOME, STILL, 7.0 + k * PERIOD)[0] == BELIEVED


def test_a_stamp_that_stands_and_its_clock_with_it():
    """Ticks are counted then: the same states give the same verdicts whenever they are played."""
    for _ in range(2):
        states = make_states()
        found = [states.accept(7.0, HOME, STILL, 7.0)[0] for _ in range(60)]
        assert found == [BELIEVED] * 51 + [-STAMP_STANDS] * 9
        assert states.accept(7.001, HOME, STILL, 7.001)[0] == BELIEVED


def test_a_coarse_clock_is_no_clock_that_stands():
    """Many ticks between two readings of it, and slower joint states."""
    states = make_states()
    for k in range(4000):
        now = k // 40 * 1e-3
        assert states.accept(now // 0.01 * 0.01, HOME, STILL, now)[0] == BELIEVED


@functools.cache
def kinova():
    return Robot.load("kinova")


def kinova_states():
    robot = kinova()
    lower, upper = robot.lower_position_limit, robot.upper_position_limit
    q = np.array(
        [
            0.5 * (low + high) if np.isfinite(low) else 0.0
            for low, high in zip(lower, upper, strict=True)
        ]
    )
    return robot, q, make_states(robot)


def wrap(angle):
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


@pytest.mark.parametrize("pace", [0.5, -0.5])
@pytest.mark.parametrize("step", [1e-3, 0.02])
def test_a_driver_that_wraps_is_believed_for_many_turns(pace, step):
    robot, q, states = kinova_states()
    v = np.where(np.isfinite(robot.lower_position_limit), 0.0, pace)
    turning = np.flatnonzero(v)
    assert len(turning) == 3
    rng, jumps = np.random.default_rng(0), 0
    last = q
    for k in range(int(100.0 / step / (10 if step < 0.01 else 1))):
        true = q + v * k * step
        # Drivers wrap what they read, errors and all, and not all joints at a time.
        read = true + rng.uniform(-1.0, 1.0, 6) * robot.position_error
        given = np.where(v != 0.0, wrap(read), read)
        jumps += np.count_nonzero(np.abs(given - last) > 3.0)
        last = given
        found, joint, *_ = states.accept(k * step, given, v, k * step)
        assert found == BELIEVED, describe_refusal(states, found, joint, k * step, given, v)
        assert np.abs(states.q - read).max() < 1e-12
    assert jumps >= 3


def test_what_is_off_by_anything_but_turns_has_jumped():
    _, q, states = kinova_states()
    still, j = np.zeros(6), 0
    for off in (math.pi, 0.1, 2.0 * math.pi + 0.1, -4.0 * math.pi - 0.1):
        states.reset()
        assert states.accept(0.0, q, still, 0.0)[0] == BELIEVED
        given = q + np.eye(6)[j] * off
        found, joint, *_ = states.accept(PERIOD, given, still, PERIOD)
        assert found < 0
        assert joint == j
        detail = describe_refusal(states, found, joint, PERIOD, given, still).detail
        assert detail.startswith("moved by 3.14" if off == math.pi else "moved by 0.1 rad")
