import numpy as np
import pytest

from armguard.bounds import CheckedPlan, Plan, Refusal, append_stop, stop_on_path
from armguard.bounds.planned.check import PlanCheck
from armguard.bounds.planned.curve import find_top_speeds
from armguard.bounds.planned.stop import bound_path_braking
from armguard.exceptions import ArmguardError
from armguard.robot import Robot
from armguard.robot.brakes import find_gentlest_stop
from support.example_arms import load_holding
from support.plan_cases import Hermite, Waves
from support.short_plans import HOME, NOW, TIMES, moved, resting


@pytest.fixture(scope="module")
def robot():
    return load_holding("panda")


def find_hard_stop(robot, plan):
    """Why the robot's brakes do not guarantee a plan's stop; None if they do."""
    check = PlanCheck(robot, robot.brakes.make_curves())
    found = check.check(plan, NOW, plan.q[0], plan.v[0], NOW)
    assert isinstance(found, CheckedPlan | Refusal)
    return found if isinstance(found, Refusal) else None


def test_a_stop_harder_than_brakes_guarantee_is_told(robot):
    braking = robot.braking_deceleration
    plan = moved(0, 0.1 * TIMES, 0.1)
    for part, is_fine in ((0.5, True), (1.0, True), (1.01, False), (2.0, False)):
        stopped = append_stop(plan, part * braking)
        refusal = find_hard_stop(robot, stopped)
        assert (refusal is None) is is_fine
        if refusal is not None:
            assert refusal.subject == robot.joints[0]
            assert f"brakes guarantee {braking[0]:.4g}" in refusal.detail
        # However long it rests then.
        later = stopped._replace(
            times=np.append(stopped.times, stopped.times[-1] + [1.0, 2.0]),
            q=np.concatenate([stopped.q, stopped.q[-1:], stopped.q[-1:]]),
            v=np.concatenate([stopped.v, stopped.v[-1:], stopped.v[-1:]]),
        )
        assert (find_hard_stop(robot, later) is None) is is_fine


def test_a_stop_that_gets_harder_between_two_samples_is_judged_by_where_it_is_hardest(robot):
    """From no deceleration to the peak, or the other way round, in one interval."""
    braking, pace = robot.braking_deceleration, 0.1
    for peak, is_fine in ((0.5, True), (1.0, True), (1.02, False), (2.0, False)):
        for grows in (True, False):
            # A deceleration that is linear in time has half of its peak on average.
            lasting = pace / (0.5 * peak * braking[0])
            way = pace * lasting * (2.0 if grows else 1.0) / 3.0
            q, v = np.tile(HOME, (2, 1)), np.zeros((2, 7))
            q[1, 0] += way
            v[0, 0] = pace
            plan = resting(times=np.array([0.0, lasting]), q=q, v=v)
            refusal = find_hard_stop(robot, plan)
            assert (refusal is None) is is_fine, (peak, grows)
            if refusal is not None:
                assert refusal.subject == robot.joints[0]
                assert f"{peak * braking[0]:.4g}" in refusal.detail


def follow_waves(robot, random, share):
    """A path that bends, and ends in full motion."""
    waves = Waves(robot, random, 0.3)
    waves.size *= share
    times = np.linspace(0.0, 1.0, 101)
    return resting(times=times, q=waves.position(times), v=waves.velocity(times))


