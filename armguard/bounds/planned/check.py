"""What a controller is about to do: plans, checked against the robot and against where it is.

A `Plan` is the next piece of a trajectory, with how far off it the arm may be. `check_plan` either
refuses it, and says why, or hands back a `CheckedPlan`, which exists only if all of this holds: the
curve through its samples keeps to the robot's limits everywhere, not just at samples; it is due
now; and the arm is where the plan begins, or follows it already.

Nothing is clamped or guessed. What is not within limits is refused.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armguard.bounds.planned import curve
from armguard.bounds.planned.curve import evaluate_curve, find_excess
from armguard.bounds.planned.plan import Plan, Refusal, read_plan
from armguard.jit.arrays import FloatArray
from armguard.jit.numerics import LIMIT_SLACK
from armguard.robot.robot import Robot
from armguard.robot.turns import MOST_TURNS, TURN, align_turns, find_continuous

__all__ = [
    "CheckedPlan",
    "Plan",
    "Refusal",
    "bound_velocity_deviation",
    "check_following",
    "check_plan",
    "deviation_speed",
]


class CheckedPlan(NamedTuple):
    """A plan that `check_plan` has found within limits and followed. Arrays are its own."""

    stamp: float
    """When the arm is at the first sample, in [s]."""
    times: FloatArray
    """Of the samples, counted from `stamp`, in [s]. Shape (k,)."""
    q: FloatArray
    """[rad] or [m]. Shape (k, nv)."""
    v: FloatArray
    """[rad]/[s] or [m]/[s]. Shape (k, nv)."""
    deviation: FloatArray
    """How far joints may truly be off the curve, all errors included, in [rad] or [m]. (nv,)."""
    acceleration: FloatArray
    """Greatest acceleration of the deviation of joints from the curve: the robot's limit and the
    curve's greatest together, in [rad]/[s²] or [m]/[s²]. Shape (nv,)."""
    velocity_deviation: FloatArray
    """How far velocities may truly be off the curve's as the controller states it, all errors
    included, in [rad]/[s] or [m]/[s]; inf where it does not. Shape (nv,)."""
    now: float
    """When it was checked, in [s]."""
    measured_stamp: float
    """Stamp of the joint state that it was checked against, in [s]."""
    measured_q: FloatArray
    """Of that joint state, in [rad] or [m]. Shape (nv,)."""
    measured_v: FloatArray
    """Of that joint state, in [rad]/[s] or [m]/[s]. Shape (nv,)."""

    @property
    def end(self) -> float:
        """When the arm is at the last sample, in [s]."""
        return self.stamp + float(self.times[-1])


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
    peak = np.empty(len(robot.joints))
    refusal = _check_curve(read, robot, peak) or _check_end(read, robot)
    if refusal is not None:
        return refusal
    times, errors = np.asarray(read.times), np.asarray(read.tracking_error)
    end = read.stamp + float(times[-1])
    # The sums of stamps below are off by as much as this, and by that time joints have moved.
    clock = 4.0 * float(np.spacing(max(abs(now), abs(stamp), abs(read.stamp), abs(end))))
    deviation = errors + robot.position_error + clock * robot.velocity_limit
    stated = np.full(len(errors), np.inf)
    if read.velocity_tracking_error is not None:
        stated = np.asarray(read.velocity_tracking_error) + robot.velocity_error
    acceleration = robot.acceleration_limit + peak
    checked = CheckedPlan(
        stamp=read.stamp,
        times=times,
        q=np.asarray(read.q),
        v=np.asarray(read.v),
        deviation=deviation,
        acceleration=acceleration,
        velocity_deviation=stated,
        now=now,
        measured_stamp=stamp,
        measured_q=position,
        measured_v=velocity,
    )
    return check_following(checked, robot, position, velocity, stamp) or checked


