"""How far the arm can get by a given time: motion models, and the levers that they rest on.

A lever R_j is the greatest distance that a point of the arm can have from the axis of joint j,
whatever the configuration. With it, limits on joints become limits on points: with joint
velocities and accelerations within their limits, a point's speed is at most sum_j R_j qd_j, and
its acceleration at most sum_j R_j qdd_j + sum_ij R_max(i, j) qd_i qd_j, because each second
derivative of its position with respect to joints i and j is no longer than the lever of the more
distal of the two. The levers are proved, not sampled: see `armguard.levers`.
"""

from __future__ import annotations

from typing import Protocol

import numba
import numpy as np
import numpy.typing as npt
import pinocchio

from armguard.exceptions import ArmguardError
from armguard.levers import bound_levers, is_prismatic, moving_joints
from armguard.robot import Robot

Floats = npt.NDArray[np.float64]

ROUNDING = 1e-12
"""Relative widening of every bound: thousands of times the rounding error of the sums within."""


class MotionModel(Protocol):
    """What a bound on the arm's motion answers."""

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

        Args:
            q: Measured joint positions, in [rad] or [m]. Shape (nv,).
            v: Measured joint velocities, in [rad]/[s] or [m]/[s]. Shape (nv,).
            link: Name of the link that carries the point.
            point: In the frame of the link's parent joint, in [m]. Shape (3,).
            direction: Unit vector in the world. Shape (3,).
            t: Time from the state's stamp, in [s], >= 0.

        Returns:
            Never negative, and never falling as t grows.
        """
        ...


class IsotropicMotion:
    """The plainest motion model: one acceleration and one speed bound for each sphere.

    It ignores the configuration, so its bounds are constants; all that a tick computes is how
    much the joint errors are worth at the present joint speeds. The arrays are read-only views
    that keep their place in memory, in the order of the arm's spheres (the trees of
    `robot.links`, one after the other).

    Attributes:
        lever: Proved levers R_j, in [m], or 1 for a prismatic joint. Shape (n, nv).
        accel: Bound on each centre's acceleration, in [m]/[s²]. Shape (n,).
        speed: Bound on each centre's speed, in [m]/[s]. Shape (n,).
        position_error: What a centre's position may be off by, in [m]. Shape (n,).
        velocity_error: What its velocity may be off by, in [m]/[s], at the joint velocity of the
            last `update`; infinite before the first. Shape (n,).
        surface_speed: Bound on the speed of any point of each link, in [m]/[s]. Shape (L,).
        surface_position_error: What any point of each link may be off by, in [m]. Shape (L,).
    """

    def __init__(self, robot: Robot, base_placement: pinocchio.SE3 | None = None) -> None:
        """Compute the levers and what follows from them; about a second for 1,000 spheres.

        Args:
            robot: The arm, with its limits and errors.
            base_placement: Placement of the robot's base in the world; None: they coincide.
        """
        self._robot = robot
        self._data = robot.model.createData()
        self._world_rotation: Floats = (
            np.eye(3) if base_placement is None else np.array(base_placement.rotation)
        )
        trees = [robot.cover.tree(link) for link in robot.links]
        self.lever = _read_only(
            np.concatenate(
                [
                    compute_levers(robot, link, tree.spheres[:, :3])
                    for link, tree in zip(robot.links, trees, strict=True)
                ]
            )
        )
        # Every point of a link is in one of the leaves, so these bound the whole of it.
        leaf = np.concatenate([tree.child_count for tree in trees]) == 0
        link_of = np.repeat(np.arange(len(trees)), [len(tree.spheres) for tree in trees])
        radius = np.concatenate([tree.spheres[:, 3] for tree in trees])
        turns = np.array([_turning_joints(robot, link) for link in robot.links])
        self._leaf_link = link_of[leaf]
        self._leaf_lever = self.lever[leaf] + radius[leaf, None] * turns[self._leaf_link]

        count = len(radius)
        self._speed = np.empty(count)
        self._accel = np.empty(count)
        self._velocity_error = np.full(count, np.inf)
        self._surface_speed = np.empty(len(trees))
        self.speed = _read_only(self._speed)
        self.accel = _read_only(self._accel)
        self.velocity_error = _read_only(self._velocity_error)
        self.surface_speed = _read_only(self._surface_speed)
        self.position_error = _read_only(_sum_levers(self.lever, robot.position_error))
        surface_error = np.zeros(len(trees))
        leaf_error = _sum_levers(self._leaf_lever, robot.position_error)
        np.maximum.at(surface_error, self._leaf_link, leaf_error)
        self.surface_position_error = _read_only(surface_error)
        self._error_rate, self._error_floor = _velocity_error_terms(
            self.lever, robot.position_error, robot.velocity_error
        )
        self._fastest = np.array(robot.velocity_limit, dtype=np.float64)
        self._widened = False
        self._fill_bounds()

    def update(self, v: npt.ArrayLike) -> None:
        """Fill `velocity_error` for the measured joint velocity, and widen the bounds if need be.

        A joint that is measured faster than its limit counts with what was measured: it may be
        so within its error, and beyond that a monitor stops anyway.

        Args:
            v: Measured joint velocities, in [rad]/[s] or [m]/[s]. Shape (nv,).

        Raises:
            ArmguardError: The vector has the wrong length or is not finite.
        """
        velocity = _joint_vector("joint velocities", v, len(self._fastest))
        limit = self._robot.velocity_limit
        widens = _fill_velocity_error(
            velocity, limit, self._error_rate, self._error_floor, self._velocity_error
        )
        if widens or self._widened:
            np.maximum(np.abs(velocity), limit, out=self._fastest)
            self._widened = widens
            self._fill_bounds()

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

        The displacement is counted from where the point truly is at the state's stamp. What that
        place may be off by, `position_error`, belongs to the contact distance instead; the
        velocity error is included. Arguments as in `MotionModel.advance`.

        Raises:
            ArmguardError: An unknown link, a wrong shape, a value that is not finite, a negative
                time, or a direction that is no unit vector.
        """
        robot = self._robot
        joint_count = len(robot.velocity_limit)
        position = _joint_vector("joint positions", q, joint_count)
        velocity = _joint_vector("joint velocities", v, joint_count)
        local = _joint_vector("point", point, 3)
        along = _joint_vector("direction", direction, 3)
        if not abs(np.linalg.norm(along) - 1.0) <= 1e-9:
            raise ArmguardError("direction", f"has length {np.linalg.norm(along)}", expected="1")
        if not 0.0 <= t < np.inf:
            raise ArmguardError("t", f"is {t} s", expected="finite and not negative")

        lever = compute_levers(robot, link, local[None])
        fastest = np.maximum(robot.velocity_limit, np.abs(velocity))
        speed = float(_sum_levers(lever, fastest)[0])
        accel = float(_sum_accelerations(lever, fastest, robot.acceleration_limit)[0])
        rate, floor = _velocity_error_terms(lever, robot.position_error, robot.velocity_error)
        velocity_error = float((rate @ np.abs(velocity) + floor)[0])

        pinocchio.forwardKinematics(robot.model, self._data, position, velocity)
        joint = robot.joint_index(link)
        spatial = self._data.v[joint]
        point_velocity = self._world_rotation @ (
            self._data.oMi[joint].rotation @ (spatial.linear + np.cross(spatial.angular, local))
        )
        closing = float(along @ point_velocity) + velocity_error + ROUNDING * speed
        return max(0.0, free_advance(min(speed, closing), accel, speed, float(t)))

    def _fill_bounds(self) -> None:
        self._speed[:] = _sum_levers(self.lever, self._fastest)
        self._accel[:] = _sum_accelerations(
            self.lever, self._fastest, self._robot.acceleration_limit
        )
        self._surface_speed[:] = 0.0
        np.maximum.at(
            self._surface_speed, self._leaf_link, _sum_levers(self._leaf_lever, self._fastest)
        )


