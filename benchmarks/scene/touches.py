"""Every touch of an arm and a recorded person: how long, how fast, how deep, how far it pressed."""

from __future__ import annotations

import math
from typing import Any, NamedTuple, Protocol

import numpy as np

from armguard.jit import kernel
from armguard.obstacles import Obstacles
from armguard.settings.contact_limits import ContactLimits
from scene.clearance import Leaves, nearest_on_segment
from scene.recorded_people import NAMES, RADII

RESTING = 1e-9
"""What is slower rests, in [m]/[s]: rounding is left at the end of a stop."""


class Touch(NamedTuple):
    """Time in which the arm's cover meets one body, from one moment on at which the arm moves."""

    body: str
    begin: float
    """Since the beginning of the recording, in [s]."""
    duration: float
    """In [s]."""
    speed: float
    """Of the surface where it touches first, in [m]/[s]."""
    fastest: float
    """Of the surfaces that touch, the most until the touch ends, in [m]/[s]."""
    limit: float
    """Of that body, in [m]/[s]; 0: it may never be touched."""
    depth: float
    """How far the cover enters the recorded body, which does not yield, at most, in [m]."""
    way: float
    """How far the surface moves into the body while they touch, in [m]."""
    is_promised: bool
    """Whether the body had kept its bounds until then."""

    @property
    def is_beyond(self) -> bool:
        """Whether the surface was faster than the limit."""
        return not self.fastest <= self.limit


def find_speed_limits(limits: ContactLimits, regions: dict[str, str]) -> np.ndarray:
    """How fast a surface may be that touches each body, in [m]/[s]. Shape (bodies,)."""
    max_speed, _, _, _ = limits.tabulate()
    sets = [int(number) for number in Obstacles(regions=regions).regions.find(NAMES)]
    return np.array(
        [
            min((speed for k, speed in enumerate(max_speed) if (each >> k) & 1), default=0.0)
            for each in sets
        ]
    )


class Log(Protocol):
    """Follows what an arm touches."""

    @property
    def touches(self) -> tuple[Any, ...]:
        """All of that until now."""

    def follow(
        self, since: float, dt: float, leaves: Leaves, ends: np.ndarray, broken: np.ndarray
    ) -> None:
        """Take one moment."""


class TouchLog:
    """Follows all touches of one case.

    Args:
        limits: Of each body, in [m]/[s]. Shape (bodies,).
    """

    def __init__(self, limits: np.ndarray) -> None:
        self._limits = limits
        self._open: dict[int, Touch] = {}
        self._closed: list[Touch] = []

    @property
    def touches(self) -> tuple[Touch, ...]:
        """All of them; those that have not ended last until now."""
        return (*self._closed, *self._open.values())

    def follow(
        self, since: float, dt: float, leaves: Leaves, ends: np.ndarray, broken: np.ndarray
    ) -> None:
        """Take one moment.

        Args:
            since: Since the beginning of the recording, in [s].
            dt: Since the last one, in [s].
            leaves: Of the arm, placed.
            ends: Of each body's axis, in [m]. Shape (bodies, 2, 3).
            broken: Which bodies broke their bounds shortly before. Shape (bodies,).
        """
        moves, spins = np.abs(leaves.velocities).max() > RESTING, leaves.spins
        for body, name in enumerate(NAMES):
            depth, speed, pressing = find_touch(
                leaves.centers, leaves.velocities, spins, leaves.radius, ends[body], RADII[body]
            )  # fmt: skip
            touch = self._open.get(body)
            if not depth >= 0.0:
                if touch is not None:
                    self._closed.append(self._open.pop(body))
                continue
            if touch is None:
                if not moves:
                    # The person touches an arm at rest: nothing the arm did.
                    continue
                limit, is_promised = float(self._limits[body]), not broken[body]
                touch = Touch(name, since, -dt, speed, 0.0, limit, 0.0, 0.0, is_promised)
            self._open[body] = touch._replace(
                duration=touch.duration + dt,
                fastest=max(touch.fastest, speed),
                depth=max(touch.depth, depth),
                way=touch.way + pressing * dt,
            )


@kernel
def find_touch(centers, velocities, spins, radius, ends, body_radius):  # type: ignore[no-untyped-def]
    """How deep spheres are in a body, how fast their surfaces are there, and how fast they press.

    Depth in [m], -inf where none touches; the speed of the fastest point of a surface that is the
    deepest of its sphere, in [m]/[s]; and the greatest speed of such a point into the body.
    """
    deepest, fastest, pressing = -math.inf, 0.0, 0.0
    for i in range(centers.shape[0]):
        x, y, z = centers[i]
        dx, dy, dz, distance = nearest_on_segment(x, y, z, ends)
        depth = radius[i] + body_radius - distance
        if depth < 0.0:
            continue
        deepest = max(deepest, depth)
        share = radius[i] / max(distance, 1e-9)
        px, py, pz = share * dx, share * dy, share * dz
        wx, wy, wz = spins[i]
        vx = velocities[i, 0] + wy * pz - wz * py
        vy = velocities[i, 1] + wz * px - wx * pz
        vz = velocities[i, 2] + wx * py - wy * px
        fastest = max(fastest, math.sqrt(vx * vx + vy * vy + vz * vz))
        pressing = max(pressing, (vx * dx + vy * dy + vz * dz) / max(distance, 1e-9))
    return deepest, fastest, pressing