def check_following(
    plan: CheckedPlan, robot: Robot, q: FloatArray, v: FloatArray, stamp: float
) -> Refusal | None:
    """Why a measured state shows that the arm does not follow a plan; None if it may be.

    Before the plan begins, the state must allow for being where it begins by then.

    Args:
        plan: As checked.
        robot: Whose limits and errors apply.
        q: Measured joint positions, in [rad] or [m]. Shape (nv,).
        v: Measured joint velocities, in [rad]/[s] or [m]/[s]. Shape (nv,).
        stamp: When they were measured, in [s].
    """
    along = stamp - plan.stamp
    if not along <= plan.times[-1] + LIMIT_SLACK:
        return Refusal(
            "plan", f"is over: it ended {along - plan.times[-1]:.3g} s before the joint state"
        )
    position, velocity = np.empty(len(q)), np.empty(len(q))
    evaluate_curve(plan.times, plan.q, plan.v, along, position, velocity)
    # Until the plan begins, a joint goes on as it was measured, more or less.
    wait = max(-along, 0.0)
    reach = wait * (robot.velocity_error + 0.5 * robot.acceleration_limit * wait)
    found = align_turns(q + wait * v, position, _find_continuous(robot))
    allowed = plan.deviation + reach + LIMIT_SLACK + (wait > 0.0) * robot.position_error
    off = np.flatnonzero(~(np.abs(found - position) <= allowed))
    when = f"when it begins, {wait:.3g} s on," if wait > 0.0 else f"{along:.3g} s into the plan"
    if len(off):
        j = int(off[0])
        return Refusal(
            robot.joints[j],
            f"at {found[j]:.6g} {when} where the plan has it at {position[j]:.6g}, "
            f"expected within {allowed[j]:.3g}",
        )
    speed = deviation_speed(plan.deviation, plan.acceleration, plan.times[-1] - max(along, 0.0))
    allowed = np.minimum(plan.velocity_deviation, speed) + robot.velocity_error + LIMIT_SLACK
    allowed = allowed + robot.acceleration_limit * wait
    off = np.flatnonzero(~(np.abs(v - velocity) <= allowed))
    if len(off):
        j = int(off[0])
        return Refusal(
            robot.joints[j],
            f"at velocity {v[j]:.4g} {when} where the plan has {velocity[j]:.4g}, "
            f"expected within {allowed[j]:.3g}",
        )
    return None


def bound_velocity_deviation(
    plan: CheckedPlan, velocity_error: FloatArray, first: float, last: float
) -> FloatArray:
    """How far velocities may be off the curve's between two times on it, if it is followed so far.

    The least of what is stated, what follows from having been within the deviation since the plan
    was checked, and what follows from the measured velocity.

    Args:
        plan: As checked.
        velocity_error: What the measured velocities may be off by, in [rad]/[s] or [m]/[s]. (nv,).
        first: From the plan's stamp, in [s].
        last: Likewise, >= first.

    Returns:
        In [rad]/[s] or [m]/[s]. Shape (nv,).
    """
    followed = first - max(plan.now - plan.stamp, 0.0)
    bound = np.minimum(
        plan.velocity_deviation, deviation_speed(plan.deviation, plan.acceleration, followed)
    )
    along = plan.measured_stamp - plan.stamp
    if along >= 0.0:
        position, velocity = np.empty_like(plan.measured_q), np.empty_like(plan.measured_q)
        evaluate_curve(plan.times, plan.q, plan.v, along, position, velocity)
        away = max(last - along, along - first)
        off = np.abs(plan.measured_v - velocity) + velocity_error
        bound = np.minimum(bound, off + away * plan.acceleration * (1.0 + LIMIT_SLACK))
    return bound


def deviation_speed(deviation: FloatArray, acceleration: FloatArray, time: float) -> FloatArray:
    """How fast what stays within +-deviation for `time` can be at either end of that time.

    With d the deviation, |d| <= e, and M its greatest acceleration, d(0) = d(s) - d'(0) s + r with
    |r| <= M s²/2, so |d'(0)| <= 2 e/s + M s/2 for every s up to `time`; s = 2 sqrt(e/M) is best.

    Args:
        deviation: e, in [rad] or [m]. Shape (nv,).
        acceleration: M, in [rad]/[s²] or [m]/[s²]. Shape (nv,).
        time: In [s]; inf comes out where it is 0 or less.
    """
    if not time > 0.0:
        return np.full(len(deviation), np.inf)
    with np.errstate(over="ignore"):
        span = np.minimum(2.0 * np.sqrt(deviation / acceleration), time)
        speed: FloatArray = 2.0 * deviation / span + 0.5 * acceleration * span
        speed *= 1.0 + LIMIT_SLACK
    return speed


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


def _check_curve(plan: Plan, robot: Robot, peak: FloatArray) -> Refusal | None:
    """Limits on the whole curve; fills the greatest acceleration of each joint."""
    times = np.asarray(plan.times)
    lower = robot.lower_position_limit - robot.position_error - LIMIT_SLACK
    upper = robot.upper_position_limit + robot.position_error + LIMIT_SLACK
    fastest = robot.velocity_limit + robot.velocity_error + LIMIT_SLACK
    allowed = robot.acceleration_limit * (1.0 + LIMIT_SLACK)
    kind, joint, sample, value = find_excess(
        times, np.asarray(plan.q), np.asarray(plan.v), lower, upper, fastest, allowed, peak
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
    """Whether braking at the end can keep every joint from its stop."""
    q, v = np.asarray(plan.q)[-1], np.asarray(plan.v)[-1]
    upwards = robot.upper_position_limit + robot.position_error - q
    downwards = q - robot.lower_position_limit + robot.position_error
    room = np.where(v > 0.0, upwards, downwards) + LIMIT_SLACK
    off = np.flatnonzero(~(v * v <= 2.0 * robot.acceleration_limit * room))
    if not len(off):
        return None
    j = int(off[0])
    return Refusal(
        robot.joints[j],
        f"ends at {q[j]:.6g} with velocity {v[j]:.4g}, which no braking stops short of its limit",
    )
