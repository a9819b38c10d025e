"""Explains a verdict: the deciding pair, and what would have improved the verdict.

Joint bounds are computed on a grid of times, and single differences would show the grid. So the
effect of a small change is fitted over a range, and that of a large change is averaged over one.
This takes dozens of evaluations, far longer than a tick.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from armguard.jit.arrays import FloatArray
from armguard.monitor.what_if import UNCHANGED, Change, WhatIf
from armguard.obstacles.possible_states import list_states
from armguard.pairs.evaluate import TickState
from armguard.pairs.scene import BOUND_NAMES, JOINT
from armguard.robot.robot import Robot
from armguard.robot.stop_time import compute_stop_time
from armguard.scheduling.scheduler import Scheduler, Tick

STEPS = 21
"""Number of evaluations for each figure."""

COARSE, FINE = (0.05, 0.02), (0.001, 0.001)
"""Half the ranges of distances and ages, in [m] and [s]: for bounds on a grid of times, others."""

MILLISECOND, MILLIMETRE, PACE = 1e-3, 1e-3, 1.0
"""Quantities that could be smaller: [s], [m], [m/s]."""


class Gain(NamedTuple):
    """Effect of a small reduction of a quantity."""

    what: str
    """Such as "1 ms less latency"."""
    seconds: float
    """By how much contact would be later, or rest earlier, in [s]."""
    metres: float
    """How much nearer the obstacle could be for the same verdict, in [m]; NaN if distance has no
    effect."""


class Explanation(NamedTuple):
    """Explanation of a verdict for people; times in [s]."""

    link: str
    obstacle: str
    bound: str
    """The bound that decided, one of `BOUND_NAMES`."""
    contact_time: float
    """As in the verdict."""
    fresh_contact_time: float
    """Contact time by an evaluation at this moment."""
    stop_time: float
    obstacle_age: float
    """Age of the obstacle's state, accepted or else refused; 0 for a static or an entrance, NaN for
    an obstacle that could be anywhere."""
    arm_age: float
    """Age of the joint state."""
    look_age: float
    """Time since the last evaluation of the pair."""
    gains: tuple[Gain, ...]
    """Effects of less latency of verdicts, age of the obstacle's state, assumed speed, and cover
    protrusion, in this order, each by itself; 0 without effect."""
    remedies: tuple[str, ...] = ()
    """Remedies that would have avoided the STOP, each by itself, in words. Empty if there was no
    STOP, if no tried remedy would have avoided it, or if the arm's motion is bounded by other
    means."""

    def __str__(self) -> str:
        lines = [
            f"{self.link} and {self.obstacle}: contact time {self.contact_time:.3f} s "
            f"by the {self.bound} bound, stop time {self.stop_time:.3f} s",
            f"obstacle seen {1e3 * self.obstacle_age:.1f} ms ago, arm {1e3 * self.arm_age:.1f} ms, "
            f"pair evaluated {1e3 * self.look_age:.1f} ms ago; evaluated now: "
            f"{self.fresh_contact_time:.3f} s",
        ]
        for gain in self.gains:
            lines.append(f"{gain.what}: {1e3 * gain.seconds:.2f} ms, or {1e3 * gain.metres:.1f} mm")
        lines += [f"the STOP would have been avoided by {remedy}" for remedy in self.remedies]
        return "\n".join(lines)


def explain_pair(
    scheduler: Scheduler, robot: Robot, tick: Tick, pair: int, braking_delay: float
) -> Explanation:
    """Explain the pair that decided a tick.

    Args:
        scheduler: Knows the pairs; its arm prepared for the tick.
        robot: The arm.
        tick: The last one.
        pair: Row × links + link.
        braking_delay: Time from a tick until its STOP brakes, in [s]: period, latency and reaction
            time.
    """
    state, names = scheduler.arm.state, scheduler.arm.names(pair)
    row, link = divmod(pair, len(scheduler.arm.links))
    bodies, refused = state.bodies, state.refused_bodies
    states = list_states(bodies, refused, state.marks, row, tick.now)
    known = scheduler.recall(pair)
    what_if = WhatIf(state, row, np.array([link]))

    # Copies that can be written to are what this was compiled for.
    scene_limits = state.scene.limits
    limits = [
        np.array(limit)
        for limit in (
            robot.velocity_error,
            scene_limits.operating_velocity,
            robot.acceleration_limit,
        )
    ]

    def stop_time(response: float) -> float:
        time: float = compute_stop_time(
            tick.v,
            *limits,
            scene_limits.brakes,
            tick.arm_age,
            response,
            0.0,
            scene_limits.operating_acceleration,
        )[0]
        return time

    saved = stop_time(braking_delay) - stop_time(max(braking_delay - MILLISECOND, 0.0))
    return Explanation(
        link=names[0],
        obstacle=names[1],
        bound=BOUND_NAMES[known.bound],
        contact_time=max(0.0, known.expiry - tick.time),
        fresh_contact_time=float(what_if.contact_times(UNCHANGED, tick.refinement_threshold)[0]),
        stop_time=tick.stop_time,
        obstacle_age=float(states[0][2]) if states else math.nan,
        arm_age=tick.arm_age,
        look_age=tick.time - known.evaluated_at,
        gains=_find_gains(what_if, state, row, COARSE if known.bound == JOINT else FINE, saved),
    )


def _find_gains(
    what_if: WhatIf, state: TickState, row: int, ranges: tuple[float, float], saved: float
) -> tuple[Gain, ...]:
    """Effects of small reductions on a pair's verdict.

    Args:
        what_if: Evaluates the pair under changes.
        state: The last tick's numbers.
        row: Of the obstacle.
        ranges: Half those of distances and of ages, in [m] and [s].
        saved: How much earlier the arm is at rest with 1 ms less latency, in [s].
    """

    def times(changes: list[Change]) -> FloatArray:
        return np.array([what_if.contact_times(change)[0] for change in changes])

    offsets, ages = (np.linspace(-half, half, STEPS) for half in ranges)
    usual = times([Change(distance=offset) for offset in offsets])
    per_metre = _fit_slope(offsets, usual)

    def gain(what: str, seconds: float) -> Gain:
        # A zero of either sign reads better as 0.
        seconds = max(seconds, 0.0)
        return Gain(what, seconds, seconds / -per_metre if per_metre < 0.0 else math.nan)

    younger = slower = 0.0
    if not state.marks.static[row]:
        younger = -MILLISECOND * _fit_slope(ages, times([Change(age=age) for age in ages]))
    # Out of an entrance, which has a speed, comes what moves.
    if not state.marks.static[row] or state.bodies.speed[row] > 0.0:
        paces = times([Change(distance=offset, speed=-PACE) for offset in offsets])
        slower = _mean_difference(paces, usual)
    return (
        gain("1 ms less latency", saved),
        gain("1 ms less age of the obstacle", younger),
        gain("1 m/s less assumed speed", slower),
        gain("1 mm less cover", -MILLIMETRE * per_metre),
    )


def _fit_slope(values: FloatArray, times: FloatArray) -> float:
    usable = np.isfinite(times)
    if usable.sum() < 2:
        return 0.0
    return float(np.polyfit(values[usable], times[usable], 1)[0])


def _mean_difference(later: FloatArray, times: FloatArray) -> float:
    """Mean difference of two contact times; inf if only the first is infinite."""
    usable = np.isfinite(times)
    if not usable.any():
        return 0.0
    return float(np.mean(later[usable] - times[usable]))
