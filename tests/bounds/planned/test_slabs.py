"""Joints that leave a known path as they like, against the boxes that bound them.

ARMGUARD_MOTIONS sets how many joint motions are tried in all; a million take an hour.
"""

import functools
import os

import numpy as np
import pytest

from armguard.bounds import CheckedPlan, Plan, PlannedMotion, check_plan, stop_on_path
from support.example_arms import load_holding
from support.hostile_joints import STEP
from support.plan_cases import Follower, Hermite, Waves, make_plan

USUAL_MOTIONS = 80_000
MORE = max(1, round(int(os.environ.get("ARMGUARD_MOTIONS", "0")) / USUAL_MOTIONS))
"""Times as many as usual."""


@pytest.fixture(scope="module", params=["panda", "kinova", "tiago"])
def robot(request):
    return load_holding(request.param)


@functools.cache
def find_motion(robot):
    return PlannedMotion(robot)


def draw_plan(robot, random):
    """A motion, and its plan with errors that are stated or not."""
    nv, duration = len(robot.joints), 0.01 * random.integers(5, 30)
    waves = Waves(robot, random, random.choice([0.1, 0.5]))
    errors = random.choice([1e-4, 2e-3, 1e-2]) * np.ones(nv)
    speeds = random.choice([0.02, 0.1]) * np.ones(nv) if random.random() < 0.5 else None
    times = np.linspace(0.0, duration, random.integers(12, 60))
    return waves, make_plan(robot, waves, 0.0, times, errors, speeds)


def check(robot, plan, now=0.0, q=None, v=None):
    """The plan as checked where the arm is on it, or at a state of its own; however late."""
    curve = Hermite(plan.times, plan.q, plan.v)
    at = np.clip(now - plan.stamp, 0.0, plan.times[-1])
    q, v = curve(at) if q is None else q, curve(at, 1) if v is None else v
    begun = min(now, plan.stamp)
    there = (q, v) if begun == now else (plan.q[0], plan.v[0])
    checked = check_plan(plan, robot, begun, *there, begun)
    assert isinstance(checked, CheckedPlan), checked
    return checked._replace(now=now, measured_stamp=now, measured_q=q, measured_v=v)


def measure(checked, robot, random, q, v):
    """The plan as checked against a joint state that is off by as much as it may."""
    sides = random.choice([-1.0, 0.0, 1.0], (2, len(q)))
    return checked._replace(
        measured_q=q + sides[0] * robot.position_error,
        measured_v=v + sides[1] * robot.velocity_error,
    )


def find_most(slabs, time, q, until):
    """How much of its box each arm fills at the most until it rests; more than 1 is out of it."""
    assert slabs.start[0] == 0.0
    assert np.array_equal(slabs.start[1:], slabs.end[:-1])
    assert (slabs.half >= 0.0).all()
    inside = (time >= 0.0) & (time <= until + STEP)
    place = np.minimum(np.searchsorted(slabs.end, time[inside]), len(slabs.end) - 1)
    away = np.abs(q[inside] - slabs.middle[place])
    return float(((away - 1e-9) / slabs.half[place]).max())


def test_joints_stay_in_the_slabs_of_their_piece_until_they_rest(robot):
    random, motion, most = np.random.default_rng(1), find_motion(robot), []
    for _ in range(20 * MORE):
        waves, plan = draw_plan(robot, random)
        now = STEP * random.integers(-30, 40)
        follower = Follower(robot, waves, plan, random, 30, now - 0.01, max(now, 0.0))
        step = follower.index(now)
        state = {"q": follower.q[step, 0], "v": follower.v[step, 0]} if now < 0.0 else {}
        slabs = motion.lay_out(check(robot, plan, now, **state))
        # Before the piece begins joints are free; there are slabs for the one that was measured.
        arms = 30 if now >= 0.0 else 1
        assert slabs.end[-1] >= plan.times[-1] - now
        for arm in range(arms):
            time = follower.time - now
            most.append(find_most(slabs, time, follower.q[:, arm], plan.times[-1] - now))
    assert max(most) <= 1.0
    assert max(most) > 0.99


def test_until_a_piece_begins_joints_are_on_those_before(robot):
    random, motion = np.random.default_rng(2), find_motion(robot)
    for _ in range(20):
        waves, plan = draw_plan(robot, random)
        _, first = draw_plan(robot, random)
        first = check(
            robot,
            make_plan(robot, waves, -0.05, np.linspace(0, 0.2, 41), first.tracking_error),
            now=-0.03,
        )
        slabs = motion.lay_out(
            check(robot, plan, -0.03, waves.position(-0.03), waves.velocity(-0.03)), [first]
        )
        before = slabs.end <= 0.03 + 1e-12
        middle = 0.5 * (slabs.start + slabs.end)[before] - 0.03
        assert slabs.middle[before] == pytest.approx(waves.position(middle), abs=1e-3)
        assert before.sum() >= 4


def test_joints_that_leave_a_piece_when_they_like_stay_in_the_slabs(robot):
    random, motion, most = np.random.default_rng(6), find_motion(robot), []
    for _ in range(20 * MORE):
        waves, plan = draw_plan(robot, random)
        now = STEP * random.integers(0, 40)
        follower = Follower(robot, waves, plan, random, 30, now - 0.01, now)
        follower.brake_joints(max(plan.times[-1] - now, STEP))
        seen = follower.index(now)
        checked = check(robot, plan, now)
        for arm in range(30):
            measured = measure(checked, robot, random, follower.q[seen, arm], follower.v[seen, arm])
            slabs = motion.lay_out_left(measured)
            assert slabs.end[-1] + STEP >= follower.resting[arm] - now
            time = follower.time - now
            most.append(find_most(slabs, time, follower.q[:, arm], slabs.end[-1]))
    assert max(most) <= 1.0
    assert max(most) > 0.97


