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
from armguard.bounds.planned.following import (
    FOLLOWED,
    Straying,
    describe_straying,
    find_straying,
)
from armguard.bounds.planned.plan import (
    CheckedPlan,
    Plan,
    PlanLimits,
    Refusal,
    make_example,
    read_plan,
    read_plan_limits,
)
from armguard.bounds.planned.stop import find_hard_stop
from armguard.jit.arrays import FloatArray
from armguard.jit.handle import machine_code, pack
from armguard.jit.kernels import kernel
from armguard.jit.numerics import LIMIT_SLACK
from armguard.robot.brakes import BrakeCurves, find_gentlest_stop
from armguard.robot.robot import Robot
from armguard.robot.wrap_angle import (
    align_turns,
    find_continuous,
    unwrap,
)

ENDS = -1
"""What `_judge_curve` can say beside what `find_excess` does: it does not end at rest."""


class PlanErrors(NamedTuple):
    """How far off the curve of a plan the arm may be by the controller's word. Shape (nv,) each."""

    error: FloatArray
    """[rad] or [m]."""
    velocity_error: FloatArray
    """[rad]/[s] or [m]/[s]; inf where none is stated."""


class MeasuredState(NamedTuple):
    """A joint state, and where on the plan the arm is to be by then."""

    q: FloatArray
    """[rad] or [m]. Shape (nv,)."""
    v: FloatArray
    """[rad]/[s] or [m]/[s]. Shape (nv,)."""
    along: float
    """[s]; negative: that long before it begins."""


class Excess(NamedTuple):
    """Where a curve is not within limits."""

    kind: int
    """FINE if nowhere; what else `find_excess` can say, or ENDS."""
    joint: int
    sample: int
    """The one before."""
    found: float
    least: float
    """What it may be at the least."""
    most: float
    """What it may be at the most."""


ROOMS = 4
"""Fields of a `CheckedPlan` from `deviation` on, which follow from its samples."""


class PlanCheck:
    """Checks plans for one robot.

    Args:
        robot: Whose limits and errors apply.
    """

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        limits = read_plan_limits(robot)
        self._has_continuous = bool(find_continuous(limits.lower, limits.upper).any())
        self._limits = pack(limits)
        example = make_example()
        samples, one = example[1:4], np.zeros(1)
        errors = PlanErrors(one, one)
        state = MeasuredState(one, one, 0.0)
        # All that these are handed was read by `read_plan`, or is made here.
        self._judge_plan = machine_code(
            _judge_plan, *samples, errors, self._limits, 0.0, state, np.zeros((ROOMS, 1))
        )

    def check(
        self,
        plan: Plan,
        now: float,
        q: ArrayLike,
        v: ArrayLike,
        stamp: float,
        *,
        longest_lead: float = 0.1,
        longest_lag: float = 0.1,
    ) -> CheckedPlan | Refusal:
        """Check a plan; see `check_plan`."""
        robot = self._robot
        read = read_plan(plan, len(robot.joints))
        if isinstance(read, Refusal):
            return read
        times = np.asarray(read.times)
        lasting = float(times[-1])
        refusal = _check_time(read.stamp, lasting, now, longest_lead, longest_lag)
        if refusal is not None:
            return refusal
        position, velocity = np.array(q, dtype=np.float64), np.array(v, dtype=np.float64)
        shape = (len(robot.joints),)
        if not position.shape == velocity.shape == shape:
            # Compiled code would read beyond their ends.
            found = f"has shapes {position.shape} and {velocity.shape}"
            return Refusal("joint state", f"{found}, expected {shape} of q and v")
        if self._has_continuous:
            with np.errstate(all="ignore"):
                read = _align(read, robot, position, velocity, stamp)
        # The sums of stamps are off by as much as this, and by that time joints have moved.
        latest = max(abs(now), abs(stamp), abs(read.stamp), abs(read.stamp + lasting))
        clock = 4.0 * math.ulp(latest) if latest < math.inf else math.nan
        speed = read.velocity_tracking_error
        errors = PlanErrors(
            np.asarray(read.tracking_error),
            np.full(len(robot.joints), np.inf) if speed is None else np.asarray(speed),
        )
        samples = times, np.asarray(read.q), np.asarray(read.v)
        room = np.empty((ROOMS, len(robot.joints)))
        state = MeasuredState(position, velocity, stamp - read.stamp)
        excess, straying = self._judge_plan(*samples, errors, self._limits, clock, state, room)
        if excess[0] != curve.FINE:
            return _describe_excess(Excess(*excess), robot, times)
        if straying[0] != FOLLOWED:
            off = Straying(*straying)
            return describe_straying(off, robot.joints, state.along)
        deviation, acceleration, velocity_deviation, top_speed = room
        return CheckedPlan(
            read.stamp, *samples, deviation, acceleration, velocity_deviation,
            top_speed, now, stamp, position, velocity,
        )  # fmt: skip


