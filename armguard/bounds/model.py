"""The interface of all motion models."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import NamedTuple

import numpy.typing as npt
import pinocchio

from armguard.bounds.checks import check_question, check_vector
from armguard.bounds.sums import compute_levers
from armguard.jit.arrays import FloatArray
from armguard.robot.robot import Robot


class Question(NamedTuple):
    """A joint state, and a point of the arm that moves from it along a direction."""

    q: FloatArray
    """Measured joint positions, in [rad] or [m]. Shape (nv,)."""
    v: FloatArray
    """Measured joint velocities, in [rad]/[s] or [m]/[s]. Shape (nv,)."""
    joint: int
    """That carries the point."""
    local: FloatArray
    """The point, in that joint's frame, in [m]. Shape (3,)."""
    lever: FloatArray
    """Its levers, as `compute_levers` has them. Shape (1, nv)."""
    along: FloatArray
    """Unit vector in the frame of the robot's base. Shape (3,)."""
    t: float
    """From the state's stamp, in [s]."""


class MotionModel(ABC):
    """A bound on the arm's motion.

    Args:
        robot: The arm.
        base_placement: Placement of the robot's base in the world; None: they coincide.
    """

    def __init__(self, robot: Robot, base_placement: pinocchio.SE3 | None = None) -> None:
        self._robot = robot
        self._data = robot.model.createData()
        self._base = pinocchio.SE3.Identity() if base_placement is None else base_placement

    def advance(
        self,
        q: npt.ArrayLike,
        v: npt.ArrayLike,
        link: str,
        point: npt.ArrayLike,
        direction: npt.ArrayLike,
        t: float,
    ) -> float:
        """Bound on a point's displacement along a direction at every time in [0, t], in [m].

        The displacement is measured from the point's true position at the state's stamp. The error
        of this position must be part of the contact distance; all other effects of joint errors are
        included.

        Args:
            q: Measured joint positions, in [rad] or [m]. Shape (nv,).
            v: Measured joint velocities, in [rad]/[s] or [m]/[s]. Shape (nv,).
            link: Name of the link that carries the point.
            point: In the frame of the link's parent joint, in [m]. Shape (3,).
            direction: Unit vector in the world. Shape (3,).
            t: Time from the state's stamp, in [s], >= 0.

        Returns:
            Never negative, and never falling as t grows.

        Raises:
            ArmguardError: The link is unknown, a shape is wrong, a value is not finite, the time is
                negative, or the direction is not a unit vector. Except for `IsotropicMotion`, also
                if the state is beyond its limits by more than its errors.
        """
        robot = self._robot
        position = check_vector("joint positions", q, len(robot.velocity_limit))
        velocity = check_vector("joint velocities", v, len(robot.velocity_limit))
        local, along = check_question(point, direction, t)
        lever = compute_levers(robot, link, local[None])
        joint, along = robot.joint_index(link), self._base.rotation.T @ along
        question = Question(position, velocity, joint, local, lever, along, float(t))
        return max(0.0, self._bound(question))

    @abstractmethod
    def _bound(self, question: Question) -> float:
        """The bound of `advance` before it is limited to at least 0."""
