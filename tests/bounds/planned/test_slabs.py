import numpy as np
import pytest

from armguard.bounds import CheckedPlan, Plan, check_plan
from armguard.bounds.limits import read_limits
from armguard.bounds.planned.slabs import make_slabs
from armguard.robot import Robot
from support.hostile_joints import STEP
from support.plan_cases import Waves, follow, make_plan

REACTION = 0.02


@pytest.fixture(scope="module", params=["panda", "kinova", "tiago"])
def robot(request):
    return Robot.load(request.param)


def check(robot, plan, now, q, v, stamp):
    checked = check_plan(plan, robot, now, q, v, stamp)
    assert isinstance(checked, CheckedPlan), checked
    return checked


def lead_of(random):
    return round(random.choice([0.0, -0.02, 0.05]) / STEP) * STEP


@pytest.mark.parametrize("stated", [False, True])
def test_joints_stay_in_the_slabs_until_they_rest(robot, stated):
    random, limits = np.random.default_rng(1), read_limits(robot)
    most, nv = np.zeros(3), len(robot.joints)
    for _ in range(80):
        waves = Waves(robot, random, random.choice([0.1, 0.5]))
        now, duration = 1.0, 0.01 * random.integers(5, 30)
        errors = random.choice([1e-4, 2e-3, 1e-2]) * np.ones(nv)
        speeds = random.choice([0.02, 0.1]) * np.ones(nv) if stated else None
        times = np.linspace(0.0, duration, random.integers(12, 60))
        plan = make_plan(waves, now + lead_of(random), times, errors, speeds)
        begin = now - 0.025
        qs, vs = follow(robot, waves, plan, random, begin, REACTION)
        step = round((now - begin) / STEP)
        seen = step + int(random.integers(-8, 3))
        q = qs[seen] + random.choice([-1.0, 0.0, 1.0], nv) * robot.position_error
        v = vs[seen] + random.choice([-1.0, 0.0, 1.0], nv) * robot.velocity_error
        slabs = make_slabs(check(robot, plan, now, q, v, begin + seen * STEP), limits, REACTION)
        assert slabs.start[0] == 0.0
        assert np.array_equal(slabs.start[1:], slabs.end[:-1])
        assert slabs.end[-1] + STEP >= (len(qs) - 1 - step) * STEP
        for k in range(step, len(qs)):
            time = (k - step) * STEP
            slab = min(np.searchsorted(slabs.end, time), len(slabs.end) - 1)
            away = np.abs(qs[k] - slabs.middle[slab])
            assert (away <= slabs.half[slab] + 1e-9).all()
            along = time - (plan.stamp - now)
            phase = int(along > 0.0) + int(along > duration)
            most[phase] = max(most[phase], (away / slabs.half[slab]).max())
    assert (most > [0.3, 0.9, 0.7]).all()


@pytest.mark.parametrize("stated", [False, True])
def test_joints_that_leave_the_plan_when_they_like_stay_in_the_slabs(robot, stated):
    random, limits = np.random.default_rng(5), read_limits(robot)
    most, nv = 0.0, len(robot.joints)
    for _ in range(60):
        waves = Waves(robot, random, random.choice([0.1, 0.5]))
        errors = random.choice([1e-4, 2e-3, 1e-2]) * np.ones(nv)
        speeds = random.choice([0.02, 0.1]) * np.ones(nv) if stated else None
        lead = random.choice([0.0, -0.02])
        plan = make_plan(waves, lead, np.linspace(0.0, 0.1, 21), errors, speeds)
        command = STEP * random.integers(round(-lead / STEP), 81)
        qs, vs = follow(robot, waves, plan, random, 0.0, REACTION, command)
        q = qs[0] + random.choice([-1.0, 0.0, 1.0], nv) * robot.position_error
        v = vs[0] + random.choice([-1.0, 0.0, 1.0], nv) * robot.velocity_error
        checked = check(robot, plan, 0.0, q, v, 0.0)
        slabs = make_slabs(checked, limits, REACTION, command + lead)
        assert slabs.start[0] == 0.0
        assert np.array_equal(slabs.start[1:], slabs.end[:-1])
        assert slabs.end[-1] + STEP >= (len(qs) - 1) * STEP
        for k in range(len(qs)):
            slab = min(np.searchsorted(slabs.end, k * STEP), len(slabs.end) - 1)
            away = np.abs(qs[k] - slabs.middle[slab])
            assert (away <= slabs.half[slab] + 1e-9).all()
            if k * STEP > command + lead + REACTION:
                most = max(most, (away / slabs.half[slab]).max())
    assert most > 0.5


