import numpy as np
import pytest

from armguard.bounds import CheckedPlan, Plan, Refusal, check_plan
from armguard.bounds.planned.following import Following
from support.example_arms import load_holding
from support.plan_cases import Waves, make_plan
from support.short_plans import ERRORS, HOME, NOW, STILL, TIMES, check, moved, resting


@pytest.fixture(scope="module")
def robot():
    return load_holding("panda")


@pytest.mark.parametrize("name", ["panda", "kinova", "tiago", "ur5"])
def test_plans_within_limits_are_accepted_wherever_they_are_joined(name):
    robot, random = load_holding(name), np.random.default_rng(0)
    for _ in range(50):
        waves = Waves(robot, random, random.choice([0.1, 0.5, 0.99]))
        errors = random.choice([1e-4, 1e-2]) * np.ones(len(robot.joints))
        plan = make_plan(
            robot, waves, NOW + random.uniform(-0.1, 0.1), np.linspace(0.0, 0.3, 61), errors
        )
        stamp = NOW - random.uniform(0.0, 0.01)
        q, v = waves.position(stamp), waves.velocity(stamp)
        checked = check(robot, plan, q=q, v=v, stamp=stamp)
        assert isinstance(checked, CheckedPlan), checked
        assert (checked.deviation >= errors + robot.position_error).all()
        assert Following(robot).check(checked, q, v, stamp) is None
        later = plan.stamp + random.uniform(0.0, 0.3)
        q, v = waves.position(later), waves.velocity(later)
        assert Following(robot).check(checked, q, v, later) is None


def test_a_plan_keeps_its_own_copy(robot):
    plan = resting()
    checked = check(robot, plan)
    plan.q[:] = 99.0
    assert np.array_equal(checked.q[3], HOME)
    assert checked.end == NOW + 0.2


SWING = 0.1 * np.sin(8.0 * TIMES)
PACE = 0.8 * np.cos(8.0 * TIMES)


def cases(robot):
    upper, error = robot.upper_position_limit[3], robot.position_error[3]
    # Between samples only: from rest to rest at the limit's edge, with velocities that bulge out.
    bulge = np.tile(HOME, (2, 1))
    bulge[:, 5] = robot.upper_position_limit[5]
    bulge_v = np.zeros((2, 7))
    bulge_v[:, 5] = [0.1, -0.1]
    return {
        "beyond a position limit": (moved(3, upper + error + 1e-6, 0.0), {}, "limits with errors"),
        "beyond one between samples": (
            resting(times=[0.0, 0.2], q=bulge, v=bulge_v),
            {},
            "limits with errors",
        ),
        "beyond a velocity limit": (moved(0, 2.3 * TIMES, 2.3), {"v": 0.0}, "limit with error"),
        "velocities apart": (moved(0, 0.0, np.where(TIMES > 0.1, 0.7, 0.0)), {}, "accelerates at"),
        "velocities beside positions": (moved(0, SWING, 0.0), {}, "do not agree"),
        "positions beside velocities": (moved(0, 0.0, PACE), {}, "do not agree"),
        "a jump": (moved(0, np.where(TIMES > 0.1, 0.1, 0.0), 0.0), {}, "limit with error"),
        "over": (resting(stamp=NOW - 0.3), {}, "in the past"),
        "just over": (resting(stamp=NOW - 0.2), {}, "in the past"),
        "stale": (resting(stamp=NOW - 0.15), {}, "stale"),
        "far ahead": (resting(stamp=NOW + 0.2), {}, "begins in"),
        "never": (resting(stamp=1e300), {}, "begins in"),
        "elsewhere": (resting(), {"q": HOME + np.eye(7)[4] * 3.1e-3}, "where the plan has it"),
        "elsewhere, nowhere": (resting(), {"q": np.full(7, np.nan)}, "where the plan has it"),
        "at other speed": (moved(0, SWING, PACE), {"v": STILL + np.eye(7)[0] * 2.0}, "at velocity"),
        "elsewhere when it begins": (
            resting(stamp=NOW + 0.01),
            {"q": HOME + np.eye(7)[2] * 6e-3},
            "when it begins",
        ),
        "moving at its end": (
            moved(0, 0.1 * TIMES, 0.1),
            {"stops": False},
            "ends at velocity 0.1, expected at rest",
        ),
        "clock unknown": (resting(), {"now": np.nan}, "begins at"),
        "malformed": (resting(q=HOME), {}, "shape"),
        "without error": (resting(tracking_error=STILL), {}, "above 0"),
    }


@pytest.mark.parametrize("case", list(cases(load_holding("panda"))))
def test_refusals_name_their_reason(robot, case):
    plan, measured, words = cases(robot)[case]
    if np.ndim(plan.q) < 2:
        measured = {"q": HOME, "v": STILL}
    if isinstance(measured.get("v"), float):
        measured = measured | {"v": np.full(7, measured["v"])}
    refusal = check(robot, plan, **measured)
    assert isinstance(refusal, Refusal)
    assert words in refusal.detail
    assert refusal.subject in {*robot.joints, *Plan._fields, "plan"}