def free_advance(closing: float, accel: float, speed: float, t: float) -> float:
    """Displacement by time t of a body that closes in as hard as its bounds allow, in [m].

    It may be negative: a body that moves away must first turn round. As a function of t it is
    convex and starts at 0, so the larger of it and 0 bounds all times up to t.

    Args:
        closing: Velocity along the direction, error included, in [m]/[s], <= speed.
        accel: Acceleration bound, in [m]/[s²]; may be infinite.
        speed: Speed bound, in [m]/[s]; may be infinite.
        t: Time, in [s], >= 0.
    """
    if t == 0.0:
        return 0.0
    if not (closing < speed and accel < np.inf):
        distance = speed * t
    elif accel == 0.0:
        distance = closing * t
    else:
        ramp = (speed - closing) / accel
        if t <= ramp:
            distance = closing * t + 0.5 * accel * t * t
        else:
            distance = 0.5 * (closing + speed) * ramp + speed * (t - ramp)
    return distance + ROUNDING * abs(distance)


def compute_levers(robot: Robot, link: str, points: npt.ArrayLike) -> Floats:
    """Proved bounds on how far points of a link can be from the axis line of each joint.

    They hold in every configuration; `armguard.levers` has the proof. Angle limits are not used,
    travel limits of prismatic joints are, widened by twice the position error: once for the
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
    slack = 2.0 * robot.position_error
    travel = np.column_stack(
        [robot.lower_position_limit - slack, robot.upper_position_limit + slack]
    )
    return bound_levers(robot.model, robot.joint_index(link), places, travel)


def _turning_joints(robot: Robot, link: str) -> npt.NDArray[np.bool_]:
    """The revolute joints that move a link. Shape (nv,)."""
    turning = np.zeros(robot.model.nv, dtype=np.bool_)
    for joint in moving_joints(robot.model, robot.joint_index(link)):
        turning[robot.model.idx_vs[joint]] = not is_prismatic(robot.model, joint)
    return turning


def _sum_levers(lever: Floats, rates: Floats) -> Floats:
    """Bound sum_j R_j x_j: of joint velocities, a point's speed; of angles, its way. Shape (n,)."""
    return (lever @ rates) * (1.0 + ROUNDING)