def test_an_arm_that_leaves_while_it_waits_is_on_the_piece_before():
    robot, random = load_holding("panda"), np.random.default_rng(7)
    motion = find_motion(robot)
    waves, plan = draw_plan(robot, random)
    times = np.linspace(0.0, 0.2, 41)
    first = check(robot, make_plan(robot, waves, -0.05, times, plan.tracking_error), now=-0.03)
    later = check(robot, plan, -0.03, waves.position(-0.03), waves.velocity(-0.03))
    assert motion.lay_out_left(later) is None, "joints are free until it begins"
    waiting = motion.lay_out_left(later, [first])
    begun = waiting.start >= 0.03 - 1e-12
    kept = motion.lay_out(later, [first])
    for slabs in (waiting, kept):
        assert slabs.start[0] == 0.0
        assert np.array_equal(slabs.start[1:], slabs.end[:-1])
    assert np.array_equal(waiting.middle[~begun], kept.middle[: (~begun).sum()])
    assert np.array_equal(waiting.half[~begun], kept.half[: (~begun).sum()])
    # From then on, slabs that may be left hold those that may not.
    for k in np.flatnonzero(kept.start >= 0.03 - 1e-12):
        low, high = kept.middle[k] - kept.half[k], kept.middle[k] + kept.half[k]
        meets = begun & (waiting.start < kept.end[k]) & (waiting.end > kept.start[k])
        assert (np.min(waiting.middle - waiting.half, axis=0, where=meets[:, None], initial=9.0)
                <= low + 1e-9).all()  # fmt: skip
        assert (np.max(waiting.middle + waiting.half, axis=0, where=meets[:, None], initial=-9.0)
                >= high - 1e-9).all()  # fmt: skip


def find_extent(slabs):
    """When the arm rests, and the least and greatest position of each joint until then."""
    low, high = (slabs.middle - slabs.half).min(axis=0), (slabs.middle + slabs.half).max(axis=0)
    return slabs.end[-1], low, high


def holds(inner, outer):
    """Whether the one says no less than the other does; slabs of time may begin elsewhere."""
    end, low, high = find_extent(inner)
    other_end, other_low, other_high = find_extent(outer)
    return bool(
        end <= other_end + 1e-9
        and (low >= other_low - 1e-9).all()
        and (high <= other_high + 1e-9).all()
    )


def test_more_error_and_a_longer_latency_never_say_less():
    robot, random = load_holding("panda"), np.random.default_rng(5)
    motion = find_motion(robot)
    for _ in range(20):
        _, plan = draw_plan(robot, random)
        errors, speeds = np.full(7, 1e-3), np.full(7, 0.02)
        plan = plan._replace(tracking_error=errors, velocity_tracking_error=speeds)
        checked = check(robot, plan, 0.05)
        for worse in (
            plan._replace(tracking_error=2.0 * errors),
            plan._replace(velocity_tracking_error=2.0 * speeds),
            plan._replace(velocity_tracking_error=None),
        ):
            assert holds(motion.lay_out(checked), motion.lay_out(check(robot, worse, 0.05)))
        assert holds(motion.lay_out_left(checked), motion.lay_out_left(checked, latency=0.02))


@pytest.mark.parametrize("now", [0.0, 0.08])
def test_slabs_on_the_curve_are_as_wide_as_the_motion_and_the_deviation(now):
    robot = load_holding("panda")
    waves = Waves(robot, np.random.default_rng(2), 0.3)
    plan = make_plan(robot, waves, 0.0, np.linspace(0.0, 0.2, 41), np.full(7, 2e-3))
    checked = check(robot, plan, now)
    slabs = find_motion(robot).lay_out(checked)
    for k in np.flatnonzero(slabs.end <= 0.2 - now + 1e-12):
        within = waves.position(now + np.linspace(slabs.start[k], slabs.end[k], 100))
        half = 0.5 * np.ptp(within, axis=0) + checked.deviation
        assert slabs.half[k] == pytest.approx(half, rel=1e-3)
        assert slabs.middle[k] == pytest.approx(0.5 * (within[0] + within[-1]), abs=1e-3)


def test_a_long_piece_gets_longer_slabs_but_no_gaps():
    robot = load_holding("panda")
    waves = Waves(robot, np.random.default_rng(3), 0.1)
    plan = make_plan(robot, waves, 0.0, np.linspace(0.0, 30.0, 3001), np.full(7, 2e-3))
    slabs = find_motion(robot).lay_out(check(robot, plan))
    assert len(slabs.start) < 300
    assert np.array_equal(slabs.start[1:], slabs.end[:-1])
    assert slabs.end[-1] > 30.0


def test_an_arm_at_rest_stays_where_it_is():
    robot = load_holding("panda")
    q, still = np.array([0.0, -0.5, 0.0, -2.0, 0.0, 1.6, 0.8]), np.zeros(7)
    plan = Plan(0.0, [0.0, 0.5], [q, q], [still, still], np.full(7, 1e-3), np.full(7, 0.01))
    assert stop_on_path(robot, plan).times[-1] == pytest.approx(0.5, abs=1e-5)
    checked, motion = check(robot, plan), find_motion(robot)
    for slabs in (motion.lay_out(checked), motion.lay_out_left(checked)):
        assert slabs.middle == pytest.approx(np.tile(q, (len(slabs.middle), 1)), abs=1e-3)
        # Off it, and swinging about it, by no more than it may.
        assert slabs.half.max() < 4e-3
