"""Tests whether a measured state or another plan agrees with a plan; bounds deviation speeds."""

from __future__ import annotations

import math

import numpy as np

from armguard.bounds.limits import JointLimits, read_limits
from armguard.bounds.planned.curve import curve_range, evaluate_curve
from armguard.bounds.planned.findings import APART, DRIFTS, FINE, PACE, PLACE, describe
from armguard.bounds.planned.plan import CheckedPlan, Refusal, make_example
from armguard.jit.arrays import FloatArray
from armguard.jit.handle import machine_code, pack
from armguard.jit.kernels import kernel
from armguard.jit.numerics import LIMIT_SLACK
from armguard.robot.robot import Robot
from armguard.robot.wrap_angle import nearest_turn

SHORTEST = 1e-9
"""For how long two plans are compared at the least, in [s]."""


@kernel
def _deviation_speed(deviation: float, acceleration: float, time: float) -> float:
    """Greatest speed, at either end of `time`, of a deviation that stays within +-`deviation`.

    With d the deviation, |d| <= e, and M its greatest acceleration, d(0) = d(s) - d'(0) s + r with
    |r| <= M s²/2, so |d'(0)| <= 2 e/s + M s/2 for every s up to `time`; s = 2 sqrt(e/M) is best.
    """
    if not time > 0.0:
        return math.inf
    span = min(2.0 * math.sqrt(deviation / acceleration), time)
    if not span > 0.0:
        return math.inf
    return (2.0 * deviation / span + 0.5 * acceleration * span) * (1.0 + LIMIT_SLACK)


@kernel
def fill_deviation_speed(
    deviation: FloatArray,
    acceleration: FloatArray,
    stated: FloatArray,
    time: float,
    speed: FloatArray,
) -> None:
    """Fill how fast joints can be off a curve that they stay within a deviation of for some time.

    Args:
        deviation: How far they may be off it, in [rad] or [m]. Shape (nv,).
        acceleration: Greatest acceleration of that, in [rad]/[s²] or [m]/[s²]. Shape (nv,).
        stated: What the controller says, in [rad]/[s] or [m]/[s]. Shape (nv,).
        time: How long they stay, in [s], before or after; 0 or less tells nothing.
        speed: Filled. Shape (nv,).
    """
    for j in range(deviation.shape[0]):
        speed[j] = min(stated[j], _deviation_speed(deviation[j], acceleration[j], time))


@kernel
def find_straying(
    plan: CheckedPlan, limits: JointLimits, q: FloatArray, v: FloatArray, along: float
) -> tuple[int, int, float, float, float, float]:
    """The first joint whose measured state shows that it does not follow a plan.

    Args:
        plan: As checked.
        limits: Of the robot that it was checked for; or a handle on them.
        q: Measured positions, in [rad] or [m]. Shape (nv,).
        v: Measured velocities, in [rad]/[s] or [m]/[s]. Shape (nv,).
        along: Where on the plan the arm is to be, in [s]; negative: that long before it begins.

    Returns:
        The fields of a `Finding`: PLACE, PACE or FINE.
    """
    position, velocity = np.empty_like(plan.deviation), np.empty_like(plan.deviation)
    speed = np.empty_like(plan.deviation)
    fill_deviation_speed(
        plan.deviation, plan.acceleration, plan.velocity_deviation, math.inf, speed
    )
    evaluate_curve(plan.times, plan.q, plan.v, along, position, velocity)
    # Until the curve begins, a joint goes on as it was measured, more or less.
    wait = max(-along, 0.0)
    for j in range(position.shape[0]):
        reach = wait * (limits.velocity_error[j] + 0.5 * limits.acceleration[j] * wait)
        allowed = plan.deviation[j] + reach + LIMIT_SLACK
        if wait > 0.0:
            allowed += limits.position_error[j]
        found = q[j] + wait * v[j]
        if math.isinf(limits.lower[j]) and math.isinf(limits.upper[j]):
            found = nearest_turn(found, position[j])
        if not abs(found - position[j]) <= allowed:
            return PLACE, j, found, position[j], allowed, along
    for j in range(position.shape[0]):
        allowed = speed[j] + limits.velocity_error[j] + limits.acceleration[j] * wait + LIMIT_SLACK
        if not abs(v[j] - velocity[j]) <= allowed:
            return PACE, j, v[j], velocity[j], allowed, along
    return FINE, -1, 0.0, 0.0, 0.0, 0.0


