"""Bound on a braking arm: each joint within what its brakes guarantee and its limits allow.

Every joint moves freely for the reaction time. Then it stops as its brakes are stated, by the entry
for the payload and for the greatest speed that it can have by then; it decelerates at most at its
acceleration limit. A single deceleration would not be a bound: a joint that stops sooner ends at
another position.
"""

from __future__ import annotations

import functools
import math
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pinocchio

from armguard.bounds.checks import check_duration
from armguard.bounds.displacement import thrown_velocity
from armguard.bounds.joint import JointSpaceMotion
from armguard.bounds.joint_table import JointTable, fill_table, set_span
from armguard.bounds.limits import JointLimits, check_state, find_flaw, refuse_flaw
from armguard.bounds.sums import sum_levers, sum_second_order
from armguard.exceptions import ArmguardError
from armguard.jit.arrays import FloatArray
from armguard.jit.handle import machine_code, pack
from armguard.jit.kernels import kernel
from armguard.jit.numerics import SUM_ROUNDING
from armguard.robot.brakes import find_stop, rest_time
from armguard.robot.kinematics import Kinematics
from armguard.robot.operating_limits import LimitsInForce, OperatingLimits
from armguard.robot.robot import Robot
from armguard.robot.stop_time import (
    ALL_COVERED,
    compute_stop_time,
)

FREE_NODES = 4
"""Steps of the table before braking begins."""
BRAKING_NODES = 28
"""Steps of the table from then until the arm rests."""


class BrakingData(NamedTuple):
    """Data that compiled code reads and fills when it tabulates a stop."""

    limits: JointLimits
    paced: JointLimits
    """The same for joints below a fraction of their operating velocities; filled for each table."""
    velocity: FloatArray
    """Room to work in: what velocities count as, [rad/s] or [m/s]. Shape (nv,)."""
    table: JointTable


