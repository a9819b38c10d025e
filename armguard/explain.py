"""Why a verdict is as it is: what decided, and what would have made it better.

How much a contact time changes with a change is fitted over a range, since bounds are taken on a
grid of times and single differences would show the grid.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from armguard.pairs import TickState
from armguard.robot import Robot
from armguard.scene import BOUND_NAMES
from armguard.watch import Tick, Watch
from armguard.what_if import Change, contact_times

STEPS = 21
"""Evaluations behind each figure."""

DISTANCES, SPEEDS, AGES = 0.05, 0.5, 0.02
"""Half the ranges of what is varied: [m], [m/s], [s]."""


class Gain(NamedTuple):
    """What a little less of something would buy."""

    what: str
    """Such as "1 ms less latency"."""
    seconds: float
    """By how much later contact would be, or the arm at rest earlier, [s]."""
    metres: float
    """How much nearer the obstacle could be for the same verdict, [m]; NaN where no distance would
    make a difference."""


class Explanation(NamedTuple):
    """What a verdict rests on, for people; times in [s]."""

    link: str
    obstacle: str
    bound: str
    """What decided, one of `BOUND_NAMES`."""
    contact_time: float
    """As in the verdict."""
    fresh_contact_time: float
    """What a look at this moment says."""
    stop_time: float
    obstacle_age: float
    """Of the obstacle's state; 0 for one that stands still for ever."""
    arm_age: float
    """Of the joint state."""
    look_age: float
    """Since the pair was looked at."""
    gains: tuple[Gain, ...]
    """Latency, assumed speed and cover: what less of each would buy."""

    def __str__(self) -> str:
        lines = [
            f"{self.link} and {self.obstacle}: contact possible in {self.contact_time:.3f} s "
            f"by the {self.bound} bound, at rest in {self.stop_time:.3f} s",
            f"obstacle seen {1e3 * self.obstacle_age:.1f} ms ago, arm {1e3 * self.arm_age:.1f} ms, "
            f"pair looked at {1e3 * self.look_age:.1f} ms ago; a look now says "
            f"{self.fresh_contact_time:.3f} s",
        ]
        for gain in self.gains:
            lines.append(f"{gain.what}: {1e3 * gain.seconds:.2f} ms, or {1e3 * gain.metres:.1f} mm")
        return "\n".join(lines)


def explain_pair(
    watch: Watch, robot: Robot, tick: Tick, pair: int, reaction_time: float
) -> Explanation:
    """Explain the pair that decided a tick.

    Args:
        watch: Knows the pairs; its arm prepared for the tick.
        robot: The arm.
        tick: The last one.
        pair: Row × links + link.
        reaction_time: From command to braking torque, in [s].
    """
    state, names = watch.arm.state, watch.arm.names(pair)
    row, link = divmod(pair, len(watch.arm.links))
    known = watch.recall(pair)
    # A second of latency lets every joint speed up for as long before it brakes.
    accel, braking = robot.acceleration_limit, robot.braking_deceleration
    reached = np.abs(tick.v) + robot.velocity_error + accel * (tick.arm_age + reaction_time)
    slopes = np.where(reached < robot.velocity_limit, 1.0 + accel / braking, 1.0)
    fresh, gains = _find_gains(state, row, link, float(slopes.max()))
    return Explanation(
        link=names[0],
        obstacle=names[1],
        bound=BOUND_NAMES[known.bound],
        contact_time=max(0.0, known.expiry - tick.time),
        fresh_contact_time=fresh,
        stop_time=tick.stop_time,
        obstacle_age=(
            0.0 if state.marks.static[row] else tick.now - float(state.bodies.stamp[row])
        ),
        arm_age=tick.arm_age,
        look_age=tick.time - known.evaluated_at,
        gains=gains,
    )


def _find_gains(
    state: TickState, row: int, link: int, stop_slope: float
) -> tuple[float, tuple[Gain, ...]]:
    """What a look at this moment says of a pair in [s], and what would make it better.

    Args:
        state: The last tick's numbers, with the arm prepared.
        row: Of the obstacle.
        link: Of the arm.
        stop_slope: By how much earlier the arm rests for each second less of latency.
    """

    def slope(half: float, kind: str) -> float:
        values = np.linspace(-half, half, STEPS)
        times = [contact_times(state, row, Change(**{kind: value}))[link] for value in values]
        usable = np.isfinite(times)
        if usable.sum() < 2:
            return 0.0
        return float(np.polyfit(values[usable], np.array(times)[usable], 1)[0])

    fresh = float(contact_times(state, row)[link])
    per_metre = slope(DISTANCES, "distance")

    def gain(what: str, seconds: float) -> Gain:
        # A zero of either sign reads better as 0.
        seconds = max(seconds, 0.0)
        return Gain(what, seconds, seconds / -per_metre if per_metre < 0.0 else math.nan)

    moving = not state.marks.static[row]
    return fresh, (
        gain("1 ms less latency", 1e-3 * (stop_slope - (slope(AGES, "age") if moving else 0.0))),
        gain("1 m/s less assumed speed", -slope(SPEEDS, "speed") if moving else 0.0),
        gain("1 mm less cover", -1e-3 * per_metre),
    )
