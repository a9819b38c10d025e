"""What the arm can still do while it brakes: each joint within what brakes guarantee and allow.

Every joint is free for the reaction time; then it stops as its brakes are stated to, by the entry
for its payload and the greatest speed that it can have by then, and decelerates by at most its
acceleration limit. One single deceleration would be no bound: a joint that stops sooner ends
elsewhere.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pinocchio

from armguard.bounds.displacement import fill_displacements
from armguard.bounds.joint import JointSpaceMotion
from armguard.bounds.joint_table import JointTable, set_columns, set_span
from armguard.bounds.limits import JointLimits, check_state, find_flaw, refuse_flaw
from armguard.bounds.model import check_duration
from armguard.bounds.sums import sum_levers, sum_second_order
from armguard.exceptions import ArmguardError
from armguard.jit.arrays import FloatArray
from armguard.jit.handle import machine_code, pack
from armguard.jit.kernels import kernel
from armguard.jit.numerics import SUM_ROUNDING
from armguard.robot.brakes import find_stop, rest_time
from armguard.robot.operating_limits import LimitsInForce, OperatingLimits
from armguard.robot.robot import Robot
from armguard.robot.stop_time import (
    ALL_COVERED,
    compute_stop_time,
    speed_at_bite,
)

FREE_NODES = 4
"""Steps of the table before braking begins."""
BRAKING_NODES = 28
"""Steps of the table from then until the arm rests."""


class BrakingData(NamedTuple):
    """What compiled code reads and fills when it tabulates a stop."""

    limits: JointLimits
    table: JointTable


class PacedData(NamedTuple):
    """The same for joints that keep to a fraction of their operating velocities."""

    limits: JointLimits
    """Theirs without that."""
    braking: BrakingData
    """With operating velocities that are filled for each table."""
    velocity: FloatArray
    """Room to work in: what velocities count as, [rad/s] or [m/s]. Shape (nv,)."""


class BrakingMotion(JointSpaceMotion):
    """Each joint moves freely for the reaction time and then brakes until it rests.

    Attributes:
        reaction_time: From command to braking torque, in [s].
        handle: On its `BrakingData`, for compiled code.
    """

    interpolates = False

    def __init__(
        self,
        robot: Robot,
        reaction_time: float,
        base_placement: pinocchio.SE3 | None = None,
        *,
        lever: FloatArray | None = None,
        operating: OperatingLimits | LimitsInForce | None = None,
    ) -> None:
        """Compute the levers of all spheres.

        Args:
            robot: The arm.
            reaction_time: From command to braking torque, in [s], >= 0.
            base_placement: Placement of the robot's base in the world; None: they coincide.
            lever: What `compute_sphere_levers` found for this robot; None: it is computed here.
            operating: What joints keep to until they brake; None: the robot's limits.

        Raises:
            ArmguardError: The reaction time is negative or not finite, a limit of the robot is
                missing or unusable, or operating limits do not fit it.
        """
        super().__init__(robot, base_placement, lever=lever, operating=operating)
        self.reaction_time = check_duration("reaction_time", reaction_time)
        self.table = self._make_table(np.zeros(FREE_NODES + BRAKING_NODES + 1))
        # Both are asked in most ticks: to hand over all arrays would take longer than the answer,
        # and so would to find out for each call what it is called with.
        some = np.zeros(len(robot.joints))
        self.handle = pack(BrakingData(self.limits, self.table))
        paced = self.limits._replace(operating_velocity=some.copy())
        braking, room = BrakingData(paced, self.table), some.copy()
        self._paced_handle = pack(PacedData(self.limits, braking, room))
        self._find_first = machine_code(_find_uncovered, self.handle, some, 0.0, 0.0, 0.0)
        self._tabulate = machine_code(_tabulate, self.handle, some, some, 0.0, 0.0)
        self._tabulate_paced = machine_code(
            _tabulate_paced, self._paced_handle, some, some, 0.0, 0.0, 0.0
        )

    def stop_time(self, q: npt.ArrayLike, v: npt.ArrayLike, age: float, horizon: float) -> float:
        """Time within which every joint surely rests, in [s] from now.

        It is inf where a joint may be faster by then than its brakes are stated for.

        Args:
            q: Measured joint positions, in [rad] or [m]. Shape (nv,).
            v: Measured joint velocities, in [rad]/[s] or [m]/[s]. Shape (nv,).
            age: Now minus the stamp of the state, in [s]; a newer stamp counts as 0.
            horizon: Until braking is commanded, in [s] from now.

        Raises:
            ArmguardError: The state is malformed or beyond its limits, or a time is unusable.
        """
        _, velocity = check_state(self._robot, self.limits, q, v)
        if not self.covers(velocity, age, check_duration("horizon", horizon)):
            return np.inf
        return self._stop_time(velocity, age, horizon)

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

        Brakes may bite sooner than they must, at any time since the stamp.

        It proves nothing where `covers` says that a joint may be faster than its brakes are stated
        for: it stops as their last entry says then, so that times stay finite.

        Args:
            q: Measured joint positions, in [rad] or [m]. Shape (nv,), float64.
            v: Measured joint velocities, in [rad]/[s] or [m]/[s]. Shape (nv,), float64.
            age: Now minus the stamp of the state, in [s]; negative where that is newer.
            horizon: Until braking is commanded, in [s] from now.
            pace: Fraction of their operating velocities that no joint exceeds from now on; one
                that is measured to be faster counts as if it were so fast, but for how far it may
                have gone since its stamp.

        Returns:
            The table; always the same one, filled anew.

        Raises:
            ArmguardError: A vector has the wrong length, the state is not finite or beyond its
                limits by more than its errors, or a time is unusable.
        """
        self._check_shapes(q, v, age)
        q, v = np.ascontiguousarray(q), np.ascontiguousarray(v)
        free = check_duration("horizon", horizon) + self.reaction_time
        if not pace < 1.0:
            flaw = self._tabulate(self.handle, q, v, age, free)
            refuse_flaw(self._robot, self.limits, q, v, flaw)
            return self.table
        flaw = self._tabulate_paced(self._paced_handle, q, v, age, free, pace)
        refuse_flaw(self._robot, self.limits, q, v, flaw)
        return self.table

    def stopping_volume(
        self, q: npt.ArrayLike, v: npt.ArrayLike, age: float, horizon: float
    ) -> FloatArray:
        """Balls that contain all spheres of the arm at every time from now until it rests.

        Args:
            q: Measured joint positions, in [rad] or [m]. Shape (nv,).
            v: Measured joint velocities, in [rad]/[s] or [m]/[s]. Shape (nv,).
            age: Now minus the stamp of the state, in [s]; negative where that is newer.
            horizon: Until braking is commanded, in [s] from now.

        Returns:
            Centres and radii in the world, in [m], in the order of the arm's spheres; between
            them they contain every link wherever it can get to. Shape (n, 4).

        Raises:
            ArmguardError: The state is malformed or beyond its limits, a joint may be faster by
                then than its brakes are stated for, or a time is unusable.
        """
        position, velocity = check_state(self._robot, self.limits, q, v)
        self._check_covered(velocity, age, check_duration("horizon", horizon))
        table = self.tabulate(position, velocity, age, horizon)
        set_span(table, 0, len(table.time) - 1, 1.0)
        high, low, size = table.span
        middle, half = 0.5 * (high + low), 0.5 * (high - low)
        jacobian = pinocchio.computeJointJacobians(self._robot.model, self._data, position)
        jacobian = jacobian.reshape(6, -1)  # Pinocchio makes a vector of a single joint's.
        volumes = np.empty((len(self.lever), 4))
        row = 0
        for link in self._robot.links:
            joint = self._data.oMi[self._robot.joint_index(link)]
            for x, y, z, radius in self._robot.cover.tree(link).spheres:
                place = joint.act(np.array([x, y, z]))
                set_columns(place[0], place[1], place[2], jacobian, table)
                moving = np.where(self.lever[row] > 0.0, table.columns, 0.0)
                center = place + moving @ middle
                volumes[row, :3] = self._base.act(center)
                volumes[row, 3] = radius + np.linalg.norm(moving, axis=0) @ half
                row += 1
        bent = sum_second_order(self.lever, size)
        errors = sum_levers(self.lever, self.limits.position_error)
        volumes[:, 3] += bent + self.slope_error @ size + errors
        volumes[:, 3] += SUM_ROUNDING * np.abs(volumes).sum(axis=1)
        return volumes

    def _stop_time(self, velocity: FloatArray, age: float, horizon: float) -> float:
        limits = self.limits
        stop_time: float = compute_stop_time(
            velocity,
            limits.velocity_error,
            limits.operating_velocity,
            limits.acceleration,
            limits.brakes,
            age,
            horizon,
            self.reaction_time,
            limits.operating_acceleration,
        )[0]
        return stop_time

    def covers(self, v: FloatArray, age: float, horizon: float) -> bool:
        """Whether the brakes are stated for every speed that joints can have when they bite.

        Args:
            v: Measured joint velocities, in [rad]/[s] or [m]/[s]. Shape (nv,).
            age: Now minus the stamp of the state, in [s].
            horizon: Until braking is commanded, in [s] from now.
        """
        return self._find_uncovered(v, age, horizon) == ALL_COVERED

    def _find_uncovered(self, v: FloatArray, age: float, horizon: float) -> int:
        velocity = np.ascontiguousarray(v, dtype=np.float64)
        joint: int = self._find_first(self.handle, velocity, age, horizon, self.reaction_time)
        return joint

    def _check_covered(self, v: FloatArray, age: float, horizon: float) -> None:
        joint = self._find_uncovered(v, age, horizon)
        if joint != ALL_COVERED:
            raise ArmguardError(
                f"joint {self._robot.joints[joint]!r}",
                f"moves at {v[joint]:.4g}, and may be faster before it brakes than its brakes are "
                "stated for",
                expected=f"at most {self.limits.brakes.speed[joint, -1]:.4g} by then",
            )

    def _free_time(self) -> float:
        return self.reaction_time

    def _fill(
        self, q: FloatArray, v: FloatArray, age: float, free: float, table: JointTable
    ) -> None:
        # Beyond the range of the brakes nothing is known of a stop: joints may go on for ever.
        super()._fill(q, v, age, free if self.covers(v, age, 0.0) else np.inf, table)


