"""What would have avoided a STOP: the stop decision, asked again under other circumstances.

Each remedy is tried by itself, on what the last tick saw, by the bound on a braking arm. Dozens of
questions, each of a good part of a tick: between ticks, for people.
"""

from __future__ import annotations

from collections.abc import Callable

from armguard.bounds.braking import BrakingMotion
from armguard.robot.operating_limits import LimitsInForce, OperatingLimits
from armguard.robot.robot import Robot
from armguard.scheduling.scheduler import Scheduler, Tick
from armguard.scheduling.timing_wheel import NOBODY

HALVINGS = 7
"""Of the interval in which the least sufficient delay or speed is sought."""


def list_remedies(
    scheduler: Scheduler,
    robot: Robot,
    in_force: LimitsInForce,
    tick: Tick,
    response_time: float,
    *,
    has_operating: bool,
) -> tuple[str, ...]:
    """What would have let the arm rest in time, in words; empty where it did, or nothing would.

    Args:
        scheduler: Knows the pairs; its arm prepared for the tick.
        robot: The arm.
        in_force: What it counts with.
        tick: The last one.
        response_time: Until the verdict after that one is obeyed, in [s].
        has_operating: Whether operating limits are stated.
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
                remedies.append(f"carrying nothing, instead of {in_force.payload:g} kg")
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
    """Whether the arm surely rests before contact if its brakes bite after `delay`, in [s]."""
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
    """The greatest part of a whole that is enough, rounded down; None if not even nothing is."""
    if not is_enough(0.0):
        return None
    low, high = 0.0, 1.0
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if is_enough(middle) else (low, middle)
    return low