def test_a_stop_on_the_path_stays_on_it_and_no_joint_brakes_harder_than_guaranteed(robot):
    random, brakes = np.random.default_rng(5), robot.brakes.make_curves()
    tried = 0
    for _ in range(60):
        plan = follow_waves(robot, random, random.choice([0.02, 0.05]))
        braking = find_gentlest_stop(brakes, find_top_speeds(plan.times, plan.q, plan.v))
        at = float(random.choice([0.0, 0.3, 0.505, 0.98]))
        try:
            stopped = stop_on_path(robot, plan, at=at)
        except ArmguardError:
            continue
        tried += 1
        curve, path = Hermite(stopped.times, stopped.q, stopped.v), Hermite(*plan[1:4])
        assert not stopped.v[-1].any()
        before = np.linspace(0.0, at, 50)
        assert curve(before) == pytest.approx(path(before), abs=1e-9)
        # Of all joints together by one clock: its place follows from that of the fastest one.
        after = np.linspace(at, stopped.times[-1], 400)[:-1]
        lasting = stopped.times[-1] - at
        along = at + (after - at) * (1.0 - 0.5 * (after - at) / lasting)
        expected = path(np.minimum(along, 1.0)) + np.maximum(along - 1.0, 0.0)[:, None] * plan.v[-1]
        assert curve(after) == pytest.approx(expected, abs=1e-6)
        slower = curve(after, 1) * curve(after, 2) < 0.0
        assert (np.abs(curve(after, 2)) <= np.where(slower, braking, np.inf) * (1.0 + 1e-9)).all()
        # And no gentler than that, but for what is left to rounding and sampling.
        pace = 1.0 - (after - at) / lasting
        bent = np.abs(path(np.minimum(along, 1.0 - 1e-9), 2))
        ahead = np.abs(path(np.minimum(along, 1.0), 1))
        assert ((braking - bent) / np.maximum(ahead, 1e-12)).min() <= 1.3 / lasting
        assert (pace > 0.0).all()
    assert tried > 20


def test_no_joint_needs_more_than_its_brakes_while_the_clock_slows_down_as_fast_as_is_found():
    """Few samples, between which joints are faster than at either."""
    random, tried = np.random.default_rng(8), 0
    for _ in range(300):
        times = np.append(0.0, np.cumsum(random.uniform(0.2, 0.6, 3)))
        q, v = random.uniform(-0.1, 0.1, (2, 4, 3))
        braking = random.uniform(2.0, 8.0, 3)
        slowing, joint, _ = bound_path_braking(times, q, v, braking, 0.0, float(times[-1]))
        if not slowing > 0.0:
            continue
        tried += 1
        assert 0 <= joint < 3
        along = np.linspace(0.0, times[-1], 2000)[:-1]
        curve = Hermite(times, q, v)
        needed = np.abs(curve(along, 2)) + slowing * np.abs(curve(along, 1))
        assert (needed <= braking * (1.0 + 1e-9)).all()
    assert tried > 50


def test_a_path_that_bends_more_than_brakes_guarantee_has_no_stop_on_it(robot):
    braking = robot.braking_deceleration[0]
    for part in (0.9, 1.1):
        times = np.linspace(0.0, 1.0, 101)
        size = part * braking / 36.0
        q, v = np.tile(HOME, (101, 1)), np.zeros((101, 7))
        q[:, 0] += size * (1.0 - np.cos(6.0 * times))
        v[:, 0] = 6.0 * size * np.sin(6.0 * times)
        plan = resting(times=times, q=q, v=v)
        if part < 1.0:
            assert not stop_on_path(robot, plan, at=0.1).v[-1].any()
            continue
        with pytest.raises(ArmguardError, match="no stop on the path") as caught:
            stop_on_path(robot, plan, at=0.1)
        assert caught.value.offender == robot.joints[0]
        # From its end on the arm goes straight on.
        assert not stop_on_path(robot, plan).v[-1].any()


def slow_down_early(robot, joint, fast, slow):
    """A path on which one joint gets slow in the first half, and goes on slowly."""
    times = np.linspace(0.0, 1.0, 101)
    pace = np.maximum(fast + (slow - fast) * times / 0.5, slow)
    far = np.concatenate([[0.0], np.cumsum(0.5 * (pace[1:] + pace[:-1]) * np.diff(times))])
    q, v = np.zeros((101, len(robot.joints))), np.zeros((101, len(robot.joints)))
    q[:, joint], v[:, joint] = far, pace
    return Plan(0.0, times, q, v, np.full(len(robot.joints), 1e-3))


