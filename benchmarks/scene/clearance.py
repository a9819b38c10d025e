"""Distances between the arm's cover and a person's bodies, for whatever needs no bound."""

from __future__ import annotations

import math

import numpy as np

from armguard.bounds import JointMotion
from armguard.jit import kernel
from armguard.robot import Kinematics, Robot


class Leaves:
    """The finest spheres of an arm's cover, and which joints move them.

    Attributes:
        kinematics: Computed by `place`.
        radius: In [m]. Shape (n,).
        link: Of each sphere. Shape (n,).
        moves: Which joints move each link. Shape (links, nv).
        reach: How far a joint moves a sphere per radian at most, the most of all spheres, in
            [m]/[rad]. Shape (nv,).
    """

    def __init__(self, robot: Robot) -> None:
        self.kinematics = Kinematics(robot)
        spheres = self.kinematics.spheres
        self._leaves = np.flatnonzero(spheres.child_count == 0)
        self.radius = spheres.radius[self._leaves].copy()
        self.link = spheres.link[self._leaves].copy()
        self.moves = self.kinematics.placement.moves[spheres.joint[spheres.root]]
        self._moves = self.kinematics.placement.moves[spheres.joint[self._leaves]]
        self.reach = JointMotion(robot).lever.max(axis=0)

    def place(self, q: np.ndarray, v: np.ndarray) -> None:
        """Place the arm at a joint state; positions and velocities, both of shape (nv,)."""
        self.kinematics.compute(q, v)
        self.centers = self.kinematics.centers[self._leaves]
        self.velocities = self.kinematics.velocities[self._leaves]
        self._v = v

    @property
    def spins(self) -> np.ndarray:
        """Angular velocities of the spheres, in [rad]/[s]. Shape (n, 3)."""
        found: np.ndarray = (self._moves * self._v) @ self.kinematics.placement.jacobian[:, 3:]
        return found

    def gaps(self, ends: np.ndarray, radii: np.ndarray) -> np.ndarray:
        """Distance of the whole arm from each body, below 0 in contact, in [m]. Shape (bodies,).

        Args:
            ends: Of each body's axis, in [m]. Shape (bodies, 2, 3).
            radii: In [m]. Shape (bodies,).
        """
        found: np.ndarray = find_gaps(self.centers, self.radius, ends, radii)
        return found


@kernel
def nearest_on_segment(x, y, z, ends):  # type: ignore[no-untyped-def]
    """From a point to the nearest one of a segment: the difference, and its length."""
    ax, ay, az = ends[0]
    sx, sy, sz = ends[1, 0] - ax, ends[1, 1] - ay, ends[1, 2] - az
    square = sx * sx + sy * sy + sz * sz
    share = 0.0
    if square > 1e-18:
        share = ((x - ax) * sx + (y - ay) * sy + (z - az) * sz) / square
        share = min(max(share, 0.0), 1.0)
    dx, dy, dz = ax + share * sx - x, ay + share * sy - y, az + share * sz - z
    return dx, dy, dz, math.sqrt(dx * dx + dy * dy + dz * dz)


@kernel
def find_gaps(centers, radius, ends, radii):  # type: ignore[no-untyped-def]
    """Least distance of any sphere from each body, in [m]. Shape (bodies,)."""
    gaps = np.full(ends.shape[0], math.inf)
    for body in range(ends.shape[0]):
        for i in range(centers.shape[0]):
            x, y, z = centers[i]
            _, _, _, distance = nearest_on_segment(x, y, z, ends[body])
            gaps[body] = min(gaps[body], distance - radius[i] - radii[body])
    return gaps


@kernel
def is_separate(  # type: ignore[no-untyped-def]
    centers, velocities, radius, link, stopping, ends, radii, ages, response, human_speed, error
):
    """Whether every sphere is farther from every body than the protective separation distance.

    A body whose age is infinite is left out: it was not seen yet.
    """
    for body in range(ends.shape[0]):
        if ages[body] == math.inf:
            continue
        for i in range(centers.shape[0]):
            x, y, z = centers[i]
            dx, dy, dz, distance = nearest_on_segment(x, y, z, ends[body])
            ux, uy, uz = velocities[i]
            towards = math.sqrt(ux * ux + uy * uy + uz * uz)
            if distance > 0.0:
                towards = max(0.0, (dx * ux + dy * uy + dz * uz) / distance)
            time = stopping[link[i]]
            away = human_speed * (ages[body] + response + time) + error
            away += towards * (response + 0.5 * time)
            if not distance - radius[i] - radii[body] > away:
                return False
    return True
