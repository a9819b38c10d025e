"""What a monitor is told when it is made, checked once, and the scheduler that it asks for."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import pinocchio

from armguard.bounds.arm import MOTIONS, PLANNED
from armguard.bounds.operating_history import OperatingHistory
from armguard.exceptions import ArmguardError
from armguard.obstacles.obstacles import Obstacles
from armguard.pairs.arm import ArmOptions, WatchedArm
from armguard.pairs.exemptions import Exemptions
from armguard.pairs.ignored import IgnoredPairs
from armguard.pairs.separation_rule import SeparationRule
from armguard.robot.joint_states import JointStates
from armguard.robot.operating_limits import LimitsInForce, OperatingLimits, read_operating
from armguard.robot.robot import Robot
from armguard.scheduling.deadline import UNLIMITED, DeadlineScheduler, Pace
from armguard.scheduling.schedule import DEADLINE, Schedule, make_schedule
from armguard.scheduling.scheduler import Scheduler

LEAVES = ("never", "any")
"""When joints may leave a committed piece to brake by themselves: never, or at any moment."""

_COMMIT = 'with motion="planned" the controller commits pieces that carry their own stop'
REMOVED = {
    "stop": _COMMIT,
    "path_deceleration": _COMMIT,
    "advances": "leave it out: an evaluation takes as many steps as it needs, up to 8",
}
"""Settings of earlier versions, and what replaces them."""

SCALE_RISE = 1.0
"""By how much the speed scale rises in a second unless another rate is given, [1/s]."""

MOST_EVALUATIONS = 2**62
"""A budget that nothing exceeds."""


class MonitorSettings(NamedTuple):
    """Settings of a monitor, all of them usable; times in [s]."""

    period: float
    """Of ticks."""
    schedule: Schedule | None
    """Of pairs; None: obstacles by their deadlines."""
    motion: str
    """One of `MOTIONS`."""
    leave: str
    """One of `LEAVES`."""
    reaction_time: float
    latency: float
    slow_margin: float
    aware_margin: float
    rise_delay: float
    scale_rise: float
    """By how much the speed scale rises in a second, at most, [1/s]."""
    source_timeout: float
    joint_timeout: float
    margin: float
    """[m]."""
    max_staleness: float
    budget: int | None
    base_placement: pinocchio.SE3
    operating: OperatingLimits | None = None
    """What the controller keeps to; None: the robot's limits."""
    payload: float = 0.0
    """What the arm carries at most, in [kg]."""
    rate: float = math.nan
    """Of ticks, [Hz], as it was given: `period` is its inverse, rounded."""
    ignore: tuple[tuple[str, ...], ...] = ()
    """Pairs that are not watched, as they were given."""
    certify: bool = False
    """Whether verdicts carry certificates."""
    separation: SeparationRule | None = None
    """By which verdicts carry the margin of a separation distance."""

    @property
    def response_time(self) -> float:
        """Until the verdict after the present one is obeyed."""
        return self.period + self.latency

    @property
    def with_joints(self) -> bool:
        """Whether joint and braking bounds are used."""
        by_distance = self.schedule is not None and self.schedule.measure == "distance"
        return self.motion != "isotropic" and not by_distance


def read_settings(
    robot: object,
    obstacles: object,
    *,
    rate: float,
    schedule: str | Schedule,
    motion: str,
    leave: str = "never",
    scale_rise: float = SCALE_RISE,
    joint_timeout: float | None,
    max_staleness: float,
    budget: int | None,
    base_placement: pinocchio.SE3 | None,
    operating: object = None,
    payload: object = None,
    **amounts: float,
) -> MonitorSettings:
    """Check the arguments of a `Monitor`; `amounts` are its durations and lengths.

    Raises:
        ArmguardError: One of them is of another kind, out of range, no number, or names what does
            not exist.
    """
    if not isinstance(robot, Robot):
        remedy = 'armguard.Robot.load("panda") makes one'
        raise ArmguardError("robot", f"is {robot!r}", expected="an armguard.Robot", remedy=remedy)
    if not isinstance(obstacles, Obstacles):
        raise ArmguardError(
            "obstacles",
            f"is {obstacles!r}",
            expected="an armguard.Obstacles",
            remedy="an empty table if there are none",
        )
    if not 0.0 < read_number(rate) < math.inf:
        raise ArmguardError("rate", f"is {rate!r}", expected="a finite number of hertz above 0")
    period = 1.0 / float(rate)
    amounts["joint_timeout"] = max(0.1, 5.0 * period) if joint_timeout is None else joint_timeout
    for name, value in amounts.items():
        if not 0.0 <= read_number(value) < math.inf:
            raise ArmguardError(name, f"is {value!r}", expected="a finite number, at least 0")
    if not 0.0 < read_number(scale_rise) < math.inf:
        raise ArmguardError("scale_rise", f"is {scale_rise!r}", expected="a finite number above 0")
    if not 0.0 <= read_number(max_staleness) < 1.0:
        raise ArmguardError(
            "max_staleness", f"is {max_staleness!r}", expected="0 <= max_staleness < 1"
        )
    if not isinstance(base_placement, pinocchio.SE3 | None):
        raise ArmguardError("base_placement", f"is {base_placement!r}", expected="a pinocchio.SE3")
    if not (isinstance(motion, str) and motion in MOTIONS):
        raise ArmguardError("motion", f"is {motion!r}", expected=f"one of {', '.join(MOTIONS)}")
    if not (isinstance(leave, str) and leave in LEAVES):
        raise ArmguardError("leave", f"is {leave!r}", expected=f"one of {', '.join(LEAVES)}")
    if leave != "never" and motion != PLANNED:
        raise ArmguardError(
            "leave", f"is {leave!r}", expected='"never" unless motion="planned" tells the path'
        )
    by_deadline = isinstance(schedule, str) and schedule == DEADLINE
    numbers: dict[str, Any] = {name: float(amount) for name, amount in amounts.items()}
    return MonitorSettings(
        period=period,
        schedule=None if by_deadline else make_schedule(schedule, period),
        motion=motion,
        leave=leave,
        scale_rise=float(scale_rise),
        max_staleness=float(max_staleness),
        budget=_read_budget(budget, by_deadline=by_deadline),
        base_placement=base_placement or pinocchio.SE3.Identity(),
        operating=read_operating(robot, operating),
        payload=robot.brakes.check_payload(payload),
        **numbers,
    )


