"""Finds what would have avoided a STOP: repeats the stop decision under changed conditions.

Each remedy is tried by itself, on the data of the last tick, by the bound on a braking arm. This
takes dozens of evaluations, each a large part of a tick. It therefore runs between ticks, when a
user asks.
"""

from __future__ import annotations

from collections.abc import Callable

from armguard.bounds.braking import BrakingMotion
from armguard.robot.operating_limits import LimitsInForce, OperatingLimits
from armguard.robot.robot import Robot
from armguard.scheduling.scheduler import Scheduler, Tick
from armguard.scheduling.timing_wheel import NOBODY

HALVINGS = 7
"""Number of bisections in the search for the greatest sufficient delay or speed."""


def list_remedies(
    scheduler: Scheduler,
    robot: Robot,
    in_force: LimitsInForce,
    tick: Tick,
    response_time: float,
    *,
    has_operating: bool,
) -> tuple[str, ...]:
    """Remedies that would have let the arm be at rest in time, in words; empty if none would.

    Args:
        scheduler: The scheduler of the pairs; its arm is prepared for the tick.
        robot: The arm.
        in_force: The limits and brakes in force.
        tick: The last one.
        response_time: Time until the verdict after that one is obeyed, in [s].
        has_operating: Whether operating limits are configured.
    """
    braking = scheduler.arm.motion.braking

    def rests(delay: float = response_time + braking.reaction_time, pace: float = 1.0) -> bool:
        return _rests(scheduler, braking, tick, delay, pace)

    if rests():
        return ()
    remedies = []
    if in_force.payload > 0.0:
        with in_force.pretend(payload=0.0):
            if rests():
                remedies.append(f"a payload of 0 kg, instead of {in_force.payload:g} kg")
    if not has_operating and robot.published_operating_limits is not None:
        with in_force.pretend(operating=OperatingLimits.published(robot)):
            if rests():
                remedies.append("the published operating limits, if the controller enforces them")
    whole = response_time + braking.reaction_time
    least = _find_greatest(lambda part: rests(delay=part * whole))
    if least is not None:
        remedies.append(f"a delay of {1e3 * least * whole:.1f} ms, instead of {1e3 * whole:.1f} ms")
    share = _find_greatest(lambda part: rests(pace=part))
    if share is not None and tick.v.any():
        remedies.append(f"an arm at {share:.0%} of its speed")
    return tuple(remedies)


def _rests(
    scheduler: Scheduler, braking: BrakingMotion, tick: Tick, delay: float, pace: float
) -> bool:
    """Whether the arm is proved to be at rest before contact if brakes engage after `delay` [s]."""
    reaction_time = braking.reaction_time
    velocity = pace * tick.v
    try:
        braking.reaction_time = min(reaction_time, delay)
        horizon = delay - braking.reaction_time
        if not braking.covers(tick.q, velocity, tick.arm_age, horizon):
            return False
        table = braking.tabulate(tick.q, velocity, tick.arm_age, horizon)
        end = float(table.time[-1])
    finally:
        braking.reaction_time = reaction_time
    return scheduler.find_unsafe(tick, end, remembers=False).pair == NOBODY


def _find_greatest(is_enough: Callable[[float], bool]) -> float | None:
    """The greatest sufficient fraction from 0 to 1, rounded down; None if 0 is not sufficient."""
    if not is_enough(0.0):
        return None
    low, high = 0.0, 1.0
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if is_enough(middle) else (low, middle)
    return low
