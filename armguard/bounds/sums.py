"""Converts limits of joints to bounds on points of the arm, by sums with levers.

A lever R_j is the reach of a point of the arm about joint j: the greatest distance that it can have
from the joint's axis, whatever the configuration (the lambda of Drake's motion bounds). It turns
the joint's angle into the greatest displacement of the point, and the joint's rate into its
greatest speed. `armguard.bounds.levers` proves it. With R_max(i, j) the reach about the more distal
of two joints, no second derivative of the point's position with respect to joints i and
j is longer than that, and so sums over joints bound what the point does.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from armguard.bounds.checks import read_only
from armguard.bounds.levers import bound_levers, moving_joints
from armguard.exceptions import ArmguardError
from armguard.jit.arrays import FloatArray
from armguard.jit.numerics import SUM_ROUNDING
from armguard.robot.joints import is_prismatic
from armguard.robot.robot import Robot


def compute_levers(robot: Robot, link: str, points: npt.ArrayLike) -> FloatArray:
    """Proved bounds on how far points of a link can be from the axis line of each joint.

    They hold in every configuration; `armguard.bounds.levers` has the proof. Angle limits are not
    used, travel limits of prismatic joints are, widened by twice the position error: once for the
    measurement, once for what a monitor accepts beyond a limit.

    Args:
        robot: The arm.
        link: One of `robot.links`.
        points: In the frame of the link's parent joint, in [m]. Shape (n, 3).

    Returns:
        R_j in [m] for a revolute joint; 1 for a prismatic one, and 0 for a joint that does not
        move the link. Shape (n, nv).

    Raises:
        ArmguardError: An unknown link, points of another shape or not finite, a joint that is
            neither revolute nor prismatic, or a prismatic one without finite travel.
    """
    places = np.ascontiguousarray(points, dtype=np.float64)
    if not (places.ndim == 2 and places.shape[1] == 3 and np.isfinite(places).all()):
        raise ArmguardError(
            f"points on {link}",
            f"have shape {places.shape} or are not finite",
            expected="finite numbers, shape (n, 3)",
        )
    return bound_levers(robot.model, robot.joint_index(link), places, widened_ranges(robot))


def compute_sphere_levers(robot: Robot) -> FloatArray:
    """Levers of all sphere centres of the arm, in the order of `robot.links`; read-only.

    They take about a second for 1,000 spheres, and next to nothing when they are asked for again.

    Returns:
        R_j of each sphere's centre, as `compute_levers` has it. Shape (n, nv).
    """
    return read_only(
        np.concatenate(
            [
                compute_levers(robot, link, robot.cover.tree(link).spheres[:, :3])
                for link in robot.links
            ]
        )
    )


def widened_ranges(robot: Robot) -> FloatArray:
    """Joint ranges widened by twice the position error. Shape (nv, 2)."""
    slack = 2.0 * robot.position_error
    return np.column_stack([robot.lower_position_limit - slack, robot.upper_position_limit + slack])


def turning_joints(robot: Robot, link: str) -> npt.NDArray[np.bool_]:
    """The revolute joints that move a link. Shape (nv,)."""
    turning = np.zeros(robot.model.nv, dtype=np.bool_)
    for joint in moving_joints(robot.model, robot.joint_index(link)):
        turning[robot.model.idx_vs[joint]] = not is_prismatic(robot.model, joint)
    return turning


def sum_levers(lever: FloatArray, rates: FloatArray) -> FloatArray:
    """Bound sum_j R_j x_j: the speed, or the displacement, of a point. Shape (n,).

    The rates, (nv,), are velocities or angles of the joints, greatest magnitudes of either.
    """
    return (lever @ rates) * (1.0 + SUM_ROUNDING)


def sum_accelerations(
    lever: FloatArray, fastest: FloatArray, acceleration_limit: FloatArray
) -> FloatArray:
    """Bound on the acceleration of points, in [m]/[s²]. Shape (n,).

    sum_j R_j qdd_j + sum_ij R_max(i, j) qd_i qd_j over ordered pairs. Joints come in the order
    base to tip, so joint j meets each joint before it twice and itself once.
    """
    moving = np.where(lever > 0.0, fastest, 0.0)
    before = np.cumsum(moving, axis=1) - moving
    bound: FloatArray = np.sum(
        lever * (acceleration_limit + moving * (moving + 2.0 * before)), axis=1
    )
    return bound * (1.0 + SUM_ROUNDING)


def sum_second_order(lever: FloatArray, displacements: FloatArray) -> FloatArray:
    """Bound sum_ij R_max(i, j) |D_i| |D_j| / 2 on a path's departure from its tangent. Shape (n,).

    The displacements, (nv,), are absolute.
    """
    moving = np.where(lever > 0.0, displacements, 0.0)
    before = np.cumsum(moving, axis=1) - moving
    bound: FloatArray = np.sum(lever * moving * (0.5 * moving + before), axis=1)
    return bound * (1.0 + SUM_ROUNDING)


def velocity_error_terms(
    lever: FloatArray, position_error: FloatArray, velocity_error: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Rate (n, nv) and at_rest (n,) of a point's velocity error, which is rate |qd| + at_rest.

    The error is sum_j R_j dqd_j + sum_ij R_max(i, j) (|qd_i| + dqd_i) dq_j: the joint rates are
    wrong, and so is the Jacobian that they are taken with.
    """
    moved = lever > 0.0
    errors = np.where(moved, position_error, 0.0)
    weighted = lever * errors
    up_to = np.cumsum(errors, axis=1)
    beyond = weighted.sum(axis=1, keepdims=True) - np.cumsum(weighted, axis=1)
    rate = np.where(moved, lever * up_to + np.maximum(beyond, 0.0), 0.0) * (1.0 + SUM_ROUNDING)
    at_rest = (lever @ velocity_error + rate @ velocity_error) * (1.0 + SUM_ROUNDING)
    return rate, at_rest
