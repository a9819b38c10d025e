"""A recorded person who moves within bounds, to be true in a simulation.

Markers jump, and are not seen for a while: no body moves like that. Here each tracked point is a
mass that is drawn to where the marker is, with an acceleration and a speed that have bounds. So
what is simulated keeps these bounds exactly, at every time, some hundredths of a second late.
"""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from armguard.exceptions import ArmguardError
from armguard.lab.simulation.bodies import POINTS
from armguard.lab.simulation.recordings import ACCEL, SPEED, Recording

Array = NDArray[np.float64]

LAG = 0.04
"""By how much a point is behind a slow marker, in [s]; behind a fast one by more."""

SHARE = 0.99
"""Of the bounds, that is used."""

STILL = 1e-9
"""A person whose points are all slower rests, in [m]/[s]."""


class BoundedPerson:
    """A person who follows a recording.

    Args:
        recording: What was recorded.
        accel: Bound on the acceleration of each tracked point, in [m]/[s²].
        speed: Bound on its speed, in [m]/[s].

    Attributes:
        duration: Of the recording, in [s]; afterwards the person rests.

    Raises:
        ArmguardError: A point is never seen.
    """

    def __init__(self, recording: Recording, accel: float = ACCEL, speed: float = SPEED) -> None:
        self.duration = recording.duration
        self._step = step = 1.0 / recording.rate
        targets = _fill_gaps(recording.position, recording.name)
        x, v = targets[0], np.zeros_like(targets[0])
        track = []
        # After the last frame the person comes to rest there.
        for frame, target in enumerate(itertools.chain(targets[1:], itertools.repeat(targets[-1]))):
            if frame >= len(targets) and np.abs(v).max() <= STILL:
                break
            a = _pull(target - x, v, step, SHARE * accel, SHARE * speed)
            track.append((x, v, a))
            x, v = x + v * step + 0.5 * a * step**2, v + a * step
        self._track = np.array([*track, (x, np.zeros_like(v), np.zeros_like(v))])

    def sample(self, time: float) -> tuple[Array, Array]:
        """Tracked points at a time, not below 0, in [s] from the first frame.

        Returns:
            Positions in the world, in [m], and velocities, in [m]/[s], in the order of
            `bodies.POINTS`. Shapes (9, 3).
        """
        frame = min(int(time / self._step), len(self._track) - 1)
        since = time - frame * self._step
        x, v, a = self._track[frame]
        return x + v * since + 0.5 * a * since**2, v + a * since


def _pull(way: Array, v: Array, step: float, accel: float, speed: float) -> Array:
    """Accelerations of points towards where they are to be. Shape (n, 3)."""
    distance = np.linalg.norm(way, axis=1, keepdims=True)
    # As fast as it can still stop there.
    pace = np.minimum(np.minimum(distance / LAG, np.sqrt(accel * distance)), speed)
    change = pace * way / np.maximum(distance, 1e-12) - v
    size = np.linalg.norm(change, axis=1, keepdims=True)
    return change / step * np.minimum(1.0, accel * step / np.maximum(size, 1e-12))


def _fill_gaps(position: Array, name: str) -> Array:
    """Each marker where it was seen last, and at first where it will be. Shape (frames, n, 3)."""
    seen = np.isfinite(position).all(axis=2)
    never = [POINTS[number] for number in np.flatnonzero(~seen.any(axis=0))]
    if never:
        raise ArmguardError(f"recording {name!r}", f"never shows {', '.join(never)}")
    frames = np.where(seen, np.arange(len(position))[:, None], -1)
    last = np.maximum.accumulate(frames, axis=0)
    last = np.where(last < 0, seen.argmax(axis=0), last)
    filled: Array = position[last, np.arange(position.shape[1])]
    return filled
