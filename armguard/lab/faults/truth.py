"""What truly happened: whether the arm touched anybody while it moved, by their geometry.

Distances are measured from the convex hulls of the arm's links to the people, never below by more
than rounding. The monitor is not asked. Between two measurements nothing can come nearer than two
bodies at full speed do, so the next one is as far away as the last distance allows.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from armguard.lab.faults.scene import RADIUS
from armguard.pairs.hull_distance import HullDistance
from armguard.robot.kinematics import Kinematics
from armguard.robot.robot import Robot

Array = NDArray[np.float64]

CLOSING_SPEED = 6.0
"""Faster than this, in [m/s], no point of the arm and no person come nearer to each other: people
keep to 2 m/s, and the stretched arm at 0.65 rad/s to a good 1 m/s."""

OUT_OF_REACH = 1.6
"""A body whose axis stands so far from that of the arm's base, in [m], is not near any link."""

SURELY_APART = 0.2
"""So far, in [m], it is from any link at the least: the stretched arm reaches 1.2 m."""


class Closest(NamedTuple):
    """How near a moving arm came to bodies."""

    contacts: int
    """Times that a link touched a body while the arm moved; one that lasts counts once."""
    distance: float
    """The smallest distance while the arm moved, in [m], 0 at most where it touched; inf where it
    never moved within reach of a body."""
    moving: float
    """Share of the steps in which the arm moved."""


class Witness:
    """Measures how near an arm came to bodies.

    Args:
        robot: The arm.
    """

    def __init__(self, robot: Robot) -> None:
        self._links = len(robot.links)
        self._kinematics = Kinematics(robot)
        self._hulls = HullDistance(robot, self._kinematics)

    def measure(self, q: Array, v: Array, points: Array) -> float:
        """Distance from the arm to the nearest body in [m]; inf where none is within reach.

        Args:
            q: Joint positions, in [rad]. Shape (nv,).
            v: Their derivatives, in [rad/s]. Shape (nv,).
            points: Ends of the bodies' axes in the world, in [m]. Shape (n, 2, 3).
        """
        near = points[np.hypot(points[:, 0, 0], points[:, 0, 1]) < OUT_OF_REACH]
        if not len(near):
            return np.inf
        self._kinematics.compute(q, v)
        return min(
            self._hulls.distance(link, body, RADIUS)[0]
            for body in near
            for link in range(self._links)
        )

    def follow(
        self,
        times: Array,
        q: Array,
        v: Array,
        bodies: Callable[[float], Array],
        *,
        only_first: bool = False,
    ) -> Closest:
        """How near an arm came to bodies while it moved.

        Args:
            times: Of its steps, in [s]. Shape (n,).
            q: Joint positions, in [rad]. Shape (n, nv).
            v: Their derivatives, in [rad/s]. Shape (n, nv).
            bodies: Ends of the bodies' axes in [m] at a time in [s]. Shape (k, 2, 3).
            only_first: Whether the first contact is all that matters.
        """
        moving = np.any(v != 0.0, axis=1)
        contacts, closest, touched, unknown_from = 0, np.inf, False, -np.inf
        for row in np.flatnonzero(moving):
            if times[row] < unknown_from:
                continue
            distance = self.measure(q[row], v[row], bodies(times[row]))
            touches = distance <= 0.0
            contacts += touches and not touched
            touched = touches
            if touches and only_first:
                break
            closest = min(closest, distance)
            apart = max(min(distance, SURELY_APART), 0.0)
            unknown_from = times[row] + apart / CLOSING_SPEED
        return Closest(int(contacts), float(closest), float(moving.mean()) if len(v) else 0.0)
