"""The limits of all joints for compiled code; each limit must be usable."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from armguard.bounds.checks import check_vector
from armguard.exceptions import ArmguardError, RobotError
from armguard.jit.arrays import FloatArray
from armguard.jit.kernels import kernel
from armguard.jit.numerics import LIMIT_SLACK
from armguard.robot.brakes import BrakeCurves
from armguard.robot.joints import is_prismatic
from armguard.robot.operating_limits import LimitsInForce
from armguard.robot.robot import Robot


class JointLimits(NamedTuple):
    """Limits and errors of all joints, in [rad] or [m] and [s]. Arrays have the shape (nv,)."""

    lower: FloatArray
    """Lower position limits; -inf for a continuous joint."""
    upper: FloatArray
    """Upper position limits; inf for a continuous joint."""
    velocity: FloatArray
    acceleration: FloatArray
    brakes: BrakeCurves
    """How joints stop, by speed, under the payload in force; each of shape (nv, steps)."""
    position_error: FloatArray
    velocity_error: FloatArray
    operating_velocity: FloatArray
    """Operating velocities in force; `velocity` if no operating limits are in force."""
    operating_acceleration: FloatArray
    """Operating accelerations in force; `acceleration` if no operating limits are in force."""


def read_limits(robot: Robot, in_force: LimitsInForce | None = None) -> JointLimits:
    """The robot's limits.

    Args:
        robot: The arm.
        in_force: The limits and brakes in force, shared, so they may change; None: the robot's
            limits, and its brakes under the heaviest payload.

    Raises:
        RobotError: One of them is missing, zero, negative or not finite.
    """
    arrays = {
        "lower": robot.lower_position_limit,
        "upper": robot.upper_position_limit,
        "velocity": robot.velocity_limit,
        "acceleration": robot.acceleration_limit,
        "position_error": robot.position_error,
        "velocity_error": robot.velocity_error,
    }
    count = len(robot.joints)
    for key, values in arrays.items():
        if np.shape(values) != (count,):
            raise RobotError(
                f"{robot.name}: {key} limits",
                f"have the shape {np.shape(values)}",
                expected=f"({count},), one for each joint",
            )
    own = {key: np.array(values, float) for key, values in arrays.items()}
    limits = JointLimits(
        **own,
        brakes=robot.brakes.make_curves() if in_force is None else in_force.brakes,
        operating_velocity=own["velocity"].copy() if in_force is None else in_force.velocity,
        operating_acceleration=(
            own["acceleration"].copy() if in_force is None else in_force.acceleration
        ),
    )
    for j, joint in enumerate(robot.joints):
        where = f"joint {joint!r}"
        for key in ("velocity", "acceleration", "position_error", "velocity_error"):
            value = getattr(limits, key)[j]
            if key.endswith("error"):
                if not 0.0 <= value < np.inf:
                    raise RobotError(where, f"{key} = {value}", expected="non-negative and finite")
            elif not 0.0 < value < np.inf:
                raise RobotError(where, f"{key} limit = {value}", expected="positive and finite")
        lower, upper = limits.lower[j], limits.upper[j]
        slides = is_prismatic(robot.model, robot.model.getJointId(joint))
        if not (lower < upper and (not slides or -np.inf < lower < upper < np.inf)):
            raise RobotError(
                where,
                f"position limits = [{lower}, {upper}]",
                expected="lower < upper, and both finite where it slides",
            )
        _check_brakes(where, limits.brakes, j, limits.acceleration[j])
    return limits


def _check_brakes(where: str, brakes: BrakeCurves, joint: int, acceleration: float) -> None:
    """Refuse brakes that do not stop a joint, or harder than the acceleration limit allows."""
    for speed, deceleration, time, distance in zip(*(one[joint] for one in brakes), strict=True):
        if not deceleration <= acceleration:
            raise RobotError(
                where,
                f"braking = {deceleration} exceeds acceleration = {acceleration}",
                remedy="the acceleration limit holds while braking as well",
            )
        stops = deceleration > 0.0 or (0.0 < time < np.inf and 0.0 < distance < np.inf)
        if not (speed > 0.0 and deceleration >= 0.0 and stops):
            raise RobotError(
                where,
                f"braking = {deceleration} up to a speed of {speed}",
                expected="a deceleration above 0, or a stopping time and distance",
            )


def check_state(
    robot: Robot, limits: JointLimits, q: npt.ArrayLike, v: npt.ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """A measured joint state as float64.

    Raises:
        ArmguardError: A vector has the wrong length or is not finite, or a joint is beyond its
            limits by more than its errors; the message names it.
    """
    position = check_vector("joint positions", q, len(limits.lower))
    velocity = check_vector("joint velocities", v, len(limits.lower))
    refuse_beyond(robot, limits, position, velocity)
    return position, velocity


def refuse_beyond(robot: Robot, limits: JointLimits, q: FloatArray, v: FloatArray) -> None:
    """Raise where `find_flaw` finds a joint beyond its limits."""
    refuse_flaw(robot, limits, q, v, find_flaw(q, v, limits))


@kernel
def find_flaw(q: FloatArray, v: FloatArray, limits: JointLimits) -> int:
    """First joint whose state breaks its limits or is not finite, or -1."""
    for j in range(q.shape[0]):
        room = limits.position_error[j] + LIMIT_SLACK
        allowed = limits.velocity[j] + limits.velocity_error[j] + LIMIT_SLACK
        if not (
            limits.lower[j] - room <= q[j] <= limits.upper[j] + room
            and abs(q[j]) < np.inf
            and abs(v[j]) <= allowed
        ):
            return j
    return -1


def refuse_flaw(robot: Robot, limits: JointLimits, q: FloatArray, v: FloatArray, flaw: int) -> None:
    """Raise what `find_flaw` found, if anything."""
    if flaw < 0:
        return
    ranges = f"{limits.lower[flaw]} to {limits.upper[flaw]}"
    raise ArmguardError(
        f"joint {robot.joints[flaw]!r}",
        f"is at {q[flaw]} with velocity {v[flaw]}, beyond its limits by more than its errors",
        expected=f"position {ranges}, velocity up to {limits.velocity[flaw]}",
    )
