"""A STOP that is obeyed is in time, and an arm that keeps to its speed scale can still stop."""

import functools
import itertools
from types import SimpleNamespace

import numpy as np
import pytest

from armguard.bounds import BrakingMotion
from armguard.monitor.rising_scale import RisingScale
from armguard.monitor.stop_decision import StopDecision
from armguard.robot import Robot
from armguard.settings import Settings
from armguard.verdict import Level
from support.adversary import Hunt
from support.panda_monitor import HOME, PERIOD, STILL, make_monitor, panda, see, steps

STEP = 1e-3
LATENCY, REACTION = 0.002, 0.02


@pytest.mark.parametrize(
    ("robot", "seed", "settings"),
    [
        ("panda", 11, {}),
        ("panda", 11, {"rate": 100.0, "latency": 0.01}),
        ("panda", 11, {"rate": 500.0, "latency": 0.0, "reaction_time": 0.0}),
        ("xarm7", 12, {}),
    ],
)
def test_a_stop_that_is_obeyed_is_in_time(robot, seed, settings):
    """Every ball attacks; the arm brakes as late as it may and as weakly, or as hard, as it may."""
    hunt = Hunt(Robot.load(robot), seed, 12, 12, top=(0.1, 0.3, 1.0), **settings)
    score = hunt.run(2.5e5)
    assert (score.hits, score.missed, score.early) == (0, 0, 0), score
    # It was a fight: the arm was let go and stopped again and again.
    assert score.stops > 5
    assert score.goes > 100
    assert score.worst < 0.3


def test_no_sample_of_whatever_error_makes_a_proof_last_too_long():
    score = Hunt(panda(), 1, 30, 30, close=True, vague=0.9).run(6e5)
    assert (score.hits, score.missed, score.early, score.too_fast) == (0, 0, 0, 0), score
    assert score.goes > 50


def test_nothing_is_missed_within_50_ms_of_contact():
    """All attack from beside a slow arm: only there does it still move, or may, at such times."""
    score = Hunt(panda(), 0, 30, 30, close=True).run(6e5)
    assert (score.hits, score.missed, score.early, score.too_fast) == (0, 0, 0, 0), score
    assert score.near > 1000
    assert score.near_open > 10


def test_a_stop_that_is_obeyed_too_late_is_not():
    score = Hunt(panda(), 2, 60, 12, true_reaction=0.08).run(4e5)
    assert score.missed > 10


@functools.cache
def braking_motion():
    return BrakingMotion(panda(), REACTION)


def simulate(q, v, age, free, pace, duration, rng, count):
    """Displacements of joints that go as they like, from now on at a pace, and brake, many times.

    And how far wrong a straight line between two steps may be, where joints run into their stops
    on the way, both of shape (steps, count, nv), and the velocities in the end.
    """
    robot, shape = panda(), (count, len(q))
    accel, fastest = robot.acceleration_limit, robot.velocity_limit
    braking = robot.braking_deceleration
    lower, upper = robot.lower_position_limit, robot.upper_position_limit
    off = rng.choice([-1.0, 0.0, 1.0], (2, *shape))
    true_q = np.clip(q + off[0] * robot.position_error, lower, upper)
    true_v = np.clip(v + off[1] * robot.velocity_error, -fastest, fastest)
    start = true_q.copy()
    ways, jolts = [np.zeros(shape)], [np.zeros(shape)]
    push, turns = rng.choice([-1.0, 1.0], shape), rng.uniform(0.0, 3.0 * (age + free), shape)
    strength = rng.choice([0.0, 1.0, 2.0], shape)
    strength = np.where(strength > 1.0, rng.random((count, 1)), strength)
    for k in range(round((age + duration) / STEP)):
        now = k * STEP
        top = fastest if now < age - 1e-9 else pace * fastest
        true_v = np.clip(true_v, -top, top)
        rate = braking + strength * (accel - braking)
        pushed = true_v + np.where(now < turns, push, -push) * accel * STEP
        slowed = np.sign(true_v) * np.maximum(np.abs(true_v) - rate * STEP, 0.0)
        after = np.clip(pushed, -top, top) if now < age + free - 1e-09 else slowed
        moved = true_q + 0.5 * STEP * (true_v + after)
        true_q = np.clip(moved, lower, upper)
        true_v = np.where(true_q == moved, after, 0.0)
        ways.append(true_q - start)
        jolts.append(np.where(true_q == moved, 0.0, top * STEP))
    return np.array(ways), np.array(jolts), true_v


