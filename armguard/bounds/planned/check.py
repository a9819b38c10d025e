"""What a controller is about to do: plans, checked against the robot and against where it is.

A `Plan` is the next piece of a trajectory, or all of it, with how far off it the arm may be.
`check_plan` either refuses it, and says why, or hands back a `CheckedPlan`, which exists only if
all of this holds: the curve through its samples keeps to the robot's limits everywhere, not just at
samples, and ends at rest; it is due now; and the arm is where the plan begins, or follows it
already.

Nothing is clamped or guessed. What is not within limits is refused.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from armguard.bounds.planned import curve
from armguard.bounds.planned.curve import CurvePeaks, evaluate_curve, find_excess
from armguard.bounds.planned.following import check_following
from armguard.bounds.planned.plan import (
    CheckedPlan,
    Plan,
    PlanLimits,
    Refusal,
    read_plan,
    read_plan_limits,
)
from armguard.bounds.planned.stop import bound_path_braking, find_hard_stop
from armguard.jit.arrays import FloatArray
from armguard.jit.kernels import kernel
from armguard.jit.numerics import LIMIT_SLACK
from armguard.robot.brakes import BrakeCurves, find_decelerations, find_gentlest_stop
from armguard.robot.robot import Robot
from armguard.robot.turns import (
    align_turns,
    find_continuous,
    has_continuous,
    unwrap,
)

ENDS = -1
"""What `_judge_curve` can say beside what `find_excess` does: it does not end at rest."""


class CurveErrors(NamedTuple):
    """The samples of a plan, and how far off its curve the arm may be by the controller's word."""

    times: FloatArray
    """[s]. Shape (k,)."""
    q: FloatArray
    """[rad] or [m]. Shape (k, nv)."""
    v: FloatArray
    """[rad]/[s] or [m]/[s]. Shape (k, nv)."""
    error: FloatArray
    """[rad] or [m]. Shape (nv,)."""
    stop_error: FloatArray
    """While the arm stops on its path, in [rad] or [m]. Shape (nv,)."""
    velocity_error: FloatArray
    """[rad]/[s] or [m]/[s]; inf where none is stated. Shape (nv,)."""


def check_plan(
    plan: Plan,
    robot: Robot,
    now: float,
    q: ArrayLike,
    v: ArrayLike,
    stamp: float,
    *,
    longest_lead: float = 0.1,
    longest_lag: float = 0.1,
) -> CheckedPlan | Refusal:
    """Check a plan; nothing that is given in it makes this raise.

    Args:
        plan: What the controller is about to do.
        robot: Whose limits and errors apply.
        now: In [s] on the clock of all stamps.
        q: Measured joint positions, believed already, in [rad] or [m]. Shape (nv,).
        v: Measured joint velocities, believed already, in [rad]/[s] or [m]/[s]. Shape (nv,).
        stamp: When they were measured, in [s].
        longest_lead: How far ahead of `now` the plan may begin, in [s].
        longest_lag: How long ago it may have begun, in [s].
    """
    read = read_plan(plan, len(robot.joints))
    if isinstance(read, Refusal):
        return read
    with np.errstate(all="ignore"):
        return _check_read(read, robot, now, q, v, stamp, longest_lead, longest_lag)


def _check_read(
    read: Plan,
    robot: Robot,
    now: float,
    q: ArrayLike,
    v: ArrayLike,
    stamp: float,
    longest_lead: float,
    longest_lag: float,
) -> CheckedPlan | Refusal:
    position, velocity = np.array(q, dtype=np.float64), np.array(v, dtype=np.float64)
    refusal = _check_time(read, now, longest_lead, longest_lag)
    if refusal is not None:
        return refusal
    limits = read_plan_limits(robot)
    if has_continuous(limits.lower, limits.upper):
        read = _align(read, robot, position, velocity, stamp)
    times = np.asarray(read.times)
    end = read.stamp + float(times[-1])
    # The sums of stamps below are off by as much as this, and by that time joints have moved.
    clock = 4.0 * float(np.spacing(max(abs(now), abs(stamp), abs(read.stamp), abs(end))))
    room = CurveRoom(*np.empty((len(CurveRoom._fields), len(robot.joints))))
    refusal = _check_curve(read, robot, limits, clock, room)
    if refusal is not None:
        return refusal
    checked = CheckedPlan(
        stamp=read.stamp,
        times=times,
        q=np.asarray(read.q),
        v=np.asarray(read.v),
        deviation=room.deviation,
        stop_deviation=room.stop_deviation,
        acceleration=room.acceleration,
        velocity_deviation=room.velocity_deviation,
        top_speed=room.top_speed,
        top_speedup=room.top_speedup,
        now=float(now),
        measured_stamp=float(stamp),
        measured_q=position,
        measured_v=velocity,
    )
    return check_following(checked, robot, position, velocity, stamp) or checked


