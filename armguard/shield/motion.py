"""Motions that a shield commands: along a timed path or joint by joint, each ending at rest.

A motion is a sequence of jerk-limited phases, made by Ruckig [Ruckig]_. On a path, phases change
the time along the path, and so its pace. Otherwise they change the joints' positions. The last
phase ends at rest.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

from armguard.jit.arrays import FloatArray
from armguard.shield.path import TimedPath

if TYPE_CHECKING:
    from ruckig import Trajectory


class Samples(NamedTuple):
    """Samples of a motion. Shape (n,), and (n, nv) each."""

    times: FloatArray
    """In [s] on the monitor's clock."""
    q: FloatArray
    """In [rad] or [m]."""
    v: FloatArray
    """In [rad]/[s] or [m]/[s]."""
    a: FloatArray
    """In [rad]/[s²] or [m]/[s²]."""


class Phase(NamedTuple):
    """A jerk-limited part of a motion, which lasts until the next one begins."""

    begin: float
    """In [s] on the monitor's clock."""
    trajectory: Trajectory


class Motion(Protocol):
    """A motion that comes to rest at its end."""

    @property
    def end(self) -> float:
        """Time at which it is at rest, in [s]; not before its beginning."""

    def sample(self, times: FloatArray) -> Samples:
        """States at some times, in [s], not before its beginning. Shape (n,)."""

    def find_knots(self, begin: float) -> FloatArray:
        """Times from `begin` on at which its jerk changes, including its end, in [s]."""


class Rest:
    """An arm that stays at rest.

    Args:
        q: In [rad] or [m]. Shape (nv,).
        begin: From when on, in [s].
    """

    def __init__(self, q: FloatArray, begin: float) -> None:
        self.end = begin
        self._q = q

    def sample(self, times: FloatArray) -> Samples:
        """States at some times, in [s]. Shape (n,)."""
        q = np.tile(self._q, (len(times), 1))
        return Samples(times, q, np.zeros_like(q), np.zeros_like(q))

    def find_knots(self, begin: float) -> FloatArray:
        """Times at which its jerk changes: none."""
        return np.empty(0)


class JointByJoint:
    """A motion of the joints.

    Args:
        phases: Of their positions; the last one comes to rest.
    """

    def __init__(self, phases: Sequence[Phase]) -> None:
        self.phases = phases

    @property
    def end(self) -> float:
        """Time at which it is at rest, in [s]."""
        last = self.phases[-1]
        return last.begin + float(last.trajectory.duration)

    def sample(self, times: FloatArray) -> Samples:
        """States at some times, in [s], not before its beginning. Shape (n,)."""
        states = _look_up(self.phases, times)
        return Samples(times, states[:, 0], states[:, 1], states[:, 2])

    def find_knots(self, begin: float) -> FloatArray:
        """Times from `begin` on at which its jerk changes, including its end, in [s]."""
        return _find_knots(self.phases, begin)


class AlongPath:
    """A motion along a path.

    Args:
        path: Timed.
        phases: Of the time along the path, one value each; the last one comes to rest.
    """

    def __init__(self, path: TimedPath, phases: Sequence[Phase]) -> None:
        self.path = path
        self._phases = phases

    @property
    def end(self) -> float:
        """Time at which it is at rest, in [s]."""
        last = self._phases[-1]
        return last.begin + float(last.trajectory.duration)

    def find_place(self, time: float) -> tuple[float, float, float]:
        """Time along the path, the pace there, and its change; in [s], 1 and [1]/[s]."""
        (place, pace, change) = _look_up(self._phases, np.array([time]))[0, :, 0]
        return float(place), float(pace), float(change)

    def sample(self, times: FloatArray) -> Samples:
        """States at some times, in [s], not before its beginning. Shape (n,)."""
        along = _look_up(self._phases, times)
        pace, change = along[:, 1], along[:, 2]
        q, slope, bend, _ = self.path.evaluate(along[:, 0, 0])
        return Samples(times, q, slope * pace, bend * pace**2 + slope * change)

    def find_knots(self, begin: float) -> FloatArray:
        """Times from `begin` on at which the change of its pace does, its end among them."""
        return _find_knots(self._phases, begin)


def _look_up(phases: Sequence[Phase], times: FloatArray) -> FloatArray:
    """Positions, velocities and accelerations of phases. Shape (len(times), 3, values)."""
    begins = [phase.begin for phase in phases]
    numbers = np.maximum(np.searchsorted(begins, times, side="right") - 1, 0).tolist()
    states = []
    for number, time in zip(numbers, times.tolist(), strict=True):
        begin, trajectory = phases[number]
        # Ruckig ends the whole process where a time is no finite number.
        since = max(0.0, time - begin)
        states.append(trajectory.at_time(since if since < math.inf else trajectory.duration))
    return np.array(states)


def _find_knots(phases: Sequence[Phase], begin: float) -> FloatArray:
    found = []
    for k, (first, trajectory) in enumerate(phases):
        last = phases[k + 1].begin if k + 1 < len(phases) else first + trajectory.duration
        found.append(last)
        if last < begin:
            continue
        for profile in trajectory.profiles[0]:
            since = first
            for lasting in (profile.brake.duration, *profile.t):
                since += lasting
                if since < last:
                    found.append(since)
    knots = np.unique(found)
    return knots[knots >= begin]