def refuse_settings(given: Mapping[str, object]) -> None:
    """Refuse arguments that a monitor does not take, or takes no more.

    Raises:
        ArmguardError: One of them is a setting of earlier versions.
        TypeError: One of them never was a setting.
    """
    for name, value in given.items():
        if name not in REMOVED:
            raise TypeError(f"Monitor() got an unexpected keyword argument {name!r}")
        raise ArmguardError(name, f"is {value!r}, and is no setting any more", remedy=REMOVED[name])


def read_number(value: object) -> float:
    """The number that `value` is; NaN for whatever is not one."""
    try:
        if isinstance(value, bool) or not isinstance(value, (int, float, np.floating, np.integer)):
            return math.nan
        return float(value)
    except Exception:
        # Whatever a foreign object raises here, it is no number.
        return math.nan


def read_limit(name: str, limit: object) -> int:
    """How many are asked for; below 0 is none.

    Args:
        name: What to call it in errors.
        limit: As it was given.

    Raises:
        ArmguardError: It is no whole number.
    """
    if isinstance(limit, bool) or not isinstance(limit, (int, np.integer)):
        raise ArmguardError(name, f"is {limit!r}", expected="a whole number")
    return max(int(limit), 0)


def _read_budget(budget: object, *, by_deadline: bool) -> int | None:
    if budget is None:
        return None
    if isinstance(budget, bool) or not isinstance(budget, (int, np.integer)) or not budget > 0:
        raise ArmguardError("budget", f"is {budget!r}", expected="a whole number above 0, or None")
    if not by_deadline:
        raise ArmguardError(
            "budget", "is given", expected='schedule="deadline", which alone keeps to one'
        )
    # More than compiled code can count is as good as no limit.
    return min(int(budget), MOST_EVALUATIONS)


def make_scheduler(
    robot: Robot,
    obstacles: Obstacles,
    settings: MonitorSettings,
    ignored: IgnoredPairs,
    states: JointStates,
    in_force: LimitsInForce,
    operating: OperatingHistory | None = None,
    exemptions: Exemptions | None = None,
) -> Scheduler:
    """A scheduler over the pairs of an arm and obstacles, compiled and ready.

    Args:
        robot: The arm.
        obstacles: The table; the scheduler is the one that follows its rows from now on.
        settings: Which scheduler, and how cautious.
        ignored: Pairs that are not watched.
        states: Where joint positions and velocities of each tick stand.
        in_force: What joints keep to while the arm works, and how they stop, shared.
        operating: What tests joint states against operating limits; None: there are none.
        exemptions: Pairs that are not watched for the time being; None: there are none.
    """
    schedule = settings.schedule

    options = ArmOptions(
        settings.margin,
        settings.reaction_time,
        settings.base_placement,
        with_joints=settings.with_joints,
        with_plans=settings.motion == PLANNED,
        by_distance=schedule is not None and schedule.measure == "distance",
    )

    def make_arm(laid_out: Robot) -> WatchedArm:
        return WatchedArm(laid_out, obstacles, ignored, options, in_force, exemptions)

    if schedule is not None:
        # Only schedules of pairs need it, and what it checks exactly.
        from armguard.scheduling.pair_scheduler import PairScheduler

        return PairScheduler(robot, obstacles, schedule, make_arm, states, operating)
    pace = Pace(
        settings.response_time + settings.reaction_time,
        settings.max_staleness,
        settings.aware_margin,
        settings.period,
        UNLIMITED if settings.budget is None else settings.budget,
    )
    return DeadlineScheduler(robot, obstacles, make_arm, states, pace, operating)