@pytest.mark.parametrize("name", ["ur5", "ur10"])
def test_a_stop_relies_on_brakes_as_they_are_at_the_speeds_of_the_stop(name):
    """A stopping time from full speed says little about the deceleration from a low one."""
    robot = Robot.load(name)
    brakes = robot.brakes.make_curves()
    plan = slow_down_early(robot, 0, 0.9 * robot.velocity_limit[0], 0.2)
    allowed = find_gentlest_stop(brakes, plan.v[-1])[0]
    assert allowed < 0.5 * find_gentlest_stop(brakes, plan.v[0])[0]
    for at in (None, 0.6, 0.9):
        stopped = stop_on_path(robot, plan, at=at)
        begin = 1.0 if at is None else at
        after = np.linspace(begin, stopped.times[-1], 200)[1:-1]
        curve = Hermite(stopped.times, stopped.q, stopped.v)
        hardest = -curve(after, 2)[:, 0].min()
        assert hardest == pytest.approx(allowed, rel=0.05)
        assert hardest <= allowed * (1.0 + 1e-9)


def test_a_speed_that_no_brakes_are_stated_for_has_no_stop():
    robot = Robot.load("ur5")
    most = robot.brakes.make_curves().speed[3, -1]
    for share, is_refused in ((0.99, False), (1.01, True)):
        plan = slow_down_early(robot, 3, share * most, 0.2)
        for at in (None, 0.7):
            if not is_refused:
                assert not stop_on_path(robot, plan, at=at).v[-1].any()
                continue
            with pytest.raises(ArmguardError, match="brakes are stated for") as caught:
                stop_on_path(robot, plan, at=at)
            assert caught.value.offender == robot.joints[3]


def test_a_stop_anywhere_is_a_plan_that_can_be_checked(robot):
    """Also of an arm that rests already, and beside a sample."""
    for plan in (moved(0, 0.0 * TIMES, 0.0), moved(0, 0.1 * TIMES, 0.1)):
        grains = [0.0, 1e-9, 1e-6, 3e-6]
        for at in [None, *grains, *(float(TIMES[5]) + x for x in grains), float(TIMES[-1]) - 1e-9]:
            stopped = stop_on_path(robot, plan, at=at)
            assert stopped.times[0] == 0.0
            assert (np.diff(stopped.times) > 9e-7).all()
            assert find_hard_stop(robot, stopped) is None


def test_what_cannot_be_stopped_on_is_refused_by_name(robot):
    plan = moved(0, 0.1 * TIMES, 0.1)
    for at in (-0.1, float(TIMES[-1]) + 0.1, np.nan, np.inf, "now", [0.1], np.zeros(2)):
        with pytest.raises(ArmguardError, match=r"^at"):
            stop_on_path(robot, plan, at=at)
    with pytest.raises(ArmguardError, match="payload"):
        stop_on_path(robot, plan, -1.0)
    for junk in (None, plan._replace(q=plan.q[:, :6]), plan._replace(stamp=np.nan)):
        with pytest.raises(ArmguardError):
            stop_on_path(robot, junk)


@pytest.mark.parametrize("on_path", [False, True])
def test_an_appended_stop_goes_on_smoothly_and_no_harder_than_brakes(robot, on_path):
    random, braking = np.random.default_rng(0), robot.braking_deceleration
    for _ in range(50):
        pace = random.uniform(-0.5, 0.5, 7) * (random.random(7) < 0.8)
        q = HOME + np.outer(TIMES, pace)
        plan = resting(q=q, v=np.tile(pace, (21, 1)))
        stopped = stop_on_path(robot, plan) if on_path else append_stop(plan, braking)
        times, q, v = stopped.times, stopped.q, stopped.v
        assert (v[-1] == 0.0).all()
        # Quadratic between samples: displacements are those of the mean velocity.
        steps = np.diff(times)[:, None]
        np.testing.assert_allclose(np.diff(q, axis=0), 0.5 * steps * (v[1:] + v[:-1]), atol=1e-12)
        rates = np.abs(np.diff(v, axis=0) / steps)
        assert (rates <= braking * (1.0 + 1e-9) + 1e-9).all()
        longest = (np.abs(pace) / braking).max()
        assert times[-1] - TIMES[-1] == pytest.approx(longest, abs=2e-6)
        if on_path and pace.any():
            off = q[-1] - plan.q[-1]
            np.testing.assert_allclose(off, 0.5 * (times[-1] - TIMES[-1]) * pace, atol=1e-12)
        assert find_hard_stop(robot, stopped) is None
