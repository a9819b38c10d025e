"""Balls that wander about a cell, within stated bounds on speed and acceleration.

Each coordinate is a sum of sines whose amplitudes are derived from the bounds: they hold exactly,
at every time, and positions and velocities are known without integration.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from armguard.exceptions import ArmguardError
from armguard.lab.simulation.sources import ObstacleSink, SampledSource

Array = NDArray[np.float64]

RADIUS, ACCEL, SPEED = 0.1, 10.0, 2.0
"""Of each ball, in [m], and bounds on how it moves, in [m]/[s²] and [m]/[s]."""

BOX = ((-4.0, -4.0, 0.0), (4.0, 4.0, 2.0))
"""Two corners, in the world, between which the centres stay, in [m]."""

RATE = 50.0
"""Samples a second, in [Hz]."""

_WAVES = 3
_FREQUENCIES = (0.3, 3.0)  # [rad/s]
_TRAVEL = (0.2, 1.0)  # half the extent of one ball's own box along an axis, at most, in [m]
_ROUNDING = 1.0 - 1e-9
_ATTEMPTS = 1000


class WanderingBalls(SampledSource):
    """Balls named "ball-0", "ball-1", …, each on a smooth closed-form motion of its own.

    Args:
        count: How many, 1 or more.
        seed: The same seed gives the same motions.
        clearance: The centres stay this far from the z axis, where the arm stands, in [m].

    Raises:
        ArmguardError: The clearance leaves no room in the box.
    """

    def __init__(self, count: int, seed: int, *, clearance: float = 0.0) -> None:
        super().__init__("balls", RATE, math.inf)
        self.ids = [f"ball-{number}" for number in range(count)]
        random = np.random.default_rng(seed)
        self._home, reach = _draw_homes(random, count, np.array(BOX), clearance)
        shape = (count, 3, _WAVES)
        self._frequency = random.uniform(*_FREQUENCIES, shape)
        self._phase = random.uniform(0.0, 2.0 * np.pi, shape)
        weight = random.uniform(0.2, 1.0, shape)
        # Along each axis |x'| <= Σ a f and |x''| <= Σ a f²; a third of the square for each axis.
        scale = np.minimum.reduce(
            [
                reach / weight.sum(axis=2),
                SPEED / math.sqrt(3.0) / (weight * self._frequency).sum(axis=2),
                ACCEL / math.sqrt(3.0) / (weight * self._frequency**2).sum(axis=2),
            ]
        )
        self._amplitude = _ROUNDING * scale[:, :, None] * weight

    def sample(self, time: float) -> tuple[Array, Array]:
        """Positions in [m] and velocities in [m]/[s] at a time in [s]. Shapes (count, 3)."""
        angle = self._frequency * time + self._phase
        position = self._home + (self._amplitude * np.sin(angle)).sum(axis=2)
        velocity = (self._amplitude * self._frequency * np.cos(angle)).sum(axis=2)
        return position, velocity

    def _publish_sample(self, sink: ObstacleSink, index: int, stamp: float) -> None:
        position, velocity = self.sample(stamp)
        sink.update(
            self.ids,
            stamp,
            position,
            velocity,
            radius=RADIUS,
            accel=ACCEL,
            speed=SPEED,
            source=self.name,
        )


def _draw_homes(
    random: np.random.Generator, count: int, box: Array, clearance: float
) -> tuple[Array, Array]:
    """Middles of the balls' own boxes, and half their extents. Shapes (count, 3)."""
    homes, reaches = np.empty((count, 3)), np.empty((count, 3))
    drawn = 0
    for _ in range(_ATTEMPTS * count):
        home = random.uniform(box[0], box[1])
        reach = random.uniform(*_TRAVEL, 3)
        reach = np.minimum(reach, np.minimum(home - box[0], box[1] - home))
        nearest = np.maximum(np.abs(home[:2]) - reach[:2], 0.0)
        if not (math.hypot(*nearest) >= clearance):
            continue
        homes[drawn], reaches[drawn] = home, reach
        drawn += 1
        if drawn == count:
            return homes, reaches
    raise ArmguardError(
        "clearance",
        f"{clearance} m leaves no room in the box {box.tolist()}",
        remedy="make the clearance less",
    )