@pytest.mark.parametrize("horizon", [PERIOD + LATENCY, 0.1])
@pytest.mark.parametrize("pace", [1.0, 0.7, 0.3, 0.01])
def test_braking_tables_bound_every_motion(horizon, pace):
    rng, robot = np.random.default_rng(int(100 * horizon + 10 * pace)), panda()
    lower, upper = robot.lower_position_limit, robot.upper_position_limit
    reached = 0.0
    for _ in range(12):
        age = rng.choice([0.0, 0.004, 0.02])
        q = rng.uniform(lower, upper)
        near = rng.random(7) < 0.2
        q = np.where(near, np.where(rng.random(7) < 0.5, lower + 0.02, upper - 0.02), q)
        v = rng.uniform(-1.0, 1.0, 7) * robot.velocity_limit * rng.choice([0.0, 0.2, 1.0])
        table = braking_motion().tabulate(q, v, age, horizon, pace=pace)
        high = np.minimum(table.high, table.highest)
        low = np.maximum(table.low, table.lowest)
        free = horizon + REACTION
        duration, count = table.time[-1] + 2 * STEP, 12
        ways, jolts, speed = simulate(q, v, age, free, pace, duration, rng, count)
        assert (speed == 0.0).all(), "the table ends before the arm rests"
        at = (age + table.time) / STEP
        for i, j in np.ndindex(count, 7):
            way = np.interp(at, np.arange(len(ways)), ways[:, i, j])
            slack = 3e-5 + jolts[np.ceil(at - 1e-9).astype(int), i, j]
            assert (way <= high[:, j] + slack).all()
            assert (way >= low[:, j] - slack).all()
            reached = max(reached, (way[-1] / max(high[-1, j], 1e-3)).max())
    assert reached > 0.9


def test_less_pace_never_adds_to_what_an_arm_can_do_that_keeps_to_it():
    rng = np.random.default_rng(3)
    motion = braking_motion()
    for _ in range(20):
        q = rng.uniform(panda().lower_position_limit, panda().upper_position_limit)
        v = rng.uniform(-0.1, 0.1, 7) * panda().velocity_limit
        ends = []
        for pace in (1.0, 0.5, 0.1):
            table = motion.tabulate(q, v, 0.0, 0.05, pace=pace)
            assert (np.diff(table.time) > 0.0).all()
            ends.append((table.high.max(axis=0), table.low.min(axis=0), table.time[-1]))
        for more, less in itertools.pairwise(ends):
            assert (less[0] <= more[0] + 1e-12).all()
            assert (less[1] >= more[1] - 1e-12).all()
            assert less[2] <= more[2] + 1e-12
        assert ends[2][2] < ends[0][2]


def search(thresholds, rise=20.0):
    """What is given out where the greatest safe scale is known, and how many questions it took."""
    settings = Settings(rate=1.0 / PERIOD, latency=LATENCY, reaction_time=REACTION)
    decision, rising = StopDecision(None, settings), RisingScale(rise)
    given, asked = [], []
    for number, threshold in enumerate(thresholds):
        questions = []

        def is_safe(tick, scale, *, lasts=False, threshold=threshold, asked=questions):
            asked.append(scale)
            return scale <= threshold or scale == 0.0

        decision._is_safe = decision._may_rise = is_safe
        now = number * PERIOD
        tick = SimpleNamespace(number=number, time=now)
        found = decision.find_scale(tick, rising.given, rising.find_most(now))
        given.append(rising.give(now, found))
        # What is given out was found safe in this very tick; 0 is a stop, and needs no proof.
        assert given[-1] == 0.0 or given[-1] in questions
        asked.append(len(questions))
    return np.array(given), np.array(asked)


