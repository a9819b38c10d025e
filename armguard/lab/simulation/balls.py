"""Balls that wander about a cell, within stated bounds on speed and acceleration.

Each coordinate is a sum of sines whose amplitudes are derived from the bounds: they hold exactly,
at every time, and positions and velocities are known without integration.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armguard.exceptions import ArmguardError
from armguard.lab.simulation.sources import ObstacleSink, SampledSource

Array = NDArray[np.float64]

_WAVES = 3
_FREQUENCIES = (0.3, 3.0)  # [rad/s]
_TRAVEL = (0.2, 1.0)  # half the extent of one ball's own box along an axis, at most, in [m]
_ROUNDING = 1.0 - 1e-9
_ATTEMPTS = 1000


class WanderingBalls(SampledSource):
    """Balls named "ball-0", "ball-1", …, each on a smooth closed-form motion of its own.

    Args:
        count: How many.
        seed: The same seed gives the same motions.
        radius: Of each ball, in [m].
        accel: Bound on accelerations, in [m]/[s²]; published with the balls.
        speed: Bound on speeds, in [m]/[s]; published with the balls.
        lower: Corner of the box that the centres stay in, in the world, in [m]. Shape (3,).
        upper: The opposite corner. Shape (3,).
        clearance: The centres stay this far from the z axis, where the arm stands, in [m].
        rate: In [Hz].
        duration: In [s].
        name: Of the source.

    Raises:
        ArmguardError: An argument is out of bounds, or the clearance leaves no room in the box.
    """

    def __init__(
        self,
        count: int,
        seed: int,
        *,
        radius: float = 0.1,
        accel: float = 10.0,
        speed: float = 2.0,
        lower: ArrayLike = (-4.0, -4.0, 0.0),
        upper: ArrayLike = (4.0, 4.0, 2.0),
        clearance: float = 0.0,
        rate: float = 50.0,
        duration: float = math.inf,
        name: str = "balls",
    ) -> None:
        super().__init__(name, rate, duration)
        if not (count >= 1):
            raise ArmguardError(name, f"{count} balls were asked for", expected="at least one")
        for what, value in (("radius", radius), ("accel", accel), ("speed", speed)):
            if not (0.0 < value < math.inf):
                raise ArmguardError(f"{name}: {what}", f"is {value}", expected="more than 0")
        self.ids = [f"ball-{number}" for number in range(count)]
        self.radius = radius
        self.accel = accel
        self.speed = speed
        random = np.random.default_rng(seed)
        box = np.array([lower, upper], dtype=np.float64)
        if not (box.shape == (2, 3) and (box[0] < box[1]).all() and np.isfinite(box).all()):
            raise ArmguardError(name, f"cannot wander in the box {box.tolist()}")
        self._home, reach = _draw_homes(random, count, box, clearance)
        shape = (count, 3, _WAVES)
        self._frequency = random.uniform(*_FREQUENCIES, shape)
        self._phase = random.uniform(0.0, 2.0 * np.pi, shape)
        weight = random.uniform(0.2, 1.0, shape)
        # Along each axis |x'| <= Σ a f and |x''| <= Σ a f²; a third of the square for each axis.
        scale = np.minimum.reduce(
            [
                reach / weight.sum(axis=2),
                speed / math.sqrt(3.0) / (weight * self._frequency).sum(axis=2),
                accel / math.sqrt(3.0) / (weight * self._frequency**2).sum(axis=2),
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
            radius=self.radius,
            accel=self.accel,
            speed=self.speed,
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
        remedy="make the box wider or the clearance less",
    )