def _align(plan: Plan, robot: Robot, q: FloatArray, v: FloatArray, stamp: float) -> Plan:
    """The same plan with its continuous joints' positions whole turns nearest to each other.

    So a planner may wrap (`unwrap`). The whole is shifted by whole turns to where the joint state
    is; see `turns` for why that changes nothing.
    """
    continuous = find_continuous(robot.lower_position_limit, robot.upper_position_limit)
    fastest = robot.velocity_limit + robot.velocity_error + LIMIT_SLACK
    times = np.asarray(plan.times)
    positions = unwrap(times, np.asarray(plan.q), np.where(continuous, fastest, np.inf))
    along = stamp - plan.stamp
    place, pace = np.empty(len(q)), np.empty(len(q))
    evaluate_curve(times, positions, np.asarray(plan.v), along, place, pace)
    positions += align_turns(place, q + max(-along, 0.0) * v, continuous) - place
    positions.flags.writeable = False
    return plan._replace(q=positions)


def _check_time(plan: Plan, now: float, longest_lead: float, longest_lag: float) -> Refusal | None:
    lead = plan.stamp - now
    end = lead + float(np.asarray(plan.times)[-1])
    if not math.isfinite(lead):
        return Refusal("plan", f"begins at {plan.stamp}, now being {now}")
    if not end > 0.0:
        return Refusal("plan", f"lies in the past: it ended {-end:.4g} s ago")
    if not lead >= -longest_lag:
        return Refusal(
            "plan", f"is stale: it began {-lead:.4g} s ago, expected at most {longest_lag:.4g} s"
        )
    if not lead <= longest_lead:
        return Refusal("plan", f"begins in {lead:.4g} s, expected at most {longest_lead:.4g} s")
    return None


class CurveRoom(NamedTuple):
    """Fields of a `CheckedPlan` that follow from its samples. Shape (nv,) each."""

    deviation: FloatArray
    stop_deviation: FloatArray
    acceleration: FloatArray
    velocity_deviation: FloatArray
    top_speed: FloatArray
    top_speedup: FloatArray


@kernel
def _judge_curve(
    plan: CurveErrors, limits: PlanLimits, clock: float, room: CurveRoom
) -> tuple[int, int, int, float, float, float]:
    """What `find_excess` finds of a curve, or ENDS; and between what it should be.

    Fills the room that there is about a curve that is within limits.
    """
    joints = limits.lower.shape[0]
    lower, upper = np.empty(joints), np.empty(joints)
    fastest, allowed = np.empty(joints), np.empty(joints)
    for j in range(joints):
        lower[j] = limits.lower[j] - limits.position_error[j] - LIMIT_SLACK
        upper[j] = limits.upper[j] + limits.position_error[j] + LIMIT_SLACK
        fastest[j] = limits.velocity[j] + limits.velocity_error[j] + LIMIT_SLACK
        allowed[j] = limits.acceleration[j] * (1.0 + LIMIT_SLACK)
    peaks = CurvePeaks(room.acceleration, room.top_speedup, room.top_speed)
    kind, joint, sample, value = find_excess(
        plan.times, plan.q, plan.v, lower, upper, fastest, allowed, peaks
    )
    if kind == curve.POSITION:
        return kind, joint, sample, value, lower[joint], upper[joint]
    if kind == curve.VELOCITY:
        return kind, joint, sample, value, 0.0, fastest[joint]
    if kind != curve.FINE:
        return kind, joint, sample, value, 0.0, limits.acceleration[joint]
    last = plan.times.shape[0] - 1
    for j in range(joints):
        # Nothing is known of where an arm gets to that does not rest at the end.
        if not abs(plan.v[last, j]) <= LIMIT_SLACK:
            return ENDS, j, last, plan.v[last, j], 0.0, 0.0
        off = plan.error[j] + limits.position_error[j] + clock * limits.velocity[j]
        room.deviation[j] = off
        room.stop_deviation[j] = off
        if plan.stop_error[j] > plan.error[j]:
            room.stop_deviation[j] = max(off, off - plan.error[j] + plan.stop_error[j])
        room.acceleration[j] += limits.acceleration[j]
        room.velocity_deviation[j] = plan.velocity_error[j] + limits.velocity_error[j]
    return kind, -1, -1, 0.0, 0.0, 0.0


