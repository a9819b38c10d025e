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


def test_plans_that_differ_are_told_apart_by_joint_amount_and_when(robot):
    one = check(robot, moved(0, 0.5 * TIMES, 0.5))
    assert Following(robot).compare(one, one, NOW, NOW + 0.5).refusal is None
    other = one._replace(q=one.q + np.eye(7)[2] * 4e-3)
    found = Following(robot).compare(one, other, NOW, NOW + 0.1).refusal
    assert found.subject == robot.joints[2]
    assert "by 0.004 at" in found.detail
    # From some time on only.
    late = one.q.copy()
    late[15:, 4] += 5e-3
    other = one._replace(q=late)
    assert Following(robot).compare(one, other, NOW, NOW + 0.13).refusal is None
    assert Following(robot).compare(one, other, NOW, NOW + 0.16).refusal.subject == robot.joints[4]
    stated = one._replace(velocity_deviation=np.full(7, 0.02))
    faster = stated._replace(v=stated.v + np.eye(7)[1] * 0.1)
    found = Following(robot).compare(stated, faster, NOW, NOW).refusal
    assert found.subject == robot.joints[1]
    assert found.detail.startswith("goes off the committed piece by 0.1")


def test_plans_of_other_samples_differ_as_much_as_dense_samples_of_them_do(robot):
    random = np.random.default_rng(3)
    kinds = set()
    for _ in range(200):
        plans = []
        for count in random.integers(2, 12, 2):
            times = np.append(0.0, np.cumsum(random.uniform(0.01, 0.1, count)))
            q = HOME + random.choice([1e-4, 3e-3]) * random.normal(size=(count + 1, 7))
            v = random.choice([0.0, 0.05, 0.2]) * random.normal(size=(count + 1, 7))
            v[-1] = 0.0
            plans.append((NOW + random.uniform(-0.1, 0.0), times, q, v))
        stated = np.full(7, random.choice([0.1, 0.3, np.inf]))
        checked = check(robot, resting())._replace(velocity_deviation=stated)
        one, other = (
            checked._replace(
                stamp=stamp, times=make_read_only(times), q=make_read_only(q), v=make_read_only(v)
            )
            for stamp, times, q, v in plans
        )
        first = NOW + random.uniform(0.0, 0.1)
        last = first + random.choice([0.0, 0.05, 1.0])
        # At all samples too, where velocities are compared.
        dense = np.concatenate(
            [np.linspace(first, last, 2001), one.stamp + one.times, other.stamp + other.times]
        )
        dense = dense[(dense >= first) & (dense <= last)]
        places, paces = (
            np.array([
                Hermite(plan.times, plan.q, plan.v)(
                    np.clip(dense - plan.stamp, 0.0, plan.times[-1]), order
                ) for plan in (one, other)
            ])
            for order in range(2)
        )  # fmt: skip
        apart = np.abs(places[0] - places[1]).max(axis=0)
        found = Following(robot).compare(one, other, first, last).refusal
        allowed = checked.deviation
        if found is None:
            assert (apart <= allowed + 1e-6).all()
        elif found.detail.startswith("off"):
            joint = int(np.flatnonzero(apart > allowed - 1e-6)[0])
            assert found.subject == robot.joints[joint]
            assert float(found.detail.split()[5]) == pytest.approx(apart[joint], rel=1e-2)
        else:
            assert (apart <= allowed + 1e-6).all()
            assert (np.abs(paces[0] - paces[1]).max(axis=0) > stated - 1e-6).any()
        kinds.add(None if found is None else found.detail[:2])
    assert kinds == {None, "of", "go"}


def test_a_plan_that_is_widened_holds_an_arm_on_either(robot):
    """Wherever it is on the other one, within what it may be off that, and however fast."""
    random = np.random.default_rng(4)
    for _ in range(50):
        checked, plans = check(robot, resting()), []
        for count in random.integers(2, 6, 2):
            times = np.append(0.0, np.cumsum(random.uniform(0.05, 0.2, count)))
            q = HOME + 0.02 * random.normal(size=(count + 1, 7))
            v = 0.1 * random.normal(size=(count + 1, 7))
            v[-1] = 0.0
            plans.append(
                checked._replace(
                    stamp=NOW + random.uniform(-0.1, 0.0),
                    times=make_read_only(times),
                    q=make_read_only(q),
                    v=make_read_only(v),
                    deviation=random.uniform(1e-3, 5e-3, 7),
                    velocity_deviation=random.uniform(0.01, 0.1, 7),
                    top_speed=random.uniform(0.1, 1.0, 7),
                )
            )
        one, other = plans
        wide = Following(robot).widen(one, other, NOW)
        assert wide.q is other.q
        assert wide.stamp == other.stamp
        dense = np.linspace(
            NOW, max(one.stamp + one.times[-1], other.stamp + other.times[-1]), 3001
        )
        for order, field in enumerate(("deviation", "velocity_deviation")):
            places = [
                Hermite(plan.times, plan.q, plan.v)(
                    np.clip(dense - plan.stamp, 0.0, plan.times[-1]), order
                ) for plan in (one, other)
            ]  # fmt: skip
            apart = np.abs(places[0] - places[1]).max(axis=0)
            allowed = getattr(wide, field)
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
