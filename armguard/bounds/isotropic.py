"""The simplest motion model: each point of the arm as a free body with its own bounds.

With joint velocities and accelerations within their limits, a point's speed is at most
sum_j R_j qd_j, and its acceleration at most sum_j R_j qdd_j + sum_ij R_max(i, j) qd_i qd_j. Of
operating limits, velocities count alone: joints slow down by as much as the hardware allows.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import pinocchio

from armguard.bounds.checks import check_vector, read_only
from armguard.bounds.free_body import free_displacement
from armguard.bounds.model import MotionModel, Question
from armguard.bounds.sums import (
    compute_sphere_levers,
    sum_accelerations,
    sum_levers,
    turning_joints,
    velocity_error_terms,
)
from armguard.jit.arrays import FloatArray
from armguard.jit.kernels import kernel
from armguard.jit.numerics import SUM_ROUNDING
from armguard.robot.operating_limits import LimitsInForce, OperatingLimits, put_in_force
from armguard.robot.robot import Robot


class VelocityErrors(NamedTuple):
    """What velocities of spheres may be off by, for compiled code that fills it."""

    rate: FloatArray
    """What the errors grow by with joint speeds, [m] or 1. Shape (n, nv)."""
    at_rest: FloatArray
    """Errors at rest, [m/s]. Shape (n,)."""
    error: FloatArray
    """Errors at the joint velocity of the last filling, [m/s]. Shape (n,)."""


class IsotropicMotion(MotionModel):
    """The simplest motion model: one acceleration and one speed bound for each sphere.

    It ignores the configuration, so its bounds are constants. A tick only computes the effect of
    joint errors at the present joint speeds. The arrays are read-only views with a fixed place in
    memory, in the order of the arm's spheres (the trees of `robot.links`, one after the other).

    Attributes:
        lever: Proved levers R_j, in [m], or 1 for a prismatic joint. Shape (n, nv).
        accel: Bound on each centre's acceleration, in [m]/[s²]. Shape (n,).
        speed: Bound on each centre's speed, in [m]/[s]. Shape (n,).
        position_error: Greatest error of a centre's position, in [m]. Shape (n,).
        velocity_error: Greatest error of its velocity, in [m]/[s], at the joint velocity of the
            last `update`; infinite before the first. Shape (n,).
        velocity_errors: The same array and what it is made from, to be filled by compiled code.
        surface_speed: Bound on the speed of any point of each link, in [m]/[s]. Shape (L,).
        is_widened: Whether a joint is measured beyond its limit, so that the bounds are wider.
        surface_position_error: Greatest position error of any point of each link, in [m]. Shape
            (L,).
    """

    def __init__(
        self,
        robot: Robot,
        base_placement: pinocchio.SE3 | None = None,
        *,
        operating: OperatingLimits | LimitsInForce | None = None,
    ) -> None:
        """Compute the levers and what follows from them; about a second for 1,000 spheres.

        Args:
            robot: The arm, with its limits and errors.
            base_placement: Placement of the robot's base in the world; None: they coincide.
            operating: Operating limits of the joints; None: the robot's limits.

        Raises:
            ArmguardError: Operating limits do not fit the robot.
        """
        super().__init__(robot, base_placement)
        self._in_force = put_in_force(robot, operating)
        self._revision = self._in_force.revision
        trees = [robot.cover.tree(link) for link in robot.links]
        self.lever = compute_sphere_levers(robot)
        # Every point of a link is in one of the leaves, so these bound the whole of it.
        leaf = np.concatenate([tree.child_count for tree in trees]) == 0
        link_of = np.repeat(np.arange(len(trees)), [len(tree.spheres) for tree in trees])
        radius = np.concatenate([tree.spheres[:, 3] for tree in trees])
        turns = np.array([turning_joints(robot, link) for link in robot.links])
        self._leaf_link = link_of[leaf]
        self._leaf_lever = self.lever[leaf] + radius[leaf, None] * turns[self._leaf_link]

        count = len(radius)
        self._speed = np.empty(count)
        self._accel = np.empty(count)
        self._velocity_error = np.full(count, np.inf)
        self._surface_speed = np.empty(len(trees))
        self.speed = read_only(self._speed)
        self.accel = read_only(self._accel)
        self.velocity_error = read_only(self._velocity_error)
        self.surface_speed = read_only(self._surface_speed)
        self.position_error = read_only(sum_levers(self.lever, robot.position_error))
        surface_error = np.zeros(len(trees))
        leaf_error = sum_levers(self._leaf_lever, robot.position_error)
        np.maximum.at(surface_error, self._leaf_link, leaf_error)
        self.surface_position_error = read_only(surface_error)
        self.velocity_errors = VelocityErrors(
            *velocity_error_terms(self.lever, robot.position_error, robot.velocity_error),
            self._velocity_error,
        )
        self._fastest = np.array(self._in_force.velocity, dtype=np.float64)
        self.is_widened = False
        self._fill_bounds()

    def update(self, v: npt.ArrayLike) -> bool:
        """Fill `velocity_error` for the measured joint velocity, and widen the bounds if necessary.

        Compiled code may do the first by `fill_velocity_errors`, and need only call this where a
        joint is measured beyond its limit, or was in the last call, or other limits are in force.

        A joint that is measured faster than its limit counts with its measured velocity: within its
        error this is possible, and beyond it a monitor stops the arm anyway.

        Args:
            v: Measured joint velocities, in [rad]/[s] or [m]/[s]. Shape (nv,).

        Returns:
            Whether a speed or acceleration bound grew; then proofs with the earlier bounds may not
            hold.

        Raises:
            ArmguardError: The vector has the wrong length or is not finite.
        """
        velocity = check_vector("joint velocities", v, len(self._fastest))
        limit, revision = self._in_force.velocity, self._in_force.revision
        fill_velocity_errors(velocity, self.velocity_errors)
        self.is_widened, was_widened = exceeds(velocity, limit), self.is_widened
        if not (self.is_widened or was_widened or revision != self._revision):
            return False
        self._revision = revision
        fastest = np.maximum(np.abs(velocity), limit)
        grew = bool((fastest > self._fastest).any())
        self._fastest = fastest
        self._fill_bounds()
        return grew

    def _bound(self, question: Question) -> float:
        robot, velocity, lever = self._robot, question.v, question.lever
        fastest = np.maximum(self._in_force.velocity, np.abs(velocity))
        speed = float(sum_levers(lever, fastest)[0])
        accel = float(sum_accelerations(lever, fastest, robot.acceleration_limit)[0])
        rate, at_rest = velocity_error_terms(lever, robot.position_error, robot.velocity_error)
        velocity_error = float((rate @ np.abs(velocity) + at_rest)[0])

        pinocchio.forwardKinematics(robot.model, self._data, question.q, velocity)
        spatial = self._data.v[question.joint]
        point_velocity = self._data.oMi[question.joint].rotation @ (
            spatial.linear + np.cross(spatial.angular, question.local)
        )
        closing = float(question.along @ point_velocity) + velocity_error + SUM_ROUNDING * speed
        # Convex in t from 0 on, so what is above 0 bounds all times before.
        return float(free_displacement(closing, accel, speed, question.t))

    def _fill_bounds(self) -> None:
        # Not the operating acceleration: where joint motions cancel, one that slows down as hard
        # as it can speeds up the sphere.
        self._speed[:] = sum_levers(self.lever, self._fastest)
        self._accel[:] = sum_accelerations(
            self.lever, self._fastest, self._robot.acceleration_limit
        )
        self._surface_speed[:] = 0.0
        np.maximum.at(
            self._surface_speed, self._leaf_link, sum_levers(self._leaf_lever, self._fastest)
        )


@kernel
def fill_velocity_errors(velocity: FloatArray, errors: VelocityErrors) -> None:
    """Fill the velocity errors of all spheres for the measured joint velocities, (nv,)."""
    for i in range(errors.rate.shape[0]):
        error = errors.at_rest[i]
        for j in range(velocity.shape[0]):
            error += errors.rate[i, j] * abs(velocity[j])
        errors.error[i] = error * (1.0 + SUM_ROUNDING)


@kernel
def exceeds(velocity: FloatArray, limit: FloatArray) -> bool:
    """Whether a joint is faster than its limit."""
    found = False
    for j in range(velocity.shape[0]):
        found = found or not abs(velocity[j]) <= limit[j]
    return found