def _sum_accelerations(lever: Floats, fastest: Floats, acceleration_limit: Floats) -> Floats:
    """Bound on the acceleration of points, in [m]/[s²]. Shape (n,).

    sum_j R_j qdd_j + sum_ij R_max(i, j) qd_i qd_j over ordered pairs. Joints come in the order
    base to tip, so joint j meets each joint before it twice and itself once.
    """
    moving = np.where(lever > 0.0, fastest, 0.0)
    before = np.cumsum(moving, axis=1) - moving
    bound: Floats = np.sum(lever * (acceleration_limit + moving * (moving + 2.0 * before)), axis=1)
    return bound * (1.0 + ROUNDING)


def _velocity_error_terms(
    lever: Floats, position_error: Floats, velocity_error: Floats
) -> tuple[Floats, Floats]:
    """Rate (n, nv) and floor (n,) of a point's velocity error, which is rate |qd| + floor.

    The error is sum_j R_j dqd_j + sum_ij R_max(i, j) (|qd_i| + dqd_i) dq_j: the joint rates are
    wrong, and so is the Jacobian that they are taken with.
    """
    moved = lever > 0.0
    errors = np.where(moved, position_error, 0.0)
    weighted = lever * errors
    up_to = np.cumsum(errors, axis=1)
    beyond = weighted.sum(axis=1, keepdims=True) - np.cumsum(weighted, axis=1)
    rate = np.where(moved, lever * up_to + np.maximum(beyond, 0.0), 0.0) * (1.0 + ROUNDING)
    floor = (lever @ velocity_error + rate @ velocity_error) * (1.0 + ROUNDING)
    return rate, floor


@numba.njit(error_model="numpy", cache=True)
def _fill_velocity_error(
    velocity: Floats, limit: Floats, rate: Floats, floor: Floats, errors: Floats
) -> bool:
    """Fill the velocity errors of all spheres; whether a joint is faster than its limit."""
    exceeds = False
    for j in range(velocity.shape[0]):
        exceeds = exceeds or abs(velocity[j]) > limit[j]
    for i in range(rate.shape[0]):
        error = floor[i]
        for j in range(velocity.shape[0]):
            error += rate[i, j] * abs(velocity[j])
        errors[i] = error * (1.0 + ROUNDING)
    return exceeds


def _joint_vector(name: str, values: npt.ArrayLike, length: int) -> Floats:
    """The values as float64, refused unless finite and of the right length."""
    try:
        vector = np.ascontiguousarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ArmguardError(name, f"are no numbers: {error}") from error
    if not (np.shape(values) == (length,) and np.isfinite(vector).all()):
        raise ArmguardError(
            name,
            f"have shape {np.shape(values)} or are not finite",
            expected=f"{length} finite numbers",
        )
    return vector


def _read_only(array: Floats) -> Floats:
    """A view of the same memory that cannot be written through."""
    view = array.view()
    view.flags.writeable = False
    return view