def test_a_scale_is_safe_in_its_tick_and_found_in_a_few_questions():
    rng = np.random.default_rng(1)
    drift = 0.5 + 0.7 * np.sin(np.cumsum(rng.uniform(0.0, 0.02, 20000)))
    jumps = np.repeat(rng.uniform(-0.2, 1.2, 200), 100)
    for thresholds in (drift, jumps):
        for rise in (1.0, 20.0):
            given, asked = search(thresholds, rise)
            assert (given <= np.maximum(thresholds, 0.0)).all()
            assert (np.diff(given) <= rise * PERIOD + 1e-12).all()
            assert asked.max() <= 8
    # On the average hardly more than one.
    assert search(drift)[1].mean() < 1.5


@pytest.mark.parametrize("threshold", [-0.1, 0.0, 0.01, 0.2, 0.5, 0.93, 1.0])
def test_a_scale_comes_as_close_as_a_step_and_stays_there(threshold):
    given, asked = search(np.full(200, threshold))
    assert (np.diff(given) >= 0.0).all()
    assert (given > threshold - 2.0 / 32.0).all()
    # A scale that rises goes all the way.
    risen, _ = search(np.append(np.zeros(100), np.full(200, threshold)))
    assert (risen[200:] > threshold - 2.0 / 32.0).all()
    assert asked[10:].mean() < 1.2


AHEAD = 2.0 * (PERIOD + LATENCY) + REACTION
"""When an arm that keeps to its scale can be told to stop, in [s]."""


def watch_scale(position, velocity, q, v, ticks, *, speed=2.0, accel=10.0):
    """Verdicts of an arm that stays as it is, beside a ball that is heard of in each tick."""
    obstacles, monitor = make_monitor("deadline", rise_delay=0.05)
    verdicts = []
    for k in range(ticks):
        see(obstacles, k * PERIOD, position, velocity=[velocity], speed=speed, accel=accel)
        verdicts += steps(monitor, k, 1, q(k), v)
    return verdicts


def test_an_arm_that_moves_away_need_not_slow_down():
    """A wall behind the hand, which swings away from it; then the other way round."""
    # At this pose the hand is in front of the base, and joint 1 swings it sideways.
    scales = {}
    for side in (-1.0, 1.0):
        pace = np.eye(7)[0] * 0.8

        def q(k, pace=pace):
            return HOME + pace * k * PERIOD

        obstacles, monitor = make_monitor("deadline")
        obstacles.add_static("wall", [0.5, side * 0.28, 0.6], 0.1)
        verdicts = [monitor.step(k * PERIOD, q(k), pace) for k in range(60)]
        scales[side] = np.array([one.speed_scale for one in verdicts])
        if side < 0.0:
            assert all(one.level > Level.STOP for one in verdicts)
    assert (scales[-1.0] == 1.0).all()
    assert scales[1.0].mean() < 0.5


@pytest.mark.parametrize("pace", [PERIOD, 7.0 * PERIOD, 40.0 * PERIOD])
def test_a_scale_that_is_given_out_is_safe_now_however_late_ticks_come(pace):
    """Somebody walks up to an arm that stands still: each scale is proved anew when it is given."""
    obstacles, monitor = make_monitor("deadline", rise_delay=0.0, latency=LATENCY)
    braking, given = monitor._scheduler.arm.motion.braking, 0
    for k in range(int(1.4 / pace)):
        now = k * pace
        place = [2.0 - 0.9 * now, 0.0, 0.6]
        see(obstacles, now, place, velocity=[[-0.9, 0.0, 0.0]])
        verdict = monitor.step(now, HOME, STILL)
        if not verdict.speed_scale > 0.0 or verdict.speed_scale == 1.0:
            continue
        given += 1
        tick = monitor._last[0]
        table = braking.tabulate(HOME, STILL, 0.0, AHEAD, pace=verdict.speed_scale)
        assert monitor._scheduler.find_unsafe(tick, float(table.time[-1]))[0] == -1, (now, verdict)
    assert given > 5


