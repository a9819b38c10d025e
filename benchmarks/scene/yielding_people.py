"""Recorded people whose bodies yield where the arm presses on them.

Each body is a point mass that a spring and a damper draw to where it was recorded. Where the arm's
cover meets it, the skin of the body is another spring and damper between both. The arm is moved by
nobody. Each body yields by itself, so a forearm that is pushed aside leaves its hand behind.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from armguard.body_regions import NUMBERS
from armguard.jit import kernel
from armguard.obstacles import Obstacles
from scene.clearance import Leaves, nearest_on_segment
from scene.example_limits import FIGURES, PATTERNS_OF_REGIONS
from scene.recorded_people import IDS, NAMES, RADII, People, Stream

HEAD = (150e3, 4.4)
"""Stiffness in [N]/[m] and mass in [kg] of the head, assumed: it has no contact limit."""
RETURN = 2.0 * math.pi
"""How fast a body comes back to where it was recorded, in [1]/[s]; critically damped."""
DAMPING = 0.3
"""Of the skin, as a share of the critical one."""
FINE_STEPS = 4
"""Of the bodies in one step of the arm: skin is stiff."""


class YieldingPeople(People):
    """As `People`, but the bodies yield; one case at a time.

    Attributes:
        offset: How far each body is from where it was recorded, in [m]. Shape (9, 3).
        drift: The derivative of that, in [m]/[s]. Shape (9, 3).
    """

    yields = True

    def __init__(
        self,
        path: Path,
        placement: np.ndarray,
        bounds: Mapping[str, tuple[float, float] | None],
    ) -> None:
        super().__init__(path, placement, bounds)
        self._recorded_seen = self.seen
        self._recorded_streams = self.streams
        find = Obstacles(regions=PATTERNS_OF_REGIONS).regions.find
        figures = []
        for each in find(NAMES):
            region = next(name for name, number in NUMBERS.items() if each >> number & 1)
            figures.append(FIGURES[region][1:] if region in FIGURES else HEAD)
        self._stiffness, self._mass = np.array(figures).T.copy()
        self.reset()

    def reset(self) -> None:
        """Begin a case: all bodies are where they were recorded."""
        self.offset, self.drift = np.zeros((len(NAMES), 3)), np.zeros((len(NAMES), 3))
        self.seen = self._recorded_seen.copy()
        self.streams = {
            key: _YieldingStream(stream, self) for key, stream in self._recorded_streams.items()
        }

    def ends_at(self, time: float) -> np.ndarray:
        """Where the bodies are now, if the time in [s] is the present one. Shape (9, 2, 3)."""
        found: np.ndarray = super().ends_at(time) + self.offset[:, None]
        return found

    def advance(self, since: float, dt: float, leaves: Leaves) -> None:
        """Let the bodies move until a time in [s], for so long, while the arm is at its end."""
        frame = self.frame(since)
        for step in range(FINE_STEPS):
            recorded = super().ends_at(since - dt * (1.0 - (step + 1) / FINE_STEPS))
            yield_to(
                leaves.centers, leaves.velocities, leaves.radius, recorded, RADII, self._stiffness,
                self._mass, self.offset, self.drift, dt / FINE_STEPS,
            )  # fmt: skip
        self.seen[frame] = self._recorded_seen[frame] + self.offset[:, None]


class _YieldingStream(Stream):
    """What is sent of bodies that yield, each frame at its own time."""

    def __init__(self, recorded: Stream, people: YieldingPeople) -> None:
        self.__dict__.update(recorded.__dict__)
        self._recorded, self._people = recorded.messages, people
        self.messages = list(recorded.messages)

    def publish(self, table: Obstacles, frame: int, begin: float) -> None:
        """Send what there is of a frame; `begin` is when the recording began, in [s]."""
        calls = []
        for call in self._recorded[frame]:
            rows = [IDS.index(name) for name in call.ids]
            calls.append(
                call._replace(
                    position=call.position + self._people.offset[rows, None],
                    velocity=call.velocity + self._people.drift[rows, None],
                )
            )
        self.messages[frame] = calls
        super().publish(table, frame, begin)


@kernel
def yield_to(  # type: ignore[no-untyped-def]
    centers, velocities, radius, ends, radii, stiffness, mass, offset, drift, dt
):
    """Move all bodies by one step; `offset` and `drift` are written. Shapes (bodies, 3)."""
    place = np.empty((2, 3))
    for body in range(ends.shape[0]):
        for k in range(2):
            for axis in range(3):
                place[k, axis] = ends[body, k, axis] + offset[body, axis]
        deepest, touching = 0.0, -1
        nx = ny = nz = 0.0
        for i in range(centers.shape[0]):
            x, y, z = centers[i]
            dx, dy, dz, distance = nearest_on_segment(x, y, z, place)
            depth = radius[i] + radii[body] - distance
            if depth > deepest and distance > 0.0:
                deepest, touching = depth, i
                nx, ny, nz = dx / distance, dy / distance, dz / distance
        push = 0.0
        if touching >= 0:
            vx, vy, vz = velocities[touching]
            closing = (vx - drift[body, 0]) * nx + (vy - drift[body, 1]) * ny
            closing += (vz - drift[body, 2]) * nz
            damper = 2.0 * DAMPING * math.sqrt(stiffness[body] * mass[body])
            push = max(0.0, stiffness[body] * deepest + damper * closing) / mass[body]
        for axis, along in enumerate((nx, ny, nz)):
            back = RETURN * RETURN * offset[body, axis] + 2.0 * RETURN * drift[body, axis]
            drift[body, axis] += dt * (push * along - back)
            offset[body, axis] += dt * drift[body, axis]
