"""Stops an arm a few times on purpose, and measures how it stops.

It measures time and distance of each joint from the order to pause until all joints are at rest.
All results err on the long side. A joint begins to brake at the first state with a certain decrease
of its speed, and is at rest after the last state with certain motion.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import msgspec
import numpy as np

from armguard.drivers.arm import ArmState, Program

RUN = 0.5
"""How long the arm moves between two stops, and rests in each, in [s]."""

TIMEOUT = 20.0
"""How long the arm may take to move, or to come to rest, in [s]."""

MOVING = 0.05
"""Joints that are faster are measured, in [rad/s]."""

RESTING = 0.01
"""Joints that are no faster are at rest, in [rad/s]: the distance includes slower motion."""

SLOWED = 0.9
"""Fraction of its speed below which a joint has certainly begun to brake."""


class JointStop(msgspec.Struct):
    """A stop of one joint."""

    speed: float
    """When the stop was ordered, in [rad/s]."""
    reaction: float
    """Time from the order until it had certainly begun to slow down, in [s]."""
    time: float
    """Time from the order until it was at rest, in [s]."""
    distance: float
    """Distance from its position at the order, in [rad]."""


class _Sample(NamedTuple):
    time: float
    q: list[float]
    v: list[float]


class Measurement:
    """Orders stops, and measures them.

    Args:
        count: How many.

    Attributes:
        stops: The measured stops of each joint that moved, by its number.
        problem: Why no further stop can be measured; empty if stops can be measured.
    """

    def __init__(self, count: int) -> None:
        self.stops: list[dict[int, JointStop]] = []
        self.problem = ""
        self._count = count
        self._phase_since = math.nan
        self._is_stopping = False
        self._samples: list[_Sample] = []
        self._runs_since = math.nan
        self._moved_at = -math.inf

    @property
    def is_done(self) -> bool:
        """Whether the measurement is done."""
        return bool(self.problem) or len(self.stops) >= self._count

    def wants_stop(self, now: float) -> bool:
        """Whether the arm must stop at `now`, in [s] of the monotonic clock."""
        if math.isnan(self._phase_since):
            self._phase_since = now
        if now - self._phase_since > TIMEOUT:
            self.problem = (
                "the arm did not come to rest"
                if self._is_stopping
                else "the arm did not move: its program must run, and verdicts must allow it"
            )
        if self._is_stopping or not now - self._runs_since >= RUN:
            return self._is_stopping
        self._is_stopping, self._phase_since = True, now
        self._samples = self._samples[-1:]
        return True

    def add(self, now: float, state: ArmState) -> None:
        """Take a state, read at `now`, in [s] of the monotonic clock."""
        fastest = max(map(abs, state.v))
        self._samples.append(_Sample(now, state.q, state.v))
        if self._is_stopping:
            if not fastest <= RESTING:
                self._moved_at = now
            if now - max(self._phase_since, self._moved_at) >= RUN:
                self.stops.append(self._measure())
                self._is_stopping, self._phase_since = False, now
                self._runs_since = math.nan
            return
        self._samples = self._samples[-1:]
        runs = state.program is Program.RUNNING and fastest > MOVING
        if not runs:
            self._runs_since = math.nan
        elif math.isnan(self._runs_since):
            self._runs_since = now

    def _measure(self) -> dict[int, JointStop]:
        begun = self._phase_since
        times = np.array([one.time for one in self._samples]) - begun
        q = np.array([one.q for one in self._samples])
        v = np.abs([one.v for one in self._samples])
        found = {}
        for joint in range(q.shape[1]):
            if not v[0, joint] > MOVING:
                continue
            slower = np.flatnonzero(v[:, joint] >= SLOWED * v[0, joint])[-1]
            moving = np.flatnonzero(v[:, joint] > RESTING)[-1]
            last = len(times) - 1
            found[joint] = JointStop(
                speed=float(v[:, joint].max()),
                reaction=float(max(times[min(slower + 1, last)], 0.0)),
                time=float(max(times[min(moving + 1, last)], 0.0)),
                distance=float(np.abs(q[:, joint] - q[0, joint]).max()),
            )
        return found


def describe(stops: list[dict[int, JointStop]], names: tuple[str, ...], load: float) -> str:
    """The measured figures, as lines for a cell file and for the robot's description.

    Stopping times and distances begin at the order, so they include the reaction.

    Args:
        stops: By joint's number.
        names: Of the joints.
        load: Greatest load of the arm, in [kg].
    """
    all_stops = [one for stop in stops for one in stop.values()]
    if not all_stops:
        return ""
    reaction = max(one.reaction for one in all_stops)
    lines = [
        f"# measured by `armguard drive --measure`, {len(stops)} stops; the worst possible stop "
        f"may be longer",
        "[thresholds]",
        f"reaction_time = {_round_up(reaction)} # from the order to the first slowing",
        "",
        "[[brakes]] # of robot.toml",
        f"load = {load:.6g}",
        f'source = "measured by armguard drive --measure, {len(stops)} stops"',
    ]
    worst = {
        name: [stop[joint] for stop in stops if joint in stop] for joint, name in enumerate(names)
    }
    moved = {name: found for name, found in worst.items() if found}
    for key, field in (
        ("speed", "speed"),
        ("stopping_time", "time"),
        ("stopping_distance", "distance"),
    ):
        entries = [
            f"{name} = {_round_up(max(getattr(one, field) for one in found), up=field != 'speed')}"
            for name, found in moved.items()
        ]
        lines.append(f"{key} = {{ {', '.join(entries)} }}")
    still = [name for name in names if name not in moved]
    if still:
        lines.append(f"# not measured, because they did not move: {', '.join(still)}")
    return "\n".join(lines)


def _round_up(value: float, *, up: bool = True) -> float:
    """Round to a thousandth, to the safe side."""
    return (math.ceil if up else math.floor)(1000.0 * value) / 1000.0