def _check_curve(
    plan: Plan, robot: Robot, limits: PlanLimits, clock: float, room: CurveRoom
) -> Refusal | None:
    """Limits on the whole curve, and whether it ends at rest; fills the room about it."""
    error, stop, speed = plan.tracking_error, plan.stop_tracking_error, plan.velocity_tracking_error
    errors = CurveErrors(
        np.asarray(plan.times),
        np.asarray(plan.q),
        np.asarray(plan.v),
        np.asarray(error),
        np.asarray(error if stop is None else stop),
        np.full(len(room.deviation), np.inf) if speed is None else np.asarray(speed),
    )
    kind, joint, sample, value, least, most = _judge_curve(errors, limits, clock, room)
    if kind == curve.FINE:
        return None
    if kind == ENDS:
        return Refusal(
            robot.joints[joint],
            f"ends at velocity {value:.4g}, expected at rest; Monitor.with_stop appends a stop",
        )
    where = f"between {errors.times[sample]:.6g} s and {errors.times[sample + 1]:.6g} s"
    if kind == curve.POSITION:
        problem = f"goes to {value:.6g} {where}"
        expected = f"limits with errors are {least:.6g} to {most:.6g}"
    elif kind == curve.VELOCITY:
        problem = f"goes at {value:.4g} {where}"
        expected = f"limit with error is {most:.4g}"
    elif kind == curve.RATE:
        problem = f"accelerates at {value:.4g} {where}"
        expected = f"limit is {most:.4g}"
    else:
        problem = f"positions and velocities do not agree {where}"
        expected = f"joining them takes an acceleration of {value:.4g}, limit is {most:.4g}"
    return Refusal(robot.joints[joint], f"{problem}; {expected}")


def check_stop(plan: CheckedPlan, robot: Robot, brakes: BrakeCurves) -> Refusal | None:
    """Why brakes do not guarantee the stop that a piece carries; None if they do.

    Args:
        plan: As checked.
        robot: Whose joints they are.
        brakes: How these stop.
    """
    kind, joint, found, most, when = _judge_stop(plan.times, plan.q, plan.v, plan.top_speed, brakes)
    if kind == curve.FINE:
        return None
    if kind == curve.VELOCITY:
        return _refuse_speed(robot.joints[joint], found, most)
    return Refusal(
        robot.joints[joint],
        f"comes to rest at {found:.4g} from {when:.6g} s on, brakes guarantee {most:.4g}",
    )


@kernel
def _judge_stop(
    times: FloatArray, q: FloatArray, v: FloatArray, speeds: FloatArray, brakes: BrakeCurves
) -> tuple[int, int, float, float, float]:
    """Whether a curve of such top speeds, (nv,), ends in a stop that brakes guarantee: FINE.

    Else VELOCITY or RATE; and the joint, what was found, what is guaranteed, and when.
    """
    last = brakes.speed.shape[1] - 1
    for j in range(speeds.shape[0]):
        if not speeds[j] <= brakes.speed[j, last] * (1.0 + LIMIT_SLACK):
            return curve.VELOCITY, j, speeds[j], brakes.speed[j, last], 0.0
    allowed = find_gentlest_stop(brakes, speeds)
    most = allowed.copy()
    for j in range(most.shape[0]):
        most[j] *= 1.0 + LIMIT_SLACK
    joint, found, when = find_hard_stop(times, q, v, most)
    if joint < 0:
        return curve.FINE, -1, 0.0, 0.0, 0.0
    return curve.RATE, joint, found, allowed[joint], when


def _check_range(speeds: FloatArray, robot: Robot, brakes: BrakeCurves) -> Refusal | None:
    """Whether brakes are stated for all speeds of a plan, (nv,)."""
    off = np.flatnonzero(~(speeds <= brakes.speed[:, -1] * (1.0 + LIMIT_SLACK)))
    if not len(off):
        return None
    j = int(off[0])
    return _refuse_speed(robot.joints[j], float(speeds[j]), float(brakes.speed[j, -1]))


def _refuse_speed(joint: str, speed: float, stated: float) -> Refusal:
    return Refusal(joint, f"goes at {speed:.4g}, brakes are stated up to {stated:.4g}")


def check_path_stop(plan: CheckedPlan, robot: Robot, brakes: BrakeCurves) -> Refusal | None:
    """Why the arm cannot be stopped anywhere on its path; None if it can.

    Args:
        plan: As checked.
        robot: Whose joints they are.
        brakes: How these stop: what is guaranteed at each instant counts, for a stop on the path
            slows down all joints but one by less than their brakes would.
    """
    refusal = _check_range(plan.top_speed, robot, brakes)
    if refusal is not None:
        return refusal
    braking = find_decelerations(brakes, plan.top_speed)
    found, joint, when = bound_path_braking(
        plan.times, plan.q, plan.v, braking, 0.0, float(plan.times[-1])
    )
    if found > 0.0:
        return None
    return Refusal(
        robot.joints[joint],
        f"bends at {braking[joint] - found:.4g} after {when:.6g} s: no stop on "
        f"the path is within the {braking[joint]:.4g} that brakes guarantee",
    )