def test_a_plan_that_lasts_beyond_the_reaction_lets_less_happen_after_a_command():
    robot = Robot.load("panda")
    waves = Waves(robot, np.random.default_rng(6), 0.3)
    ends = []
    for duration in (0.05, 0.1):
        plan = make_plan(
            waves, 0.0, np.linspace(0.0, duration, 41), np.full(7, 1e-3), np.full(7, 0.02)
        )
        checked = check(robot, plan, 0.0, waves.position(0.0), waves.velocity(0.0), 0.0)
        ends.append(make_slabs(checked, read_limits(robot), REACTION, 0.05))
    assert ends[1].end[-1] < ends[0].end[-1]
    assert (ends[1].half[-1] < ends[0].half[-1]).all()


def test_slabs_on_the_curve_are_as_wide_as_the_motion_and_the_deviation():
    robot = Robot.load("panda")
    waves = Waves(robot, np.random.default_rng(2), 0.3)
    plan = make_plan(waves, 0.0, np.linspace(0.0, 0.2, 41), np.full(7, 2e-3))
    checked = check(robot, plan, 0.0, waves.position(0.0), waves.velocity(0.0), 0.0)
    slabs = make_slabs(checked, read_limits(robot), REACTION)
    for k in np.flatnonzero(slabs.end <= 0.2 + 1e-12):
        within = waves.position(np.linspace(slabs.start[k], slabs.end[k], 100))
        half = 0.5 * np.ptp(within, axis=0) + checked.deviation
        assert slabs.half[k] == pytest.approx(half, rel=1e-3)


def test_at_its_end_joints_may_be_as_far_and_as_fast_off_a_plan_as_it_says():
    """One is, goes on as hard as it can until it reacts, and then brakes as late as it may."""
    robot = Robot.load("panda")
    q, still = np.array([0.0, -0.5, 0.0, -2.0, 0.0, 1.6, 0.8]), np.zeros(7)
    times, off, speed = np.linspace(0.0, 0.5, 6), np.full(7, 1e-2), np.full(7, 0.1)
    plan = Plan(0.0, times, np.tile(q, (6, 1)), np.zeros((6, 7)), off, speed)
    slabs = make_slabs(check(robot, plan, 0.0, q, still, 0.0), read_limits(robot), REACTION)
    fast = speed + robot.velocity_error
    way = off + robot.position_error + fast * REACTION
    way += 0.5 * robot.acceleration_limit * REACTION**2
    fast = fast + robot.acceleration_limit * REACTION
    way += 0.5 * fast**2 / robot.braking_deceleration
    assert (slabs.middle[-1] + slabs.half[-1] >= q + way - 1e-12).all()
    assert (slabs.middle[-1] - slabs.half[-1] <= q - way + 1e-12).all()
    assert slabs.end[-1] >= 0.5 + REACTION + (fast / robot.braking_deceleration).max() - 1e-12


def test_a_long_plan_gets_longer_slabs_but_no_gaps():
    robot = Robot.load("panda")
    waves = Waves(robot, np.random.default_rng(3), 0.1)
    plan = make_plan(waves, 0.0, np.linspace(0.0, 30.0, 3001), np.full(7, 2e-3))
    checked = check(robot, plan, 0.0, waves.position(0.0), waves.velocity(0.0), 0.0)
    slabs = make_slabs(checked, read_limits(robot), REACTION)
    assert len(slabs.start) < 300
    assert np.array_equal(slabs.start[1:], slabs.end[:-1])
    assert slabs.end[-1] > 30.0


def test_what_is_over_is_left_out():
    robot = Robot.load("panda")
    waves = Waves(robot, np.random.default_rng(4), 0.3)
    plan = make_plan(waves, 0.0, np.linspace(0.0, 0.2, 41), np.full(7, 2e-3))
    late = check(robot, plan, 0.08, waves.position(0.08), waves.velocity(0.08), 0.08)
    slabs = make_slabs(late, read_limits(robot), REACTION)
    assert slabs.start[0] == 0.0
    assert abs(slabs.middle[0] - waves.position(0.0825)).max() < 2e-3
