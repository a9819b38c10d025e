"""A camera that loses, swaps and misplaces what it sees, and bodies that know when it does.

The bodies move within their bounds and tethers, and towards the arm as fast as these allow while
they are hidden. Errors begin while a body is seen, and are so large that no body could have moved
so in the time of the whole episode: a smaller one cannot be told from a motion.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

ACCEL, SPEED, RADIUS = 10.0, 2.0, 0.06
POSITION_ERROR, VELOCITY_ERROR = 0.005, 0.1
DROPOUT = (0.03, 0.5)  # [s]
JUMP = (0.05, 1.0)  # [m]
LONGEST = 4  # false samples in a row


class Sample(NamedTuple):
    """What the camera says of one body."""

    name: str
    position: np.ndarray
    velocity: np.ndarray


def find_least_error(duration):
    """What no body could have moved, beside all errors, in a time in [s], either way; in [m]."""
    stray = 0.5 * ACCEL * duration**2 + VELOCITY_ERROR * duration + 2.0 * POSITION_ERROR
    return 2.0 * stray + 1e-3


class Body(NamedTuple):
    """A ball; its arrays change as it moves, in [m] and [m/s]."""

    name: str
    position: np.ndarray
    velocity: np.ndarray


class Limb:
    """Balls that are tethered one to the next, such as a shoulder, an elbow and a hand; or one.

    Each moves by what the one before it does and, beside that, by an equal share of the bounds. It
    can always stop, relatively, within its tether.

    Args:
        rng: Random numbers.
        names: Of its balls, from its root on.
        position: Of its root, in [m].
    """

    def __init__(self, rng, names, position):
        self._share = 1.0 / len(names)
        self.lengths = [np.inf, *rng.uniform(0.15, 0.4, len(names) - 1)]
        self._offsets, self._velocities = np.zeros((2, len(names), 3))
        self._offsets[0] = position
        for part, length in enumerate(self.lengths[1:], 1):
            way = rng.normal(size=3)
            self._offsets[part] = rng.uniform(0.2, 0.95) * length * way / np.linalg.norm(way)
        self.bodies = [Body(name, np.zeros(3), np.zeros(3)) for name in names]
        self._place()

    def move(self, directions, dt):
        """Accelerate each ball along a unit vector for so long; the bounds only weaken it."""
        rate, top = self._share * ACCEL, self._share * SPEED
        for part, direction in enumerate(directions):
            offset, velocity = self._offsets[part], self._velocities[part]
            faster = velocity + rate * dt * direction
            faster *= min(1.0, top / max(np.linalg.norm(faster), 1e-9))
            after = offset + 0.5 * dt * (velocity + faster)
            rest = after + faster * (np.linalg.norm(faster) / (2.0 * rate) + dt)
            if np.linalg.norm(rest) > 0.999 * self.lengths[part]:
                faster = velocity * max(0.0, 1.0 - rate * dt / max(np.linalg.norm(velocity), 1e-9))
                after = offset + 0.5 * dt * (velocity + faster)
            self._offsets[part], self._velocities[part] = after, faster
        self._place()

    def _place(self):
        places, paces = self._offsets.cumsum(0), self._velocities.cumsum(0)
        for body, place, pace in zip(self.bodies, places, paces, strict=True):
            body.position[:], body.velocity[:] = place, pace


class SyntheticCamera:
    """Sends samples of bodies at a rate, some of them false, and some not at all.

    Args:
        rng: Random numbers.
        bodies: What it sees.
        period: Between two looks, in [s].
    """

    def __init__(self, rng, bodies, period):
        self._rng, self._bodies, self.period = rng, bodies, period
        count = len(bodies)
        self.hidden_until = np.full(count, -np.inf)
        self._false_left = np.zeros(count, dtype=int)
        self._true_at = np.full(count, -np.inf)
        self._offset = np.zeros((count, 3))
        self._swapped = np.arange(count)
        self.false_count = self.swap_count = 0

    def is_hidden(self, k, now):
        """Whether a body is not seen at a time in [s]."""
        return now < self.hidden_until[k]

    def look(self, now):
        """Samples of one moment, in [s]; not more than one look in a period."""
        rng, bodies, samples = self._rng, self._bodies, []
        self._begin_episodes(now)
        for k, body in enumerate(bodies):
            if self.is_hidden(k, now):
                self._false_left[k] = 0
                continue
            seen, offset = body, np.zeros(3)
            if self._false_left[k] > 0:
                seen, offset = bodies[self._swapped[k]], self._offset[k]
                self._false_left[k] -= 1
                self.false_count += 1
            else:
                self._true_at[k] = now
            error, slip = rng.normal(size=(2, 3))
            error *= POSITION_ERROR * rng.random() / np.linalg.norm(error)
            slip *= VELOCITY_ERROR * rng.random() / np.linalg.norm(slip)
            told = seen.velocity + slip
            told *= min(1.0, SPEED / max(np.linalg.norm(told), 1e-9))
            samples.append(Sample(body.name, seen.position + offset + error, told))
        return samples

    def _begin_episodes(self, now):
        rng, count = self._rng, len(self._bodies)
        for k in range(count):
            if self.is_hidden(k, now) or self._false_left[k] > 0 or self._true_at[k] == -np.inf:
                # What was never seen is in no table.
                continue
            if rng.random() < 1.5 * self.period:
                self.hidden_until[k] = now + rng.uniform(*DROPOUT)
            elif rng.random() < 2.0 * self.period:
                self._begin_jump(k, now)
            elif rng.random() < 2.0 * self.period and count > 1:
                self._begin_swap(k, int((k + rng.integers(1, count)) % count), now)

    def _was_true(self, k, now):
        return now - self._true_at[k] < 1.5 * self.period and not self.is_hidden(k, now)

    def _begin_jump(self, k, now):
        length = int(self._rng.integers(1, LONGEST + 1))
        size = self._rng.uniform(*JUMP)
        if not self._was_true(k, now) or size < find_least_error((length + 1) * self.period):
            return
        offset = self._rng.normal(size=3)
        self._offset[k] = size * offset / np.linalg.norm(offset)
        self._false_left[k], self._swapped[k] = length, k

    def _begin_swap(self, k, other, now):
        length = int(self._rng.integers(1, LONGEST + 1))
        lasting = (length + 1) * self.period
        apart = np.linalg.norm(self._bodies[k].position - self._bodies[other].position)
        apart -= 2.0 * SPEED * lasting
        if not (self._was_true(k, now) and self._was_true(other, now)):
            return
        if self._false_left[other] > 0 or apart < find_least_error(lasting):
            return
        for one, two in ((k, other), (other, k)):
            self._false_left[one], self._swapped[one] = length, two
            self._offset[one] = 0.0
        self.swap_count += 1
