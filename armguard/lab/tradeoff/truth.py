"""The ground truth of a scene: the arm's true surface, and the contacts with it.

It uses no covers, bounds or contact times, only corners of the links' meshes, placed by Pinocchio,
and distances to the reported bodies. A corner is on the link, so each result is a contact; a
contact inside a face may be missed.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio
from numpy.typing import NDArray

from armguard.lab.tradeoff.scene import Scene
from armguard.messages.batch import Field, ObstacleBatch
from armguard.robot.robot import Robot

Array = NDArray[np.float64]

DOUBT = 0.5
"""Time after a broken bound in which no proof about the body is expected to hold, in [s]."""

Seen = tuple[ObstacleBatch, int]
"""A message and the row of a body in it."""


class TrueArm:
    """The corners of the links' surfaces.

    Args:
        robot: The arm.
        base: Of its base in the world; None: at the origin.

    Attributes:
        links: For each, the index of its joint and its corners in that joint's frame, [m].
    """

    def __init__(self, robot: Robot, base: pinocchio.SE3 | None) -> None:
        self._model, self.data = robot.model, robot.model.createData()
        self._base = base or pinocchio.SE3.Identity()
        self.links = [(robot.joint_index(link), robot.hull(link)) for link in robot.links]
        self._balls = []
        for _, corners in self.links:
            middle = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
            self._balls.append((middle, float(np.linalg.norm(corners - middle, axis=1).max())))

    def place(self, q: Array) -> None:
        """Compute where it is, at positions in [rad] or [m]. Shape (nv,)."""
        pinocchio.forwardKinematics(self._model, self.data, q)

    def placement(self, link: int) -> pinocchio.SE3:
        """Of a link's joint in the world."""
        return self._base * self.data.oMi[self.links[link][0]]

    def corners(self, link: int) -> Array:
        """Of a link, in the world, in [m]. Shape (n, 3)."""
        placement = self.placement(link)
        placed: Array = self.links[link][1] @ placement.rotation.T + placement.translation
        return placed

    def gap(self, ends: Array, radius: float, within: float = 0.0) -> tuple[float, int, int]:
        """Distance of the arm from a body, and by which link and corner; inf if it is not near.

        Args:
            ends: Of the body's axis, in [m]. Shape (k, 3), k = 1 or 2.
            radius: Of the body, in [m].
            within: Only distances up to this are wanted, in [m].
        """
        best = np.inf, -1, -1
        for link, (middle, reach) in enumerate(self._balls):
            placement = self.placement(link)
            center = placement.rotation @ middle + placement.translation
            if measure(center[None], ends)[0] - reach - radius > min(within, best[0]):
                continue
            away = measure(self.corners(link), ends) - radius
            corner = int(away.argmin())
            if away[corner] < best[0]:
                best = float(away[corner]), link, corner
        return best


def measure(points: Array, ends: Array) -> Array:
    """Distances of points from a segment, in [m]. Shapes (n, 3), (k, 3) -> (n,)."""
    start, along = ends[0], ends[-1] - ends[0]
    square = float(along @ along)
    share = np.zeros(len(points))
    if square > 0.0:
        share = np.clip((points - start) @ along / square, 0.0, 1.0)
    distances: Array = np.linalg.norm(points - start - share[:, None] * along, axis=1)
    return distances


class Contact(NamedTuple):
    """The first time at which a reported body touches the arm."""

    time: float
    """[s] of the scene."""
    first_seen: float
    """Time of the body's first message, in [s]."""
    body: str
    is_beyond: bool
    """Whether the body broke its stated bounds shortly before, so no proof covers it."""


def find_contacts(scene: Scene, arm: TrueArm, accel: float, speed: float) -> list[Contact]:
    """All contacts of a moving arm with the reported bodies, in the order of time.

    Args:
        scene: What happened.
        arm: Whose surface counts.
        accel: Bound on the acceleration of bodies of which none is told, in [m]/[s²].
        speed: Bound on the speed of those, in [m]/[s].
    """
    contacts: list[Contact] = []
    touching: set[str] = set()
    past: dict[str, list[Seen]] = {}
    for message in scene.messages:
        if not message.ids:
            continue
        q, v = scene.sample(message.stamp)
        arm.place(q)
        for row, body in enumerate(message.ids):
            seen = past.setdefault(body, [])
            seen.append((message, row))
            gap, _, _ = arm.gap(message.position[row], float(np.asarray(message.radius)[row]))
            if gap > 0.0:
                touching.discard(body)
            elif body not in touching:
                touching.add(body)
                if np.abs(v).max() > 1e-6 and len(seen) > 1:
                    is_beyond = _broke_bounds(seen, accel, speed)
                    contacts.append(Contact(message.stamp, seen[0][0].stamp, body, is_beyond))
    return contacts


def _broke_bounds(seen: list[Seen], usual_accel: float, usual_speed: float) -> bool:
    """Whether two of a body's last samples cannot both be true of one within its bounds."""
    end = seen[-1][0].stamp
    recent = [one for one in seen if one[0].stamp >= end - DOUBT]
    for k, (first, i) in enumerate(recent):
        accel, speed = _read(first.accel, i, usual_accel), _read(first.speed, i, usual_speed)
        for later, j in recent[k + 1 :]:
            time = later.stamp - first.stamp
            errors = _read(first.position_error, i) + _read(later.position_error, j)
            pace_error = _read(first.velocity_error, i)
            moved = later.position[j] - first.position[i]
            pace, later_pace = np.asarray(first.velocity)[i], np.asarray(later.velocity)[j]
            straight, turned = moved - pace * time, later_pace - pace
            is_fine = (
                np.linalg.norm(straight, axis=1).max()
                <= 0.5 * accel * time**2 + pace_error * time + errors + 1e-9
                and np.linalg.norm(moved, axis=1).max() <= speed * time + errors + 1e-9
                and np.linalg.norm(turned, axis=1).max()
                <= accel * time + pace_error + _read(later.velocity_error, j) + 1e-9
            )
            if not is_fine:
                return True
    return False


def _read(values: Field | None, row: int, otherwise: float = 0.0) -> float:
    """A bound or an error of one row; `otherwise` where none is told."""
    return otherwise if values is None else float(np.asarray(values)[row])