class StopCheck:
    """Checks the stops that pieces carry.

    Args:
        robot: Whose joints they are.
        brakes: How these stop; what is shared of that may change.
    """

    def __init__(self, robot: Robot, brakes: BrakeCurves) -> None:
        self._joints = robot.joints
        self._brakes = pack(brakes)
        samples = make_example()[1:4]
        self._judge_stop = machine_code(_judge_stop, *samples, np.zeros(1), self._brakes)

    def check(self, plan: CheckedPlan) -> Refusal | None:
        """Why brakes do not guarantee the stop that a piece carries; None if they do.

        Args:
            plan: As checked.
        """
        kind, joint, found, most, when = self._judge_stop(
            plan.times, plan.q, plan.v, plan.top_speed, self._brakes
        )
        if kind == curve.FINE:
            return None
        if kind == curve.VELOCITY:
            return _refuse_speed(self._joints[joint], found, most)
        return Refusal(
            self._joints[joint],
            f"comes to rest at {found:.4g} from {when:.6g} s on, brakes guarantee {most:.4g}",
        )


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
    return PlanCheck(robot).check(
        plan,
        float(now),
        q,
        v,
        float(stamp),
        longest_lead=longest_lead,
        longest_lag=longest_lag,
    )


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


def _check_time(
    stamp: float, lasting: float, now: float, longest_lead: float, longest_lag: float
) -> Refusal | None:
    lead = stamp - now
    end = lead + lasting
    if not math.isfinite(lead):
        return Refusal("plan", f"begins at {stamp}, now being {now}")
    if not end > 0.0:
        return Refusal("plan", f"lies in the past: it ended {-end:.4g} s ago")
    if not lead >= -longest_lag:
        return Refusal(
            "plan", f"is stale: it began {-lead:.4g} s ago, expected at most {longest_lag:.4g} s"
        )
    if not lead <= longest_lead:
        return Refusal("plan", f"begins in {lead:.4g} s, expected at most {longest_lead:.4g} s")
    return None


@kernel
def _judge_plan(
    times: FloatArray,
    q: FloatArray,
    v: FloatArray,
    errors: PlanErrors,
    limits: PlanLimits,
    clock: float,
    state: MeasuredState,
    room: FloatArray,
) -> tuple[tuple[int, int, int, float, float, float], tuple[int, int, float, float, float]]:
    """Where a curve is not within limits, or else, what shows that the arm is not on it.

    Fields of an `Excess` and of a `Straying`.

    Args:
        times: Of the samples, in [s]. Shape (k,).
        q: [rad] or [m]. Shape (k, nv).
        v: [rad]/[s] or [m]/[s]. Shape (k, nv).
        errors: About these.
        limits: Of the robot.
        clock: What sums of stamps may be off by, in [s].
        state: What was measured.
        room: Filled with the fields that follow, where the curve is in order. Shape (ROOMS, nv).
    """
    excess = _judge_curve(times, q, v, errors, limits, clock, room)
    if excess[0] != curve.FINE:
        return excess, (FOLLOWED, -1, 0.0, 0.0, 0.0)
    plan = CheckedPlan(
        0.0, times, q, v, room[0], room[1], room[2], room[3],
        0.0, 0.0, state.q, state.v,
    )  # fmt: skip
    return excess, find_straying(plan, limits, state.q, state.v, state.along)


@kernel
def _judge_curve(
    times: FloatArray,
    q: FloatArray,
    v: FloatArray,
    errors: PlanErrors,
    limits: PlanLimits,
    clock: float,
    room: FloatArray,
) -> tuple[int, int, int, float, float, float]:
    """Where a curve is not within limits; arguments as of `_judge_plan`."""
    joints = limits.lower.shape[0]
    lower, upper = np.empty(joints), np.empty(joints)
    fastest, allowed = np.empty(joints), np.empty(joints)
    for j in range(joints):
        lower[j] = limits.lower[j] - limits.position_error[j] - LIMIT_SLACK
        upper[j] = limits.upper[j] + limits.position_error[j] + LIMIT_SLACK
        fastest[j] = limits.velocity[j] + limits.velocity_error[j] + LIMIT_SLACK
        allowed[j] = limits.acceleration[j] * (1.0 + LIMIT_SLACK)
    deviation, acceleration, velocity_deviation, top_speed = room[0], room[1], room[2], room[3]
    peaks = CurvePeaks(acceleration, top_speed)
    kind, joint, sample, value = find_excess(times, q, v, lower, upper, fastest, allowed, peaks)
    if kind == curve.POSITION:
        return kind, joint, sample, value, lower[joint], upper[joint]
    if kind == curve.VELOCITY:
        return kind, joint, sample, value, 0.0, fastest[joint]
    if kind != curve.FINE:
        return kind, joint, sample, value, 0.0, limits.acceleration[joint]
    last = times.shape[0] - 1
    for j in range(joints):
        # Nothing is known of where an arm gets to that does not rest at the end.
        if not abs(v[last, j]) <= LIMIT_SLACK:
            return ENDS, j, last, v[last, j], 0.0, 0.0
        deviation[j] = errors.error[j] + limits.position_error[j] + clock * limits.velocity[j]
        acceleration[j] += limits.acceleration[j]
        velocity_deviation[j] = errors.velocity_error[j] + limits.velocity_error[j]
    return curve.FINE, -1, -1, 0.0, 0.0, 0.0


def _describe_excess(excess: Excess, robot: Robot, times: FloatArray) -> Refusal:
    """Where a curve is not within limits, in words."""
    kind, joint, sample, value, least, most = excess
    if kind == ENDS:
        return Refusal(
            robot.joints[joint],
            f"ends at velocity {value:.4g}, expected at rest; Monitor.with_stop appends a stop",
        )
    where = f"between {times[sample]:.6g} s and {times[sample + 1]:.6g} s"
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


def _refuse_speed(joint: str, speed: float, stated: float) -> Refusal:
    return Refusal(joint, f"goes at {speed:.4g}, brakes are stated up to {stated:.4g}")
