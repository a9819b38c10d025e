import numpy as np
import pytest

from armguard.bounds import CheckedPlan
from armguard.bounds.planned.following import Following, is_covered
from support.example_arms import load_holding
from support.plan_cases import Hermite
from support.short_plans import HOME, NOW, STILL, TIMES, check, moved, resting


@pytest.fixture(scope="module")
def robot():
    return load_holding("panda")


def make_read_only(array):
    array.flags.writeable = False
    return array


def test_after_its_end_the_arm_stays_there(robot):
    checked = check(robot, resting())
    for later in (0.2, 0.201, 100.0):
        assert Following(robot).check(checked, HOME, STILL, NOW + later) is None
        off = HOME + np.eye(7)[6] * 0.01
        assert Following(robot).check(checked, off, STILL, NOW + later).subject == robot.joints[6]
        moving = STILL + np.eye(7)[2] * 1.0
        assert "at velocity" in Following(robot).check(checked, HOME, moving, NOW + later).detail
    assert Following(robot).check(checked, HOME, STILL, np.nan) is not None


def test_stated_velocity_errors_are_tested(robot):
    slow = STILL + np.eye(7)[1] * 0.1
    assert isinstance(check(robot, resting(), v=slow), CheckedPlan)
    refusal = check(robot, resting(velocity_tracking_error=np.full(7, 0.01)), v=slow)
    assert "at velocity" in refusal.detail


def draw_plan(robot, random, count, sizes, **changes):
    """A plan through random samples, which need not be within limits, and ends at rest."""
    times = np.append(0.0, np.cumsum(random.uniform(0.01, 0.2, count)))
    q, v = (size * random.normal(size=(count + 1, 7)) for size in sizes)
    v[-1] = 0.0
    return check(robot, resting())._replace(
        stamp=NOW + random.uniform(-0.1, 0.0),
        times=make_read_only(times),
        q=make_read_only(HOME + q),
        v=make_read_only(v),
        **changes,
    )


def measure_apart(plans, times, order):
    """How far, or how fast, joints on two plans are apart at the most. Shape (nv,)."""
    one, other = (
        Hermite(plan.times, plan.q, plan.v)(np.clip(times - plan.stamp, 0.0, plan.times[-1]), order)
        for plan in plans
    )
    return np.abs(one - other).max(axis=0)


def compare(robot, *plans_and_times):
    return Following(robot).compare(*plans_and_times)[0]


def test_plans_that_differ_are_told_apart_by_joint_amount_and_when(robot):
    one = check(robot, moved(0, 0.5 * TIMES, 0.5))
    assert compare(robot, one, one, NOW, NOW + 0.5) is None
    other = one._replace(q=one.q + np.eye(7)[2] * 4e-3)
    found = compare(robot, one, other, NOW, NOW + 0.1)
    assert found.subject == robot.joints[2]
    assert "by 0.004 at" in found.detail
    # From some time on only.
    late = one.q.copy()
    late[15:, 4] += 5e-3
    other = one._replace(q=late)
    assert compare(robot, one, other, NOW, NOW + 0.13) is None
    assert compare(robot, one, other, NOW, NOW + 0.16).subject == robot.joints[4]
    stated = one._replace(velocity_deviation=np.full(7, 0.02))
    faster = stated._replace(v=stated.v + np.eye(7)[1] * 0.1)
    found = compare(robot, stated, faster, NOW, NOW)
    assert found.subject == robot.joints[1]
    assert found.detail.startswith("goes off the committed piece by 0.1")


def test_plans_of_other_samples_differ_as_much_as_dense_samples_of_them_do(robot):
    random, kinds = np.random.default_rng(3), set()
    for _ in range(200):
        stated = np.full(7, random.choice([0.1, 0.3, np.inf]))
        one, other = plans = [
            draw_plan(
                robot, random, count,
                (random.choice([1e-4, 3e-3]), random.choice([0.0, 0.05, 0.2])),
                velocity_deviation=stated,
            )
            for count in random.integers(2, 12, 2)
        ]  # fmt: skip
        first = NOW + random.uniform(0.0, 0.1)
        last = first + random.choice([0.0, 0.05, 1.0])
        # At all samples too, where velocities are compared.
        dense = np.concatenate(
            [np.linspace(first, last, 2001), one.stamp + one.times, other.stamp + other.times]
        )
        dense = dense[(dense >= first) & (dense <= last)]
        apart, pace = (measure_apart(plans, dense, order) for order in range(2))
        found = compare(robot, one, other, first, last)
        if found is None:
            assert (apart <= one.deviation + 1e-6).all()
        elif found.detail.startswith("off"):
            joint = int(np.flatnonzero(apart > one.deviation - 1e-6)[0])
            assert found.subject == robot.joints[joint]
            assert float(found.detail.split()[5]) == pytest.approx(apart[joint], rel=1e-2)
        else:
            assert (apart <= one.deviation + 1e-6).all()
            assert (pace > stated - 1e-6).any()
        kinds.add(None if found is None else found.detail[:2])
    assert kinds == {None, "of", "go"}


def test_a_plan_that_is_widened_holds_an_arm_on_either(robot):
    """Wherever it is on the other one, within what it may be off that, and however fast."""
    random = np.random.default_rng(4)
    for _ in range(50):
        one, other = plans = [
            draw_plan(
                robot, random, count, (0.02, 0.1),
                deviation=random.uniform(1e-3, 5e-3, 7),
                velocity_deviation=random.uniform(0.01, 0.1, 7),
                top_speed=random.uniform(0.1, 1.0, 7),
            )
            for count in random.integers(2, 6, 2)
        ]  # fmt: skip
        wide = Following(robot).widen(one, other, NOW)
        assert wide.q is other.q
        assert wide.stamp == other.stamp
        dense = np.linspace(NOW, max(plan.end for plan in plans), 3001)
        for order, field in enumerate(("deviation", "velocity_deviation")):
            allowed, apart = getattr(wide, field), measure_apart(plans, dense, order)
            assert (allowed >= getattr(one, field) + apart - 1e-9).all(), field
            assert (allowed >= getattr(other, field)).all()
        assert (wide.top_speed >= np.maximum(one.top_speed, other.top_speed)).all()


def test_a_plan_covers_another_only_where_it_is_the_same_to_the_end(robot):
    one = check(robot, moved(0, 0.5 * TIMES, 0.5))
    assert is_covered(one, one, NOW)
    wider = one._replace(deviation=2.0 * one.deviation)
    assert is_covered(one, wider, NOW)
    assert not is_covered(wider, one, NOW)
    longer = check(robot, resting())
    assert not is_covered(one, longer, NOW)
    # What is over is the same as what stays there.
    q = one.q[-1]
    stays = one._replace(times=np.array([0.0, 1.0]), q=np.array([q, q]), v=np.zeros((2, 7)))
    assert is_covered(one, stays, one.end)