class Following:
    """Tells whether measured states, and other plans, agree with plans.

    Args:
        robot: Whose limits and errors apply.
    """

    def __init__(self, robot: Robot) -> None:
        self._joints = robot.joints
        self._limits = pack(read_limits(robot))
        # All that these are handed is an example's like, or a state that was believed.
        plan, one = make_example(), np.zeros(1)
        self._find_straying = machine_code(find_straying, plan, self._limits, one, one, 0.0)
        self._compare = machine_code(_compare, plan, plan, 0.0, 0.0)
        self._is_covered = machine_code(is_covered, plan, plan, 0.0)
        self._find_largest = machine_code(_find_largest_differences, plan, plan, 0.0)

    def check(
        self,
        plan: CheckedPlan,
        q: FloatArray,
        v: FloatArray,
        stamp: float,
    ) -> Refusal | None:
        """Why a measured state shows that the arm does not follow a plan; None if it may.

        Before the plan begins, the state must allow for being where it begins by then; after its
        end the arm stays there.

        Args:
            plan: As checked.
            q: Measured joint positions, in [rad] or [m]. Shape (nv,), contiguous.
            v: Measured joint velocities, in [rad]/[s] or [m]/[s]. Shape (nv,), contiguous.
            stamp: When they were measured, in [s].
        """
        finding = self._find_straying(plan, self._limits, q, v, stamp - plan.stamp)
        return None if finding[0] == FINE else describe(finding, self._joints)

    def compare(
        self, before: CheckedPlan, after: CheckedPlan, first: float, last: float
    ) -> tuple[Refusal | None, bool]:
        """Where two plans disagree for some time, and whether the other one covers the first.

        Args:
            before: A plan that the arm may be following.
            after: The one that is to take its place.
            first: From when on they must agree, in [s].
            last: Until when they must, in [s], >= first.

        Returns:
            Where they differ by more than the arm may be off the first, None if nowhere; and
            `is_covered` from the first of these times on.
        """
        finding, covered = self._compare(before, after, first, last)
        return None if finding[0] == FINE else describe(finding, self._joints), covered

    def covers(self, before: CheckedPlan, after: CheckedPlan, first: float) -> bool:
        """Whether an arm on one plan is on another as well; see `is_covered`."""
        covered: bool = self._is_covered(before, after, first)
        return covered

    def widen(self, before: CheckedPlan, after: CheckedPlan, first: float) -> CheckedPlan:
        """The second plan, with deviations so wide that an arm on the first one is on it as well.

        Args:
            before: A plan that the arm may be on.
            after: Another one.
            first: From when on, until both end, in [s].
        """
        place, pace = self._find_largest(before, after, first)
        return after._replace(
            deviation=np.maximum(after.deviation, before.deviation + place),
            velocity_deviation=np.maximum(
                after.velocity_deviation, before.velocity_deviation + pace
            ),
            top_speed=np.maximum(after.top_speed, before.top_speed),
        )


@kernel
def _find_knots(before: CheckedPlan, after: CheckedPlan, first: float, last: float) -> FloatArray:
    """Both times, and those of samples of either plan between them, each once, in rising order."""
    ones, others = before.stamp + before.times, after.stamp + after.times
    knots = np.empty(ones.shape[0] + others.shape[0] + 2)
    knots[0], count, i, k = first, 1, 0, 0
    while True:
        while i < ones.shape[0] and not ones[i] > knots[count - 1]:
            i += 1
        while k < others.shape[0] and not others[k] > knots[count - 1]:
            k += 1
        knot = ones[i] if i < ones.shape[0] else math.inf
        knot = min(knot, others[k]) if k < others.shape[0] else knot
        if not knot < last:
            break
        knots[count] = knot
        count += 1
    # Two times of which the difference is next to nothing have no slope between them.
    knots[count] = max(last, first + SHORTEST, np.nextafter(first, math.inf))
    return knots[: count + 1]


@kernel
def _fill_difference(
    before: CheckedPlan,
    after: CheckedPlan,
    time: float,
    place: FloatArray,
    pace: FloatArray,
) -> None:
    """Fill how far, and how fast, one plan is ahead of another at a time, in [s]. (nv,) each."""
    other_place, other_pace = np.empty_like(place), np.empty_like(pace)
    evaluate_curve(before.times, before.q, before.v, time - before.stamp, other_place, other_pace)
    evaluate_curve(after.times, after.q, after.v, time - after.stamp, place, pace)
    for j in range(place.shape[0]):
        place[j] -= other_place[j]
        pace[j] -= other_pace[j]