class BrakingMotion(JointSpaceMotion):
    """Each joint moves freely for the reaction time, and then brakes until it is at rest.

    Attributes:
        reaction_time: From command to braking torque, in [s].
        handle: On its `BrakingData`, for compiled code.
    """

    interpolates = False
    times = np.zeros(FREE_NODES + BRAKING_NODES + 1)

    def __init__(
        self,
        robot: Robot,
        reaction_time: float,
        base_placement: pinocchio.SE3 | None = None,
        *,
        operating: OperatingLimits | LimitsInForce | None = None,
        with_velocities: bool = False,
    ) -> None:
        """Compute the levers of all spheres.

        Args:
            robot: The arm.
            reaction_time: From command to braking torque, in [s], >= 0.
            base_placement: Placement of the robot's base in the world; None: they coincide.
            operating: Operating limits until the joints brake; None: the robot's limits.
            with_velocities: Whether the table is to have velocities as well.

        Raises:
            ArmguardError: The reaction time is negative or not finite, a limit of the robot is
                missing or unusable, or operating limits do not fit it.
        """
        super().__init__(
            robot, base_placement, operating=operating, with_velocities=with_velocities
        )
        self.reaction_time = self.free_time = check_duration("reaction_time", reaction_time)
        # Both are asked in most ticks: to hand over all arrays would take longer than the answer,
        # and so would to find out for each call what it is called with.
        some, paced = np.zeros(len(robot.joints)), np.zeros(len(robot.joints))
        data = BrakingData(
            self.limits, self.limits._replace(operating_velocity=paced), some.copy(), self.table
        )
        self.handle = pack(data)
        self._find_first = machine_code(_find_uncovered, self.handle, some, some, 0.0, 0.0, 0.0)
        self._tabulate = machine_code(_tabulate, self.handle, some, some, 0.0, 0.0, 0.0)

    def stop_time(self, q: npt.ArrayLike, v: npt.ArrayLike, age: float, horizon: float) -> float:
        """Stop time: by then every joint is at rest, in [s] from now.

        It is inf if a joint may be faster than its brakes are stated for when they engage.

        Args:
            q: Measured joint positions, in [rad] or [m]. Shape (nv,).
            v: Measured joint velocities, in [rad]/[s] or [m]/[s]. Shape (nv,).
            age: Now minus the stamp of the state, in [s]; a newer stamp counts as 0.
            horizon: Time at which braking is commanded, in [s] from now.

        Raises:
            ArmguardError: The state is malformed or beyond its limits, or a time is unusable.
        """
        position, velocity = check_state(self._robot, self.limits, q, v)
        if not self.covers(position, velocity, age, check_duration("horizon", horizon)):
            return np.inf
        return float(self.tabulate(position, velocity, age, horizon).time[-1])

    def tabulate(
        self,
        q: FloatArray,
        v: FloatArray,
        age: float,
        horizon: float,
        *,
        pace: float = 1.0,
    ) -> JointTable:
        """Fill the table of one tick; its last node is the stop time.

        Brakes can engage at any time from the stamp on, up to the latest time.

        If `covers` is false, because a joint may be faster than its brakes are stated for, the
        table proves nothing. The last entry of the brakes is used then, so that times stay finite.

        Args:
            q: Measured joint positions, in [rad] or [m]. Shape (nv,), float64.
            v: Measured joint velocities, in [rad]/[s] or [m]/[s]. Shape (nv,), float64.
            age: Now minus the stamp of the state, in [s]; negative where that is newer.
            horizon: Time at which braking is commanded, in [s] from now.
            pace: Fraction of their operating velocities that no joint exceeds from now on. A joint
                that is measured to be faster counts with this fraction, except for its possible
                displacement since its stamp.

        Returns:
            The table; always the same object, filled again.

        Raises:
            ArmguardError: A vector has the wrong length, the state is not finite or beyond its
                limits by more than its errors, or a time is unusable.
        """
        self._check_shapes(q, v, age)
        q, v = np.ascontiguousarray(q), np.ascontiguousarray(v)
        free = check_duration("horizon", horizon) + self.reaction_time
        flaw = self._tabulate(self.handle, q, v, age, free, pace if pace < 1.0 else 1.0)
        refuse_flaw(self._robot, self.limits, q, v, flaw)
        return self.table

    def stopping_volume(
        self, q: npt.ArrayLike, v: npt.ArrayLike, age: float, horizon: float
    ) -> FloatArray:
        """Balls that contain all spheres of the arm at every time from now until it is at rest.

        Args:
            q: Measured joint positions, in [rad] or [m]. Shape (nv,).
            v: Measured joint velocities, in [rad]/[s] or [m]/[s]. Shape (nv,).
            age: Now minus the stamp of the state, in [s]; negative where that is newer.
            horizon: Time at which braking is commanded, in [s] from now.

        Returns:
            Centres and radii in the world, in [m], in the order of the arm's spheres. Together they
            contain every link at all these times. Shape (n, 4).

        Raises:
            ArmguardError: The state is malformed or beyond its limits, a joint may be faster by
                then than its brakes are stated for, or a time is unusable.
        """
        position, velocity = check_state(self._robot, self.limits, q, v)
        joint = self.find_uncovered(position, velocity, age, check_duration("horizon", horizon))
        if joint != ALL_COVERED:
            raise ArmguardError(
                f"joint {self._robot.joints[joint]!r}",
                f"moves at {velocity[joint]:.4g}, and may be faster before it brakes than its "
                "brakes are stated for",
                expected=f"at most {self.limits.brakes.speed[joint, -1]:.4g} by then",
            )
        table = self.tabulate(position, velocity, age, horizon)
        set_span(table, 0, len(table.time) - 1, 1.0)
        high, low, size = table.box.span
        arm = self._kinematics
        arm.compute(position, velocity)
        linear, angular = arm.data.J.reshape(2, 3, -1)
        columns = linear.T + np.cross(angular.T, arm.centers[:, None])
        moving = np.where(self.lever[:, :, None] > 0.0, columns, 0.0)
        centers = arm.centers + np.einsum("nji,j->ni", moving, 0.5 * (high + low))
        reach = np.linalg.norm(moving, axis=2) @ (0.5 * (high - low))
        reach += sum_second_order(self.lever, size) + self.slope_error @ size
        reach += arm.spheres.radius + sum_levers(self.lever, self.limits.position_error)
        volumes = np.column_stack([centers, reach])
        volumes[:, 3] += SUM_ROUNDING * np.abs(volumes).sum(axis=1)
        return volumes

    @functools.cached_property
    def _kinematics(self) -> Kinematics:
        return Kinematics(self._robot, self._base)

    def covers(self, q: FloatArray, v: FloatArray, age: float, horizon: float) -> bool:
        """Whether the brakes are stated for every speed that joints can have when they engage.

        A joint that rebounds from its mechanical stop counts with its possible speed after the
        rebound.

        Args:
            q: Measured joint positions, in [rad] or [m]. Shape (nv,).
            v: Measured joint velocities, in [rad]/[s] or [m]/[s]. Shape (nv,).
            age: Now minus the stamp of the state, in [s].
            horizon: Time at which braking is commanded, in [s] from now.
        """
        return self.find_uncovered(q, v, age, horizon) == ALL_COVERED

    def find_uncovered(self, q: FloatArray, v: FloatArray, age: float, horizon: float) -> int:
        """The first joint for which `covers` is false; `ALL_COVERED` if there is none."""
        state = (np.ascontiguousarray(one, dtype=np.float64) for one in (q, v))
        joint: int = self._find_first(self.handle, *state, age, horizon, self.reaction_time)
        return joint

    def _fill(
        self, q: FloatArray, v: FloatArray, age: float, free: float, table: JointTable
    ) -> None:
        # Beyond the range of the brakes nothing is known of a stop: joints may go on for ever.
        super()._fill(q, v, age, free if self.covers(q, v, age, 0.0) else np.inf, table)


