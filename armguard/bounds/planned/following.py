"""Whether a measured state, or another plan, agrees with a plan; and how fast an arm is off it."""

from __future__ import annotations

import math

import numpy as np

from armguard.bounds.planned.curve import curve_range, evaluate_curve
from armguard.bounds.planned.plan import CheckedPlan, Refusal
from armguard.jit.arrays import BoolArray, FloatArray
from armguard.jit.kernels import kernel
from armguard.jit.numerics import LIMIT_SLACK
from armguard.robot.robot import Robot
from armguard.robot.turns import find_continuous, nearest_turn

FOLLOWED, PLACE, PACE = 0, 1, 2
"""What `find_straying` can say: nothing, or what is off."""


@kernel
def _deviation_speed(deviation: float, acceleration: float, time: float) -> float:
    """How fast what stays within +-deviation for `time` can be at either end of that time.

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
    times: FloatArray,
    q: FloatArray,
    v: FloatArray,
    along: float,
    is_on_time: bool,
    measured_q: FloatArray,
    measured_v: FloatArray,
    deviation: FloatArray,
    speed: FloatArray,
    velocity_error: FloatArray,
    position_error: FloatArray,
    acceleration: FloatArray,
    continuous: BoolArray,
    position: FloatArray,
    velocity: FloatArray,
) -> tuple[int, int, float, float]:
    """The first joint whose measured state shows that it does not follow a curve.

    Args:
        times: Of the samples, in [s], rising. Shape (k,), k >= 2.
        q: Positions, in [rad] or [m]. Shape (k, nv).
        v: Velocities, in [rad]/[s] or [m]/[s]. Shape (k, nv).
        along: Where on the curve the arm is to be, in [s]; negative: that long before it begins.
        is_on_time: Whether the curve is followed as its times say; else by a clock that goes at any
            pace from 0 to 1.
        measured_q: Measured positions, in [rad] or [m]. Shape (nv,).
        measured_v: Measured velocities, in [rad]/[s] or [m]/[s]. Shape (nv,).
        deviation: How far positions may be off, in [rad] or [m]. Shape (nv,).
        speed: How far velocities may be off, in [rad]/[s] or [m]/[s]. Shape (nv,).
        velocity_error: What measured velocities may be off by, in [rad]/[s] or [m]/[s]. (nv,).
        position_error: What measured positions may be off by, in [rad] or [m]. Shape (nv,).
        acceleration: Limits, in [rad]/[s²] or [m]/[s²]. Shape (nv,).
        continuous: Which joints have no position limits. Shape (nv,).
        position: Filled with the curve's positions. Shape (nv,).
        velocity: Filled with the curve's velocities. Shape (nv,).

    Returns:
        FOLLOWED, PLACE or PACE; the joint, what it was found to be at or to go at, and what was
        allowed.
    """
    evaluate_curve(times, q, v, along, position, velocity)
    # Until the curve begins, a joint goes on as it was measured, more or less.
    wait = max(-along, 0.0)
    for j in range(q.shape[1]):
        reach = wait * (velocity_error[j] + 0.5 * acceleration[j] * wait)
        allowed = deviation[j] + reach + LIMIT_SLACK
        if wait > 0.0:
            allowed += position_error[j]
        found = measured_q[j] + wait * measured_v[j]
        if continuous[j]:
            found = nearest_turn(found, position[j])
        if not abs(found - position[j]) <= allowed:
            return PLACE, j, found, allowed
    slowest, fastest = 0.0, 1.0
    for j in range(q.shape[1]):
        allowed = speed[j] + velocity_error[j] + acceleration[j] * wait + LIMIT_SLACK
        ahead = velocity[j]
        if is_on_time or not abs(ahead) > LIMIT_SLACK:
            if not abs(measured_v[j] - ahead) <= allowed + (0.0 if is_on_time else LIMIT_SLACK):
                return PACE, j, measured_v[j], allowed
            continue
        # One pace of the clock must do for all joints.
        one, other = (measured_v[j] - allowed) / ahead, (measured_v[j] + allowed) / ahead
        slowest = max(slowest, min(one, other) - LIMIT_SLACK)
        fastest = min(fastest, max(one, other) + LIMIT_SLACK)
        if not slowest <= fastest:
            return PACE, j, measured_v[j], allowed
    return FOLLOWED, -1, 0.0, 0.0


def check_following(
    plan: CheckedPlan,
    robot: Robot,
    q: FloatArray,
    v: FloatArray,
    stamp: float,
    path_time: float | None = None,
) -> Refusal | None:
    """Why a measured state shows that the arm does not follow a plan; None if it may.

    Before the plan begins, the state must allow for being where it begins by then; after its end
    the arm stays there.

    Args:
        plan: As checked.
        robot: Whose limits and errors apply.
        q: Measured joint positions, in [rad] or [m]. Shape (nv,).
        v: Measured joint velocities, in [rad]/[s] or [m]/[s]. Shape (nv,).
        stamp: When they were measured, in [s].
        path_time: Where on the plan the arm says it is, in [s] as in the plan's times; None: it
            follows the plan on time.
    """
    is_on_time = path_time is None
    along = stamp - plan.stamp if path_time is None else max(path_time, 0.0)
    position, velocity, speed = np.empty((3, len(q)))
    fill_deviation_speed(
        plan.deviation, plan.acceleration, plan.velocity_deviation, math.inf, speed
    )
    kind, joint, found, allowed = find_straying(
        plan.times, plan.q, plan.v, along, is_on_time, q, v, plan.deviation, speed,
        robot.velocity_error, robot.position_error, robot.acceleration_limit,
        find_continuous(robot.lower_position_limit, robot.upper_position_limit), position, velocity,
    )  # fmt: skip
    if kind == FOLLOWED:
        return None
    when = f"when it begins, {-along:.3g} s on," if along < 0.0 else f"{along:.3g} s into the plan"
    if kind == PLACE:
        what = f"at {found:.6g} {when} where the plan has it at {position[joint]:.6g}"
    else:
        some = "" if is_on_time else " or less"
        what = f"at velocity {found:.4g} {when} where the plan has {velocity[joint]:.4g}{some}"
    return Refusal(robot.joints[joint], f"{what}, expected within {allowed:.3g}")


@kernel
def _evaluate_all(
    times: FloatArray,
    q: FloatArray,
    v: FloatArray,
    along: FloatArray,
    position: FloatArray,
    velocity: FloatArray,
) -> None:
    """`evaluate_curve` at many times, (k,); `position` and `velocity` are (k, nv)."""
    for k in range(along.shape[0]):
        evaluate_curve(times, q, v, along[k], position[k], velocity[k])


def find_disagreement(
    before: CheckedPlan,
    after: CheckedPlan,
    robot: Robot,
    first: float,
    last: float,
) -> Refusal | None:
    """Where two plans differ by more than the arm may be off either; None if nowhere.

    Args:
        before: A plan that the arm may be following.
        after: The one that is to take its place.
        robot: Whose joints these are.
        first: From when on they must agree, in [s].
        last: Until when, in [s], >= first.
    """
    knots = np.concatenate([[first, last], before.stamp + before.times, after.stamp + after.times])
    knots = np.unique(knots[(knots >= first) & (knots <= last)])
    if len(knots) == 1:
        knots = np.append(knots, np.nextafter(knots[0], math.inf))
    shape = len(knots), len(robot.joints)
    apart, pace, place, rate = np.empty(shape), np.empty(shape), np.empty(shape), np.empty(shape)
    _evaluate_all(before.times, before.q, before.v, knots - before.stamp, place, rate)
    _evaluate_all(after.times, after.q, after.v, knots - after.stamp, apart, pace)
    apart -= place
    pace -= rate
    # Both are cubic between these, and so is their difference.
    low, high, speed, other = np.empty((4, len(robot.joints)))
    curve_range(knots - first, apart, pace, 0.0, float(knots[-1] - first), low, high)
    allowed = np.minimum(before.deviation, after.deviation)
    for plan, room in ((before, speed), (after, other)):
        fill_deviation_speed(
            plan.deviation, plan.acceleration, plan.velocity_deviation, math.inf, room
        )
    for name, least, most, room in (
        ("", low, high, allowed),
        ("goes ", pace.min(axis=0), pace.max(axis=0), np.minimum(speed, other)),
    ):
        off = np.maximum(-least, most)
        wrong = np.flatnonzero(~(off <= room + LIMIT_SLACK))
        if len(wrong):
            j = int(wrong[0])
            samples = np.abs(pace[:, j] if name else apart[:, j])
            when = float(knots[int(np.argmax(samples))])
            return Refusal(
                robot.joints[j],
                f"{name}off the committed piece by {off[j]:.4g} at {when:.6g} s, expected within "
                f"{room[j]:.3g} from {first:.6g} s to {last:.6g} s",
            )
    return None


def is_covered(before: CheckedPlan, after: CheckedPlan, robot: Robot, first: float) -> bool:
    """Whether an arm on one plan is on another as well, from some time on until both end.

    It is then no faster off the other, either: from where it leaves, it gets no farther.

    Args:
        before: The plan that the arm may be on.
        after: The other.
        robot: Whose joints these are.
        first: From when on, in [s].
    """
    if not (
        (before.deviation <= after.deviation + LIMIT_SLACK).all()
        and (before.velocity_deviation <= after.velocity_deviation).all()
        and (before.acceleration <= after.acceleration + LIMIT_SLACK).all()
    ):
        return False
    # Compared as if neither might be left by more than a slack.
    sharp = np.zeros_like(before.deviation)
    one, other = before._replace(deviation=sharp), after._replace(deviation=sharp)
    last = max(before.end, after.end, first)
    return find_disagreement(one, other, robot, first, last) is None