@kernel
def _find_uncovered(
    handle: Any, v: FloatArray, age: float, horizon: float, reaction_time: float
) -> int:
    """What `compute_stop_time` finds not covered, on the handle of a `BrakingData`."""
    limits = handle.content.limits
    _, joint = compute_stop_time(
        v, limits.velocity_error, limits.operating_velocity, limits.acceleration, limits.brakes,
        age, horizon, reaction_time, limits.operating_acceleration,
    )  # fmt: skip
    return joint


@kernel
def _tabulate(handle: Any, q: FloatArray, v: FloatArray, age: float, free: float) -> int:
    """Fill the table of a `BrakingData`; first joint whose state is flawed, else -1."""
    limits, table = handle.content.limits, handle.content.table
    flaw: int = find_flaw(q, v, limits)
    if flaw < 0:
        _spread_nodes(v, age, free, limits, table.time)
        fill_displacements(
            q, v, age, max(age, 0.0) + free, limits,
            table.time, table.high, table.low, table.highest, table.lowest,
        )  # fmt: skip
    return flaw


@kernel
def _tabulate_paced(
    handle: Any, q: FloatArray, v: FloatArray, age: float, free: float, pace: float
) -> int:
    """`_tabulate` on the handle of a `PacedData`, whose operating velocities are filled."""
    limits, table = handle.content.limits, handle.content.braking.table
    paced, velocity = handle.content.braking.limits, handle.content.velocity
    fastest = paced.operating_velocity
    for j in range(v.shape[0]):
        fastest[j] = limits.operating_velocity[j] * pace
        velocity[j] = v[j]  # one that is no number stays so, and is refused
        if abs(v[j]) > fastest[j]:
            velocity[j] = math.copysign(fastest[j], v[j])
    flaw: int = _tabulate(handle.content.braking, q, velocity, age, free)
    if flaw < 0 and age > 0.0:
        # Until now a joint kept to its limits alone: what that adds to where it can be.
        for j in range(v.shape[0]):
            speed = abs(v[j]) + limits.velocity_error[j] + limits.operating_acceleration[j] * age
            speed = min(speed, max(limits.operating_velocity[j], abs(v[j])))
            gone = max(speed - fastest[j], 0.0) * (age * (1.0 + SUM_ROUNDING))
            for k in range(table.time.shape[0]):
                table.high[k, j] += gone
                table.low[k, j] -= gone
    return flaw


@kernel
def _spread_nodes(
    v: FloatArray, age: float, free: float, limits: JointLimits, time: FloatArray
) -> None:
    """Fill the times of a table: up to `free`, and from then until all joints rest."""
    rest = 0.0
    # Between the stamp and the moment when the command is obeyed: what slows down is faster before.
    after, before = max(age, 0.0) + free, -age
    for j in range(v.shape[0]):
        speed = speed_at_bite(
            v[j],
            limits.velocity_error[j],
            limits.operating_velocity[j],
            limits.acceleration[j],
            limits.operating_acceleration[j],
            after,
            before,
        )
        rest = max(rest, rest_time(find_stop(limits.brakes, j, speed), speed))
    braking = time.shape[0] - 1 - FREE_NODES
    for k in range(FREE_NODES):
        time[k] = free * k / FREE_NODES
    for k in range(braking + 1):
        time[FREE_NODES + k] = free + rest * k / braking
