"""An adversarial body and arm: the earliest real contact within their bounds.

A contact that is found here is possible, so no honest contact time is later, and how much earlier
an answer is says how tight it is. Nobody claims that these two play their best: the true first
contact may be sooner still. Independent of all bounds: plain steps in time, and Pinocchio.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import pinocchio
from numpy.typing import NDArray

from armguard.lab.tradeoff.truth import TrueArm, measure
from armguard.robot.robot import Robot

Array = NDArray[np.float64]

STEP = 0.002
"""Of time, in [s]."""

HORIZON = 1.0
"""How far ahead, in [s]."""


class Body(NamedTuple):
    """A body that may hunt the arm."""

    ends: Array
    """Of its axis, [m]. Shape (k, 3)."""
    velocity: Array
    """[m]/[s]. Shape (3,)."""
    radius: float
    accel: float
    """[m]/[s²]."""
    speed: float
    """[m]/[s]."""


class Adversary:
    """An arm that hunts.

    Args:
        robot: The arm.
        base: Of its base in the world; None: at the origin.
        velocity: What its joints keep to, in [rad]/[s] or [m]/[s]. Shape (nv,).
        acceleration: By how much they speed up, in [rad]/[s²] or [m]/[s²]. Shape (nv,).
    """

    def __init__(
        self, robot: Robot, base: pinocchio.SE3 | None, velocity: Array, acceleration: Array
    ) -> None:
        self._robot, self._arm = robot, TrueArm(robot, base)
        self._base = base or pinocchio.SE3.Identity()
        self._velocity, self._acceleration = velocity, acceleration

    def find_contact(self, q: Array, v: Array, body: Body, horizon: float = HORIZON) -> float:
        """The soonest contact that was found, in [s]; inf if there was none.

        Each link hunts with its corner that is nearest at the start.
        """
        self._arm.place(q)
        away = [measure(self._arm.corners(k), body.ends) for k in range(len(self._arm.links))]
        soonest = math.inf
        # The nearest first: none of the others is followed for longer than it took.
        for link in sorted(range(len(away)), key=lambda link: float(away[link].min())):
            corner = int(away[link].argmin())
            soonest = min(soonest, self._hunt(q, v, body, link, corner, min(horizon, soonest)))
        return soonest

    def _hunt(
        self, q: Array, v: Array, body: Body, link: int, corner: int, horizon: float
    ) -> float:
        """When a corner and a body meet that run at each other as fast as they can."""
        robot, arm = self._robot, self._arm
        joint, corners = arm.links[link]
        lower, upper = robot.lower_position_limit, robot.upper_position_limit
        q, v, ends, pace = q.copy(), v.copy(), body.ends.copy(), body.velocity.copy()
        for step in range(int(horizon / STEP) + 1):
            pinocchio.computeJointJacobians(robot.model, arm.data, q)
            placement = arm.placement(link)
            point = placement.rotation @ corners[corner] + placement.translation
            nearest = _nearest(point, ends)
            away = nearest - point
            distance = float(np.linalg.norm(away))
            if distance <= body.radius:
                return step * STEP
            direction = away / distance
            # Towards the body, and no joint faster than it may be, or past where it must brake.
            turned = self._base.rotation.T @ direction
            local = self._base.actInv(point)
            jacobian = pinocchio.getJointJacobian(
                robot.model, arm.data, joint, pinocchio.ReferenceFrame.WORLD
            )
            gradient = jacobian[:3].T @ turned + jacobian[3:].T @ _cross(local, turned)
            push = np.where(gradient >= 0.0, self._acceleration, -self._acceleration)
            wanted = np.clip(v + push * STEP, -self._velocity, self._velocity)
            room = np.where(wanted >= 0.0, upper - q, q - lower)
            stopping = wanted**2 / (2.0 * self._acceleration) + np.abs(wanted) * STEP
            braked = np.sign(v) * np.maximum(np.abs(v) - self._acceleration * STEP, 0.0)
            wanted = np.where(stopping < room, wanted, braked)
            q = np.clip(q + 0.5 * (v + wanted) * STEP, lower, upper)
            v = wanted
            # The body's velocity stays in its ball: to project back is no farther than the push.
            before, pace = pace, pace - body.accel * STEP * direction
            swift = float(np.linalg.norm(pace))
            if swift > body.speed:
                pace = pace * (body.speed / swift)
            ends += 0.5 * (before + pace) * STEP
        return math.inf


def _cross(first: Array, second: Array) -> Array:
    """Their cross product; NumPy's own takes ten times as long for one."""
    (a, b, c), (x, y, z) = first.tolist(), second.tolist()
    return np.array([b * z - c * y, c * x - a * z, a * y - b * x])


def _nearest(point: Array, ends: Array) -> Array:
    along = ends[-1] - ends[0]
    square = float(along @ along)
    share = 0.0 if square == 0.0 else min(max(float((point - ends[0]) @ along) / square, 0.0), 1.0)
    nearest: Array = ends[0] + share * along
    return nearest
