"""A program for robots that have none: straight paths in joint space, from waypoint to waypoint.

The arm rests at each waypoint, and starts again after the last one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray


class Waypoints:
    """Joint positions of a program, period by period.

    Args:
        waypoints: Joint positions, in [rad]. Shape (n, nv).
        velocities: Velocity limits of the joints, in [rad/s]. Shape (nv,).
        accelerations: Acceleration limits of the joints, in [rad/s²]. Shape (nv,).
        deceleration: Greatest deceleration of a joint, in [rad/s²].
        period: In [s].
    """

    def __init__(
        self,
        waypoints: Sequence[Sequence[float]],
        velocities: ArrayLike,
        accelerations: ArrayLike,
        deceleration: float,
        period: float,
    ) -> None:
        self._waypoints = np.array(waypoints, float)
        self._velocities = np.asarray(velocities, float)
        self._accelerations = np.asarray(accelerations, float)
        self._deceleration = deceleration
        self._period = period
        self._next = 0

    def begin(self, q: ArrayLike) -> None:
        """Rest here, and continue to the next waypoint.

        Args:
            q: Where the joints are, in [rad]. Shape (nv,).
        """
        self._origin = np.array(q, float)
        self._way: NDArray[np.float64] = self._waypoints[self._next] - self._origin
        lengths = np.maximum(np.abs(self._way), 1e-12)  # what does not move limits nothing
        self._fastest = float((self._velocities / lengths).min())
        self._speeding_up = float((self._accelerations / lengths).min())
        self._slowing_down = float((self._deceleration / lengths).min())
        self._place = self.pace = 0.0

    def advance(self, fraction: float) -> NDArray[np.float64]:
        """Joint positions one period later, in [rad]. Shape (nv,).

        Args:
            fraction: Fraction of the program's speed, from 0 to 1; 0: slow down to rest.
        """
        # From the pace p, less by c in each period T, it comes to rest after T (p² / 2c + p / 2).
        change = self._slowing_down * self._period
        left = (1.0 - self._place) / self._period
        stopping = math.sqrt(0.25 * change * change + 2.0 * change * left) - 0.5 * change
        wanted = min(fraction * self._fastest, stopping)
        lowest = self.pace - change
        highest = self.pace + self._speeding_up * self._period
        self.pace = max(min(wanted, highest), lowest, 0.0)
        self._place += self._period * self.pace
        if self._place < 1.0:
            return self._origin + self._place * self._way
        reached = self._waypoints[self._next]
        self._next = (self._next + 1) % len(self._waypoints)
        self.begin(reached)
        return reached
