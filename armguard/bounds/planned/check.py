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

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armguard.bounds.planned import curve
from armguard.bounds.planned.curve import CurvePeaks, evaluate_curve, find_excess, make_peaks
from armguard.bounds.planned.following import check_following
from armguard.bounds.planned.plan import CheckedPlan, Plan, Refusal, read_plan
from armguard.bounds.planned.stop import bound_path_braking, find_hard_stop
from armguard.jit.arrays import FloatArray
from armguard.jit.numerics import LIMIT_SLACK
from armguard.robot.brakes import BrakeCurves, find_decelerations, find_gentlest_stop
from armguard.robot.robot import Robot
from armguard.robot.turns import MOST_TURNS, TURN, align_turns, find_continuous


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
    read = _align(read, robot, position, velocity, stamp)
    peaks = make_peaks(len(robot.joints))
    refusal = _check_curve(read, robot, peaks) or _check_end(read, robot)
    if refusal is not None:
        return refusal
    times, errors = np.asarray(read.times), np.asarray(read.tracking_error)
    end = read.stamp + float(times[-1])
    # The sums of stamps below are off by as much as this, and by that time joints have moved.
    clock = 4.0 * float(np.spacing(max(abs(now), abs(stamp), abs(read.stamp), abs(end))))
    deviation = errors + robot.position_error + clock * robot.velocity_limit
    stop_deviation = deviation
    if read.stop_tracking_error is not None:
        stop_deviation = deviation - errors + np.asarray(read.stop_tracking_error)
    stated = np.full(len(errors), np.inf)
    if read.velocity_tracking_error is not None:
        stated = np.asarray(read.velocity_tracking_error) + robot.velocity_error
    acceleration = robot.acceleration_limit + peaks.acceleration
    checked = CheckedPlan(
        stamp=read.stamp,
        times=times,
        q=np.asarray(read.q),
        v=np.asarray(read.v),
        deviation=deviation,
        stop_deviation=np.maximum(deviation, stop_deviation),
        acceleration=acceleration,
        velocity_deviation=stated,
        top_speed=peaks.speed,
        top_speedup=peaks.speedup,
        now=float(now),
        measured_stamp=float(stamp),
        measured_q=position,
        measured_v=velocity,
    )
    return check_following(checked, robot, position, velocity, stamp) or checked


def _find_continuous(robot: Robot) -> NDArray[np.bool_]:
    return find_continuous(robot.lower_position_limit, robot.upper_position_limit)


def _align(plan: Plan, robot: Robot, q: FloatArray, v: FloatArray, stamp: float) -> Plan:
    """The same plan with its continuous joints' positions whole turns nearest to each other.

    So a planner may wrap. From sample to sample only where the joint's velocity limit does not let
    it go half a turn in that time: then no other number of turns is a motion within limits, and
    nothing is guessed. A longer step is taken as it was written. The whole is shifted by whole
    turns to where the joint state is; see `turns` for why that changes nothing.
    """
    continuous = _find_continuous(robot)
    if not continuous.any():
        return plan
    times, positions = np.asarray(plan.times), np.array(plan.q)
    fastest = robot.velocity_limit + robot.velocity_error + LIMIT_SLACK
    for j in np.flatnonzero(continuous):
        with np.errstate(over="ignore"):
            turns = -np.floor(np.diff(positions[:, j]) / TURN + 0.5)
        is_sure = (fastest[j] * np.diff(times) < 0.5 * TURN) & (np.abs(turns) <= MOST_TURNS)
        positions[1:, j] += TURN * np.cumsum(np.where(is_sure, turns, 0.0))
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


def _check_curve(plan: Plan, robot: Robot, peaks: CurvePeaks) -> Refusal | None:
    """Limits on the whole curve; fills what it does at most."""
    times = np.asarray(plan.times)
    lower = robot.lower_position_limit - robot.position_error - LIMIT_SLACK
    upper = robot.upper_position_limit + robot.position_error + LIMIT_SLACK
    fastest = robot.velocity_limit + robot.velocity_error + LIMIT_SLACK
    allowed = robot.acceleration_limit * (1.0 + LIMIT_SLACK)
    kind, joint, sample, value = find_excess(
        times, np.asarray(plan.q), np.asarray(plan.v), lower, upper, fastest, allowed, peaks
    )
    if kind == curve.FINE:
        return None
    where = f"between {times[sample]:.6g} s and {times[sample + 1]:.6g} s"
    if kind == curve.POSITION:
        problem = f"goes to {value:.6g} {where}"
        expected = f"limits with errors are {lower[joint]:.6g} to {upper[joint]:.6g}"
    elif kind == curve.VELOCITY:
        problem = f"goes at {value:.4g} {where}"
        expected = f"limit with error is {fastest[joint]:.4g}"
    elif kind == curve.RATE:
        problem = f"accelerates at {value:.4g} {where}"
        expected = f"limit is {robot.acceleration_limit[joint]:.4g}"
    else:
        problem = f"positions and velocities do not agree {where}"
        expected = (
            f"joining them takes an acceleration of {value:.4g}, "
            f"limit is {robot.acceleration_limit[joint]:.4g}"
        )
    return Refusal(robot.joints[joint], f"{problem}; {expected}")


def _check_end(plan: Plan, robot: Robot) -> Refusal | None:
    """Whether it ends at rest: nothing is known of where an arm gets to that does not."""
    v = np.asarray(plan.v)[-1]
    off = np.flatnonzero(~(np.abs(v) <= LIMIT_SLACK))
    if not len(off):
        return None
    j = int(off[0])
    return Refusal(
        robot.joints[j],
        f"ends at velocity {v[j]:.4g}, expected at rest; Monitor.with_stop appends a stop",
    )


def check_stop(plan: CheckedPlan, robot: Robot, brakes: BrakeCurves) -> Refusal | None:
    """Why brakes do not guarantee the stop that a piece carries; None if they do.

    Args:
        plan: As checked.
        robot: Whose joints they are.
        brakes: How these stop.
    """
    refusal = _check_range(plan.top_speed, robot, brakes)
    if refusal is not None:
        return refusal
    allowed = find_gentlest_stop(brakes, plan.top_speed)
    joint, found, when = find_hard_stop(plan.times, plan.q, plan.v, allowed * (1.0 + LIMIT_SLACK))
    if joint < 0:
        return None
    return Refusal(
        robot.joints[joint],
        f"comes to rest at {found:.4g} from {when:.6g} s on, brakes guarantee {allowed[joint]:.4g}",
    )


def _check_range(speeds: FloatArray, robot: Robot, brakes: BrakeCurves) -> Refusal | None:
    """Whether brakes are stated for all speeds of a plan, (nv,)."""
    off = np.flatnonzero(~(speeds <= brakes.speed[:, -1] * (1.0 + LIMIT_SLACK)))
    if not len(off):
        return None
    j = int(off[0])
    detail = f"goes at {speeds[j]:.4g}, brakes are stated up to {brakes.speed[j, -1]:.4g}"
    return Refusal(robot.joints[j], detail)


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
