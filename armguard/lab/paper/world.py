"""A world like the one of [Awareness]_, section 7, of any size: balls, and all pairs of them.

Each ball holds a random acceleration within its bound for a period, as in demos/02_paper.py. There
are no bounds on speed. To keep such a world going for thousands of periods, balls that have become
fast are slowed down and those outside their hall are turned back, within the same bounds; the hall
grows with the number of balls, so that they stand as densely whatever their number. They pass
through each other: while two overlap their contact time is 0.
"""

from __future__ import annotations

import numpy as np

from armguard.contact import earliest_contact
from armguard.jit.arrays import FloatArray, IntArray

RADIUS = 0.1
"""Of each ball, in [m]."""

SPACING = 2.0
"""Edge of the cube of the hall that each ball has to itself on average, in [m]."""

SLOWEST, FASTEST = 0.3, 1.2
"""Between which the balls' bounds on acceleration are drawn, in [m]/[s²]."""

PACE = 1.0
"""Speed from which on a ball is slowed down, in [m]/[s]."""

ADVANCES = 32
"""Of each evaluation: enough for contact times that are those of the quartic."""


class World:
    """Balls that fly about in a hall.

    Args:
        balls: How many, 2 or more.
        period: Between two steps, in [s].
        seed: Of all motions.

    Attributes:
        pairs: Number of pairs.
        period: As given.
    """

    def __init__(self, balls: int, period: float, seed: int) -> None:
        self.period = period
        self._random = np.random.default_rng(seed)
        self._half = 0.5 * SPACING * balls ** (1.0 / 3.0)
        self._accel = self._random.uniform(SLOWEST, FASTEST, balls)
        self._position = self._random.uniform(-self._half, self._half, (balls, 3))
        self._velocity = self._random.normal(0.0, 0.5 * PACE, (balls, 3))
        self._first, self._second = np.triu_indices(balls, 1)
        self._pair_accel = self._accel[self._first] + self._accel[self._second]
        self.pairs = self._first.size

    def step(self) -> None:
        """Go on by one period, in which each ball holds its acceleration."""
        balls = self._accel.size
        direction = self._random.normal(size=(balls, 3))
        fast = np.linalg.norm(self._velocity, axis=1) > PACE
        direction[fast] = -self._velocity[fast]
        outside = (np.abs(self._position) > self._half).any(axis=1)
        direction[outside] = -self._position[outside]
        direction /= np.linalg.norm(direction, axis=1)[:, None]
        share = np.where(fast | outside, 1.0, np.cbrt(self._random.random(balls)))
        accel = (share * self._accel)[:, None] * direction
        self._position += (self._velocity + 0.5 * accel * self.period) * self.period
        self._velocity += accel * self.period

    def compute_contact_times(self, pairs: IntArray | slice = slice(None)) -> FloatArray:
        """Earliest contact of some pairs, of all of them if none are named, in [s]. Shape (m,)."""
        first, second = self._first[pairs], self._second[pairs]
        return np.asarray(
            earliest_contact(
                self._position[second] - self._position[first],
                self._velocity[second] - self._velocity[first],
                2.0 * RADIUS,
                self._pair_accel[pairs],
                advances=ADVANCES,
            )
        )

    def compute_distances(self) -> FloatArray:
        """Distances of the centres of all pairs, in [m]. Shape (pairs,)."""
        apart = self._position[self._second] - self._position[self._first]
        distances: FloatArray = np.sqrt(np.einsum("ij,ij->i", apart, apart))
        return distances