def test_what_is_within_errors_is_no_reason_to_refuse(robot):
    both = ERRORS + robot.position_error
    for sign in (-1.0, 1.0):
        assert isinstance(check(robot, resting(), q=HOME + 0.999 * sign * both), CheckedPlan)
        assert isinstance(check(robot, resting(), q=HOME + 1.001 * sign * both), Refusal)
    edge = robot.upper_position_limit[3] + 0.5 * robot.position_error[3]
    assert isinstance(check(robot, moved(3, edge, 0.0)), CheckedPlan)


def test_a_state_from_before_the_plan_may_be_as_far_off_as_the_arm_can_come(robot):
    wait, v = 0.02, STILL.copy()
    v[0] = 0.5
    plan = resting(stamp=NOW + wait)
    reach = 0.5 * robot.acceleration_limit[0] * wait**2 + robot.velocity_error[0] * wait
    room = ERRORS[0] + 2.0 * robot.position_error[0] + reach
    for part, kind in ((0.99, CheckedPlan), (1.01, Refusal)):
        q = HOME - np.eye(7)[0] * (0.5 * wait + part * room)
        assert isinstance(check(robot, plan, q=q, v=v), kind)


@pytest.mark.parametrize("measured", [HOME[:5], [HOME], []])
def test_a_joint_state_of_another_shape_is_refused(robot, measured):
    for q, v in ((measured, STILL), (HOME, measured)):
        refusal = check_plan(resting(), robot, NOW, q, v, NOW)
        assert isinstance(refusal, Refusal)
        assert refusal.subject == "joint state"
        assert "expected (7,)" in refusal.detail


def test_huge_errors_are_no_way_around_the_checks(robot):
    checked = check(robot, resting(tracking_error=np.full(7, 1e308)))
    assert isinstance(checked, CheckedPlan)
    assert (checked.deviation >= 1e308).all()


def kinova_plan(robot, angles, times, pace):
    """A plan whose first joint, which is continuous, is at these angles."""
    lower, upper = robot.lower_position_limit, robot.upper_position_limit
    middle = [0.5 * (a + b) if np.isfinite(a) else 0.0 for a, b in zip(lower, upper, strict=True)]
    q, v = np.tile(middle, (len(times), 1)), np.zeros((len(times), 6))
    q[:, 0], v[:, 0] = angles, pace
    return Plan(NOW, np.asarray(times), q, v, np.full(6, 2e-3))


@pytest.mark.parametrize("turns", [0, 1, -1, 40])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_positions_of_a_continuous_joint_are_whole_turns_nearest_to_the_joint_state(turns, side):
    robot = load_holding("kinova")
    true = side * (3.0 + 0.5 * TIMES)
    plain = kinova_plan(robot, true, TIMES, 0.5 * side)
    wrapped = (true + np.pi) % (2.0 * np.pi) - np.pi
    q, v = np.array(plain.q)[0], np.array(plain.v)[0]
    for angles in (true, wrapped, true + 8.0 * np.pi):
        plan = kinova_plan(robot, angles, TIMES, 0.5 * side)
        there = q + np.eye(6)[0] * 2.0 * np.pi * turns
        checked = check(robot, plan, q=there, v=v)
        assert isinstance(checked, CheckedPlan), checked
        np.testing.assert_allclose(checked.q[:21, 0], true + 2.0 * np.pi * turns, atol=1e-12)
        np.testing.assert_array_equal(checked.q[:21, 1:], np.asarray(plan.q)[:, 1:])
        # And what is measured later may be told in any turn.
        for k in (5, 20):
            for more in (0, 3, -7):
                later = checked.q[k] + np.eye(6)[0] * 2.0 * np.pi * more
                assert Following(robot).check(checked, later, v, NOW + TIMES[k]) is None
                off = later + np.eye(6)[0] * 0.1
                assert Following(robot).check(checked, off, v, NOW + TIMES[k]) is not None


def test_what_is_no_wrap_is_taken_as_it_was_written():
    robot = load_holding("kinova")
    slow = kinova_plan(robot, [0.0, 4.0, 4.0], [0.0, 10.0, 10.1], [0.0, 0.0, 0.0])
    assert check(robot, slow).q[:, 0].tolist() == [0.0, 4.0, 4.0]
    true = 0.5 * TIMES
    jumps = np.where(TIMES > 0.1, true + 3.0, true)
    plan = kinova_plan(robot, jumps, TIMES, 0.5)
    assert isinstance(check(robot, plan), Refusal)
    # A joint with limits does not wrap, whatever they are.
    ur5 = load_holding("ur5")
    q, v = np.zeros((21, 6)), np.zeros((21, 6))
    q[:, 5], v[:, 5] = 3.1 + 0.5 * TIMES, 0.5
    wrapped = q.copy()
    wrapped[:, 5] = (q[:, 5] + np.pi) % (2.0 * np.pi) - np.pi
    errors = np.full(6, 2e-3)
    assert isinstance(check(ur5, Plan(NOW, TIMES, q, v, errors)), CheckedPlan)
    assert isinstance(check(ur5, Plan(NOW, TIMES, wrapped, v, errors)), Refusal)
    far = Plan(NOW, TIMES, q - 2.0 * np.pi, v, errors)
    assert isinstance(check(ur5, far, q=q[0], v=v[0]), Refusal)