@kernel
def _find_differences(
    before: CheckedPlan, after: CheckedPlan, first: float, last: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Knots, (k,), and how far and how fast one plan is ahead of another at each, (k, nv).

    Both are cubic between knots, and so is their difference.
    """
    knots = _find_knots(before, after, first, last)
    count, joints = knots.shape[0], before.deviation.shape[0]
    apart, pace = np.empty((count, joints)), np.empty((count, joints))
    for k in range(count):
        _fill_difference(before, after, knots[k], apart[k], pace[k])
    return knots, apart, pace


@kernel
def _find_largest_differences(
    before: CheckedPlan, after: CheckedPlan, first: float
) -> tuple[FloatArray, FloatArray]:
    """How far, and how fast, joints on two plans are apart at most until both end; (nv,) each."""
    last = max(before.stamp + before.times[-1], after.stamp + after.times[-1], first)
    knots, apart, pace = _find_differences(before, after, first, last)
    low, high = np.empty_like(before.deviation), np.empty_like(before.deviation)
    curve_range(knots - first, apart, pace, 0.0, knots[-1] - first, 0, low, high)
    place, fastest = np.empty_like(low), np.zeros_like(low)
    for j in range(place.shape[0]):
        # Of a difference that is no number no range is found, and low is above high.
        place[j] = max(high[j], -low[j]) if low[j] <= high[j] else math.inf
    # Velocities are quadratic between knots: such a curve is nowhere farther from 0 than 5/4 of
    # what it is at both ends or in the middle.
    for k in range(2 * knots.shape[0] - 1):
        time = 0.5 * (knots[k // 2] + knots[(k + 1) // 2])
        _fill_difference(before, after, time, low, high)
        for j in range(place.shape[0]):
            if not 1.25 * abs(high[j]) <= fastest[j]:
                fastest[j] = 1.25 * abs(high[j])
    return place, fastest


@kernel
def _find_gap(
    before: CheckedPlan, after: CheckedPlan, share: float, first: float, last: float
) -> tuple[int, int, float, float, float, float]:
    """Where two plans differ by more than a share, in [0, 1], of what the arm may be off the first.

    Returns:
        The fields of a `Finding`: APART, DRIFTS or FINE.
    """
    joints = before.deviation.shape[0]
    knots, apart, pace = _find_differences(before, after, first, last)
    low, high = np.empty(joints), np.empty(joints)
    curve_range(knots - first, apart, pace, 0.0, knots[-1] - first, 0, low, high)
    for j in range(joints):
        allowed = share * before.deviation[j]
        # Of a difference that is no number no range is found, and low is above high.
        if not (-allowed - LIMIT_SLACK <= low[j] <= high[j] <= allowed + LIMIT_SLACK):
            when = knots[_find_largest(apart, j)]
            return APART, j, max(-low[j], high[j]), 0.0, allowed, when
    for j in range(joints):
        # However long it is followed.
        allowed = min(
            before.velocity_deviation[j],
            _deviation_speed(share * before.deviation[j], before.acceleration[j], math.inf),
        )
        largest = _find_largest(pace, j)
        if not abs(pace[largest, j]) <= allowed + LIMIT_SLACK:
            return DRIFTS, j, abs(pace[largest, j]), 0.0, allowed, knots[largest]
    return FINE, -1, 0.0, 0.0, 0.0, 0.0


@kernel
def _find_largest(values: FloatArray, j: int) -> int:
    """The first row of a column, (k, nv), that is the farthest from 0, or no number."""
    largest = 0
    for k in range(1, values.shape[0]):
        if not abs(values[k, j]) <= abs(values[largest, j]):
            largest = k
    return largest


@kernel
def is_covered(before: CheckedPlan, after: CheckedPlan, first: float) -> bool:
    """Whether an arm on one plan is on another as well, from some time on until both end.

    It is then no faster off the other, either: from where it leaves, it gets no farther.

    Args:
        before: The plan that the arm may be on.
        after: The other.
        first: From when on, in [s].
    """
    for j in range(before.deviation.shape[0]):
        if not (
            before.deviation[j] <= after.deviation[j] + LIMIT_SLACK
            and before.velocity_deviation[j] <= after.velocity_deviation[j]
            and before.acceleration[j] <= after.acceleration[j] + LIMIT_SLACK
        ):
            return False
    last = max(before.stamp + before.times[-1], after.stamp + after.times[-1], first)
    # Most plans end at different places, which takes one look.
    place, pace = np.empty_like(before.deviation), np.empty_like(before.deviation)
    _fill_difference(before, after, last, place, pace)
    for j in range(place.shape[0]):
        if not abs(place[j]) <= LIMIT_SLACK:
            return False
    # Compared as if neither might be left by more than a slack.
    return _find_gap(before, after, 0.0, first, last)[0] == FINE


@kernel
def _compare(
    before: CheckedPlan, after: CheckedPlan, first: float, last: float
) -> tuple[tuple[int, int, float, float, float, float], bool]:
    """Where two plans do not agree from `first` to `last`, and `is_covered` from `first` on."""
    return _find_gap(before, after, 1.0, first, last), is_covered(before, after, first)
