from __future__ import annotations

import math

import numpy as np
import pytest

from armguard import ArmguardError
from armguard.jit.numerics import (
    POSITION_BY_ACCEL,
    POSITION_BY_SPEED,
    VELOCITY_BY_ACCEL,
    VELOCITY_BY_SPEED,
)
from armguard.robot.joint_history import (
    PASSED,
    REFERENCE_AGES,
    begin_history,
    extend_history,
    find_failure,
    make_history,
)

INF = math.inf
LIMITS = {
    "velocity_limit": np.array([2.0, 0.5, 3.0]),
    "acceleration_limit": np.array([15.0, 7.5, 20.0]),
}


class History:
    """Joint states as they are accepted, one after the other; finite, and stamps that rise."""

    def __init__(self, *limits):
        self.kept = make_history(*limits)
        self.numbers = np.zeros(3)
        self.empty = True
        self.joint = -1

    def accept(self, stamp, q, v):
        self.joint = -1
        if self.empty:
            begin_history(self.kept, stamp, q, v)
        code, self.joint = self.find(stamp, q, v)
        if code != PASSED:
            return code
        if not self.empty:
            extend_history(self.kept, stamp, q, v)
        self.empty = False
        return PASSED

    def find(self, stamp, q, v):
        return find_failure(self.kept, stamp, q, v, self.numbers)


def history(position_error=1e-3, velocity_error=0.02):
    return History(*LIMITS.values(), np.full(3, position_error), np.full(3, velocity_error))


def move_joints(rng, steps, period):
    """True joint states that press against their limits: constant acceleration in each step."""
    top, accel = LIMITS["velocity_limit"], LIMITS["acceleration_limit"]
    stamp, q, v = 0.0, np.zeros(3), np.zeros(3)
    push = np.zeros(3)
    for step in range(steps):
        yield stamp, q.copy(), v.copy()
        h = period * rng.uniform(0.2, 1.8)
        if step % 50 == 0:
            push = accel * rng.choice([-1.0, 0.0, 1.0, rng.uniform(-1, 1)], size=3)
        after = np.clip(v + push * h, -top, top)
        q = q + (v + after) / 2 * h
        v = after
        stamp += h


@pytest.mark.parametrize("period", [1e-3, 2e-2])
@pytest.mark.parametrize(
    ("position_error", "velocity_error"), [(1e-3, 0.02), (1e-3, 1e-9), (1e-9, 0.02), (1e-11, 1e-9)]
)
def test_joints_within_limits_and_errors_never_fail(period, position_error, velocity_error):
    rng = np.random.default_rng(3)
    for epoch in (0.0, 12345.0, 1.7e9):
        joints = history(position_error, velocity_error)
        for stamp, q, v in move_joints(rng, 4000, period):
            q = q + position_error * rng.choice([-1.0, 1.0], size=3) * (1 - 1e-9)
            v = v + velocity_error * rng.choice([-1.0, 1.0], size=3) * (1 - 1e-9)
            assert joints.accept(epoch + stamp, q, v) == PASSED
            assert joints.joint == -1


@pytest.mark.parametrize("age", REFERENCE_AGES[1:])
def test_a_creep_is_found_as_soon_after_a_long_rest_as_after_a_short_one(age):
    """A joint that says it rests and moves all the same; only a look that far back can tell.

    Within acceleration and errors it may seem to be off its rest by 2 e + (A s / 2 + d) s after a
    time s, and the limit is chosen such that this, per time, is least at the age in question.
    """
    period, position_error, velocity_error = age / 50.0, 1e-3, 1e-4
    accel = 4.0 * position_error / age**2
    pace = 1.02 * (2.0 * position_error / age + 0.5 * accel * age + velocity_error)
    limits = [10.0 * pace], [accel], [position_error], [velocity_error]
    for rest in (0, 20, 500, 517, 531):
        joints = History(*(np.array(limit) for limit in limits))
        for k in range(rest):
            assert joints.accept(k * period, np.zeros(1), np.zeros(1)) == PASSED
        found = []
        for k in range(200):
            q = np.array([k * period * pace])
            found.append(joints.accept((rest + k) * period, q, np.zeros(1)))
            if found[-1] != PASSED:
                break
        assert found[-1] == POSITION_BY_ACCEL
        # No state can be older than twice the age when its place is taken.
        assert len(found) * period <= 2.0 * age + 2.0 * period


def test_what_is_told_of_a_failure_is_more_than_what_is_allowed():
    """Whatever fails: and the motion that is told fits in the time that is told."""
    rng, codes = np.random.default_rng(6), set()
    for _ in range(60):
        joints = history(rng.choice([0.0, 1e-3]), rng.choice([1e-3, 0.02]))
        stamp, q, v = 0.0, np.zeros(3), rng.choice([0.0, 1.0]) * LIMITS["velocity_limit"]
        for _ in range(200):
            stamp += rng.choice([0.0, 1e-3, 0.01])
            wild = rng.choice([1.0, 1.0, 1.0, 3.0])
            q = q + v * 1e-3 + rng.uniform(-1.0, 1.0, 3) * 1e-3 * wild
            v = np.clip(v + rng.uniform(-1.0, 1.0, 3) * 0.02 * wild, -3.1, 3.1)
            last = joints.kept.stamps[0], joints.kept.positions[0].copy()
            code = joints.accept(stamp, q, v)
            if code == PASSED:
                continue
            codes.add(code)
            value, allowed, duration = joints.numbers
            assert value > allowed >= 0.0
            if code == POSITION_BY_SPEED:
                assert value == abs(q - last[1])[joints.joint]
                assert duration == stamp - last[0]
            q, v = joints.kept.positions[0].copy(), joints.kept.velocities[0].copy()
    assert codes == {POSITION_BY_ACCEL, POSITION_BY_SPEED, VELOCITY_BY_ACCEL, VELOCITY_BY_SPEED}


def test_what_is_no_number_never_passes():
    joints = history()
    rest = np.zeros(3)
    assert joints.accept(1.0, rest, rest) == PASSED
    for bad in (math.nan, INF, -INF):
        wrong = np.array([0.0, bad, 0.0])
        assert joints.find(1.0, wrong, rest)[1] == joints.find(1.0, rest, wrong)[1] == 1
    assert joints.find(1.0, rest, rest) == (PASSED, -1)


@pytest.mark.parametrize("bad", [-1.0, math.nan, INF])
def test_limits_must_be_limits(bad):
    with pytest.raises(ArmguardError, match="joint limits"):
        make_history([bad], [1.0], [0.0], [0.0])