def test_a_scale_found_before_there_were_news_is_not_given_out_after():
    """Somebody nearer comes into sight: every scale is proved anew against both of them."""
    tightened = 0
    for nearer in (0.85, 0.9, 0.95, 1.0):
        obstacles, monitor = make_monitor("deadline", rise_delay=0.0, latency=LATENCY)
        braking, given = monitor._scheduler.arm.motion.braking, []
        for k in range(90):
            now, seen = k * PERIOD, {"near": [1.05, 0.0, 0.6], "nearer": [nearer, 0.0, 0.6]}
            if k < 60:
                del seen["nearer"]
            see(obstacles, now, list(seen.values()), list(seen))
            verdict = monitor.step(now, HOME, STILL)
            given.append(verdict.speed_scale)
            if 0.0 < verdict.speed_scale < 1.0:
                tick = monitor._last[0]
                table = braking.tabulate(HOME, STILL, 0.0, AHEAD, pace=verdict.speed_scale)
                unsafe = monitor._scheduler.find_unsafe(tick, float(table.time[-1])).pair
                assert unsafe == -1, (nearer, k, verdict)
        tightened += 0.0 < given[-1] < given[59] < 1.0
    assert tightened > 1


@functools.cache
def govern(distance, seconds=4.0):
    """An arm that sweeps to and fro, as fast as its scale lets it, beside a post.

    Returns scales and levels by tick. The thing leaves after three quarters of the time.
    """
    robot = panda()
    obstacles, monitor = make_monitor("deadline", rise_delay=0.1)
    obstacles.add_static("post", [0.55 + distance, 0.0, 0.6], 0.1)
    q, v, scales, levels = HOME.copy(), np.zeros(7), [], []
    side = 1.0
    ticks = round(seconds / PERIOD)
    for k in range(ticks):
        if k == 3 * ticks // 4:
            obstacles.remove(["post"])
        verdict = monitor.step(k * PERIOD, q, v)
        scales.append(verdict.speed_scale)
        levels.append(verdict.level)
        top = 0.0 if verdict.level is Level.STOP else verdict.speed_scale * robot.velocity_limit[0]
        side = -np.sign(q[0]) if abs(q[0]) > 0.5 else side
        goal = side * min(top, 0.6)
        rate = robot.braking_deceleration[0] * PERIOD
        after = v[0] + np.clip(goal - v[0], -rate, rate)
        q[0] += 0.5 * PERIOD * (v[0] + after)
        v[0] = after
    return np.array(scales), np.array(levels)


def test_a_governed_arm_does_not_come_to_a_halt_where_it_need_not():
    scales, levels = govern(0.6)
    early = slice(len(scales) // 4, 3 * len(scales) // 4)
    assert (levels[early] > Level.STOP).all()
    assert scales[early].min() > 0.05
    # It is not ever slower: the last stretch is no slower than the first.
    half = len(scales) // 2
    first, second = scales[len(scales) // 4 : half], scales[half : 3 * len(scales) // 4]
    assert second.mean() > 0.7 * first.mean()


def test_a_scale_recovers_by_itself():
    scales, levels = govern(0.6)
    assert scales[-1] == 1.0
    assert levels[-1] == Level.CLEAR


@pytest.mark.parametrize("seed", [4, 5])
def test_an_arm_that_keeps_to_its_scale_can_still_stop(seed):
    score = Hunt(panda(), seed, 60, 12, slow_margin=0.1, aware_margin=0.3).run(8e5)
    assert score.too_fast == 0, score
    assert score.goes > 100
    assert score.worst_scale < 0.5