@kernel
def _find_uncovered(
    handle: Any, q: FloatArray, v: FloatArray, age: float, horizon: float, reaction_time: float
) -> int:
    """The first joint that may be too fast for its stated brakes when they engage.

    Takes the handle of a `BrakingData`. Returns `ALL_COVERED` if no joint may be too fast.
    """
    limits = handle.content.limits
    _, joint = compute_stop_time(
        v, limits.velocity_error, limits.operating_velocity, limits.acceleration, limits.brakes,
        age, horizon, reaction_time, limits.operating_acceleration,
    )  # fmt: skip
    if joint != ALL_COVERED:
        return int(joint)
    last = limits.brakes.speed.shape[1] - 1
    for j in range(v.shape[0]):
        thrown = thrown_velocity(q[j], v[j], limits, j, max(age, 0.0) + horizon + reaction_time)
        if not thrown <= limits.brakes.speed[j, last]:
            return j
    return ALL_COVERED


@kernel
def _tabulate(
    handle: Any, q: FloatArray, v: FloatArray, age: float, free: float, pace: float
) -> int:
    """Fill the table of a `BrakingData`; returns the first joint with a flawed state, else -1.

    With `pace` below 1, joints keep below this fraction of their operating velocities from now on.
    """
    data = handle.content
    limits, paced, table, velocity = data.limits, data.paced, data.table, data.velocity
    fastest = paced.operating_velocity
    for j in range(v.shape[0]):
        fastest[j] = limits.operating_velocity[j] * pace
        velocity[j] = v[j]  # one that is no number stays so, and is refused
        if pace < 1.0 and abs(v[j]) > fastest[j]:
            velocity[j] = math.copysign(fastest[j], v[j])
    flaw: int = find_flaw(q, velocity, limits)
    if flaw >= 0:
        return flaw
    _spread_nodes(q, velocity, age, free, paced, table.time)
    fill_table(q, velocity, age, max(age, 0.0) + free, paced, table)
    if pace < 1.0 and age > 0.0:
        # Until now a joint kept to its limits alone: what that adds to where it can be.
        for j in range(v.shape[0]):
            speed = abs(v[j]) + limits.velocity_error[j] + limits.operating_acceleration[j] * age
            speed = min(speed, max(limits.operating_velocity[j], abs(v[j])))
            gone = max(speed - fastest[j], 0.0) * (age * (1.0 + SUM_ROUNDING))
            for k in range(table.time.shape[0]):
                table.high[k, j] += gone
                table.low[k, j] -= gone
    return -1


@kernel
def _spread_nodes(
    q: FloatArray,
    v: FloatArray,
    age: float,
    free: float,
    limits: JointLimits,
    time: FloatArray,
) -> None:
    """Fill the times of a table: up to `free`, and from then until all joints rest.

    A joint that rebounds from its mechanical stop before brakes engage may be faster than operating
    limits allow, and be at rest later.
    """
    rest = (
        compute_stop_time(
            v, limits.velocity_error, limits.operating_velocity, limits.acceleration,
            limits.brakes, age, free, 0.0, limits.operating_acceleration,
        )[0] - free
    )  # fmt: skip
    for j in range(v.shape[0]):
        thrown = thrown_velocity(q[j], v[j], limits, j, max(age, 0.0) + free)
        rest = max(rest, rest_time(find_stop(limits.brakes, j, thrown), thrown))
    braking = time.shape[0] - 1 - FREE_NODES
    for k in range(FREE_NODES):
        time[k] = free * k / FREE_NODES
    for k in range(braking + 1):
        time[FREE_NODES + k] = free + rest * k / braking
