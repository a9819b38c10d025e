"""Checks plans of a controller against the robot's limits and its present state.

A `Plan` is the next piece of a trajectory, or all of it, with its tracking errors. `check_plan`
either refuses it with a reason, or returns a `CheckedPlan`. A `CheckedPlan` exists only if the
following holds. The curve through its samples keeps the robot's limits everywhere, not just at
samples, and ends at rest. It is due now. The arm is at its beginning, or already follows it.

Nothing is clamped or guessed. A plan beyond limits is refused.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from armguard.bounds.limits import JointLimits, read_limits
from armguard.bounds.planned.curve import evaluate_curve, find_excess
from armguard.bounds.planned.findings import ENDS, FINE, describe
from armguard.bounds.planned.following import find_straying
from armguard.bounds.planned.plan import CheckedPlan, Plan, Refusal, make_example, read_plan
from armguard.bounds.planned.stop import find_hard_stop
from armguard.jit.arrays import FloatArray
from armguard.jit.handle import machine_code, pack
from armguard.jit.kernels import kernel
from armguard.jit.numerics import LIMIT_SLACK
from armguard.robot.brakes import BrakeCurves
from armguard.robot.robot import Robot
from armguard.robot.wrap_angle import (
    align_turns,
    find_continuous,
    unwrap,
)

LONGEST_LEAD = 0.1
"""How far ahead of now a plan may begin, in [s]."""
LONGEST_LAG = 0.1
"""How long ago it may have begun, in [s]."""


class PlanCheck:
    """Checks plans for one robot.

    Args:
        robot: Whose limits and errors apply.
        brakes: What must guarantee the stop that a plan carries; what is shared of that may change.
            None: the plan may stop as hard as the robot's limits allow.
    """

    def __init__(self, robot: Robot, brakes: BrakeCurves | None = None) -> None:
        self._robot = robot
        self._has_brakes = brakes is not None
        limits = read_limits(robot)
        self._has_continuous = bool(find_continuous(limits.lower, limits.upper).any())
        self._limits = pack(limits if brakes is None else limits._replace(brakes=brakes))
        # All that this is handed is an example's like.
        self._judge = machine_code(_judge, make_example(), self._limits, 0.0, True)

    def check(
        self,
        plan: Plan,
        now: float,
        q: ArrayLike,
        v: ArrayLike,
        stamp: float,
    ) -> CheckedPlan | Refusal:
        """Check a plan; see `check_plan`."""
        robot = self._robot
        read = read_plan(plan, len(robot.joints))
        if isinstance(read, Refusal):
            return read
        lasting = float(np.asarray(read.times)[-1])
        refusal = _check_time(read.stamp, lasting, now)
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
        times, q_on, v_on = (np.asarray(part) for part in (read.times, read.q, read.v))
        errors = np.array(read.tracking_error), np.full(shape, np.inf if speed is None else speed)
        checked = CheckedPlan(
            read.stamp, times, q_on, v_on, errors[0], np.zeros(shape), errors[1], np.zeros(shape),
            now, stamp, position, velocity,
        )  # fmt: skip
        finding = self._judge(checked, self._limits, clock, self._has_brakes)
        return checked if finding[0] == FINE else describe(finding, robot.joints)


def check_plan(
    plan: Plan,
    robot: Robot,
    now: float,
    q: ArrayLike,
    v: ArrayLike,
    stamp: float,
) -> CheckedPlan | Refusal:
    """Check a plan; no content of it raises an error.

    Args:
        plan: The controller's plan.
        robot: Whose limits and errors apply.
        now: In [s] on the clock of all stamps.
        q: Measured joint positions, believed already, in [rad] or [m]. Shape (nv,).
        v: Measured joint velocities, believed already, in [rad]/[s] or [m]/[s]. Shape (nv,).
        stamp: When they were measured, in [s].
    """
    return PlanCheck(robot).check(plan, float(now), q, v, float(stamp))


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


def _check_time(stamp: float, lasting: float, now: float) -> Refusal | None:
    lead = stamp - now
    end = lead + lasting
    if not math.isfinite(lead):
        problem = f"begins at {stamp}, now being {now}"
    elif not end > 0.0:
        problem = f"lies in the past: it ended {-end:.4g} s ago"
    elif not lead >= -LONGEST_LAG:
        problem = f"is stale: it began {-lead:.4g} s ago, expected at most {LONGEST_LAG:.4g} s"
    elif not lead <= LONGEST_LEAD:
        problem = f"begins in {lead:.4g} s, expected at most {LONGEST_LEAD:.4g} s"
    else:
        return None
    return Refusal("plan", problem)


@kernel
def _judge(
    plan: CheckedPlan, limits: JointLimits, clock: float, has_brakes: bool
) -> tuple[int, int, float, float, float, float]:
    """The first thing that is wrong with a plan, in the fields of a `Finding`.

    Args:
        plan: Its deviations are those that the controller states, and are widened by all errors;
            its acceleration and top speed are filled.
        limits: Of the robot, or a handle on them.
        clock: What sums of stamps may be off by, in [s].
        has_brakes: Whether the limits' brakes must guarantee the plan's stop.
    """
    finding = find_excess(plan.times, plan.q, plan.v, limits, plan.acceleration, plan.top_speed)
    if finding[0] != FINE:
        return finding
    last = plan.times.shape[0] - 1
    for j in range(plan.deviation.shape[0]):
        # Nothing is known of where an arm gets to that does not rest at the end.
        if not abs(plan.v[last, j]) <= LIMIT_SLACK:
            return ENDS, j, plan.v[last, j], 0.0, 0.0, plan.times[last]
        plan.deviation[j] += limits.position_error[j] + clock * limits.velocity[j]
        plan.acceleration[j] += limits.acceleration[j]
        plan.velocity_deviation[j] += limits.velocity_error[j]
    along = plan.measured_stamp - plan.stamp
    finding = find_straying(plan, limits, plan.measured_q, plan.measured_v, along)
    if finding[0] != FINE or not has_brakes:
        return finding
    return find_hard_stop(plan.times, plan.q, plan.v, plan.top_speed, limits.brakes)
