"""What is said of the speeds that joints kept to is true of every motion within their limits."""

import math

import numpy as np
import pytest

from armguard.bounds import BrakingMotion
from armguard.monitor.kept_speeds import KeptSpeeds
from armguard.scheduling.scheduler import Tick
from support.panda_monitor import HOME, PERIOD, panda


def make_tick(number, time, v, age):
    return Tick(number, time, time, HOME, v, age, 0.0, 0.0)


def test_joints_were_no_faster_since_then_whatever_they_did():
    """They speed up and slow down as hard as they can, and are measured as wrong as may be."""
    random, robot = np.random.default_rng(5), panda()
    braking = BrakingMotion(robot, 0.02)
    accel, error = robot.acceleration_limit, robot.velocity_error
    step, chains = 0.25 * PERIOD, 0
    for _ in range(30):
        kept, scale = KeptSpeeds(), random.uniform(0.1, 0.6)
        true_v = random.uniform(-0.4, 0.4, 7) * robot.velocity_limit * scale
        times, speeds = [], []
        push, time, stamp = np.zeros(7), 0.0, 0.0
        for k in range(400):
            time = k * step
            if random.random() < 0.02:
                push = random.choice([-1.0, 0.0, 1.0], 7)
            true_v = np.clip(true_v + push * accel * step, -0.7 * accel, 0.7 * accel)
            times.append(time)
            speeds.append(np.abs(true_v))
            if random.random() < 0.6:
                continue
            # Some states are old when they come; of few there is one in each tick.
            which = max(0, k - int(random.integers(0, 8)))
            if times[which] <= stamp:
                continue
            stamp = times[which]
            measured = np.sign(random.normal(size=7)) * error
            measured += speeds[which] * np.sign(true_v)
            tick = make_tick(k, time, measured, time - stamp)
            since = kept.follow(tick, scale, braking, 3e-3, 0.03)
            if since == math.inf:
                continue
            chain = np.array(speeds)[np.array(times) >= since]
            chains += since < time
            assert (chain <= scale * robot.velocity_limit + 1e-9).all(), (k, since)
    assert chains > 300


def test_higher_speeds_and_gaps_begin_anew_and_a_fast_joint_counts_for_nothing():
    kept, braking = KeptSpeeds(), BrakingMotion(panda(), 0.02)
    still = np.zeros(7)

    def follow(number, scale, v=still, age=0.0):
        return kept.follow(make_tick(number, number * PERIOD, v, age), scale, braking, 3e-3, 0.03)

    assert follow(1, 0.5) == PERIOD
    assert follow(2, 0.5) == PERIOD
    # What was proved of more speed holds for less, and not the other way round.
    assert follow(3, 0.4) == PERIOD
    assert follow(4, 0.5) == 4 * PERIOD
    assert follow(5, 0.5) == 4 * PERIOD
    # For so long nothing was heard of it that it could have been faster.
    assert follow(500, 0.5) == 500 * PERIOD
    fast = 0.5 * panda().velocity_limit - panda().velocity_error - 2e-3
    assert follow(501, 0.5, np.eye(7)[2] * fast) == math.inf
    assert follow(502, 0.5) == 502 * PERIOD
    assert follow(503, 0.5, age=1.0) == math.inf
    assert follow(504, 0.5, still + math.nan) == math.inf
    kept.reset()
    assert follow(505, 0.5) == 505 * PERIOD


@pytest.mark.parametrize("way", [-1.0, 1.0])
def test_a_joint_counts_as_fast_as_its_error_allows_and_as_it_can_become(way):
    kept, braking, robot = KeptSpeeds(), BrakingMotion(panda(), 0.02), panda()
    most = 0.5 * robot.velocity_limit - robot.velocity_error - 3e-3 * robot.acceleration_limit
    for joint in range(7):
        for spare, is_kept in ((1e-6, True), (-1e-6, False)):
            v = way * (most[joint] - spare) * np.eye(7)[joint]
            kept.reset()
            since = kept.follow(make_tick(1, PERIOD, v, 0.0), 0.5, braking, 3e-3, 0.03)
            assert (since < math.inf) == is_kept


def test_of_ticks_at_the_same_time_the_earlier_do_not_count_for_a_higher_speed():
    """A clock may stand for some ticks: what they proved bears the same time."""
    kept, braking = KeptSpeeds(), BrakingMotion(panda(), 0.02)

    def follow(number, scale):
        tick = make_tick(number, PERIOD, np.zeros(7), 0.0)
        return kept.follow(tick, scale, braking, 3e-3, 0.03)

    assert follow(1, 0.3) == PERIOD
    assert follow(2, 0.3) == PERIOD
    assert follow(3, 0.6) > PERIOD
    kept.reset()
    assert follow(4, 0.9) > PERIOD


def test_the_stop_time_is_the_end_of_the_table_of_such_an_arm_wherever_velocities_stand():
    """What lies beyond it is not asked about, so it may be no shorter."""
    random, braking, checked = np.random.default_rng(6), BrakingMotion(panda(), 0.02), 0
    for _ in range(100):
        kept, scale, age = KeptSpeeds(), random.uniform(0.1, 0.9), random.uniform(-0.01, 0.02)
        strided = np.zeros((7, 2))
        v = strided[:, 0]
        v[:] = random.uniform(-0.8, 0.8, 7) * scale * panda().velocity_limit
        tick = make_tick(1, 1.0, v, age)
        since = kept.follow(tick, scale, braking, 3e-3, 0.03)
        table = braking.tabulate(HOME, v, age, 0.03, pace=scale)
        if since < math.inf:
            checked += 1
            assert 0.0 <= kept.stop_time - table.time[-1] < 1e-9
    assert checked > 10
