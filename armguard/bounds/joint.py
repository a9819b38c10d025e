"""Common parts of the motion models that bound every joint by itself."""

from __future__ import annotations

import numpy as np
import pinocchio

from armguard.bounds.checks import read_only
from armguard.bounds.joint_box import displacement_in_box, set_columns
from armguard.bounds.joint_table import JointTable, fill_table, make_table, set_span
from armguard.bounds.limits import read_limits, refuse_beyond
from armguard.bounds.model import MotionModel, Question
from armguard.bounds.sums import (
    compute_sphere_levers,
    sum_levers,
    velocity_error_terms,
)
from armguard.exceptions import ArmguardError
from armguard.jit.arrays import FloatArray
from armguard.jit.kernels import kernel
from armguard.robot.joints import is_prismatic
from armguard.robot.operating_limits import LimitsInForce, OperatingLimits, put_in_force
from armguard.robot.robot import Robot

GRID_STEP = 1e-3
MOST_NODES = 300
"""Of the grid of a single question; a minute and a half from now any joint is anywhere."""


class JointSpaceMotion(MotionModel):
    """A motion model that bounds displacements of all joints, and from them those of points.

    Attributes:
        limits: The robot's limits and errors.
        lever: Proved levers R_j of all spheres, in [m], or 1 for a prismatic joint. Shape (n, nv).
        slope_error: Greatest error of each column of a sphere's Jacobian because of the position
            errors, in [m]. Shape (n, nv).
        position_error: Greatest error of a sphere's centre, in [m]; it must be part of the contact
            distance. Shape (n,).
        table: Joint displacements, as `tabulate` filled it last.
    """

    interpolates: bool
    """Whether displacements are convex in time, so that tables may be interpolated."""
    times: FloatArray
    """Of the table's nodes, until they are filled, in [s] from now. Shape (nodes,)."""
    free_time: float
    """How long joints are free to move, in [s] from the stamp, before they brake."""

    def __init__(
        self,
        robot: Robot,
        base_placement: pinocchio.SE3 | None = None,
        *,
        operating: OperatingLimits | LimitsInForce | None = None,
        with_velocities: bool = False,
    ) -> None:
        """Compute the levers of all spheres.

        Args:
            robot: The arm.
            base_placement: Placement of the robot's base in the world; None: they coincide.
            operating: Operating limits of the joints; None: the robot's limits.
            with_velocities: Whether the table is to have velocities as well.

        Raises:
            ArmguardError: A limit of the robot is missing or unusable, or operating limits do not
                fit it.
        """
        super().__init__(robot, base_placement)
        # The robot's own limits first, so that theirs are the errors that name what is unusable.
        self.limits = read_limits(robot)
        if operating is not None:
            self.limits = read_limits(robot, put_in_force(robot, operating))
        model = robot.model
        numbers = [model.getJointId(joint) for joint in robot.joints]
        self._turning = np.array([not is_prismatic(model, number) for number in numbers])
        self.lever = compute_sphere_levers(robot)
        slope_error, _ = velocity_error_terms(
            self.lever, robot.position_error, robot.velocity_error
        )
        self.slope_error = read_only(slope_error)
        self.position_error = read_only(sum_levers(self.lever, robot.position_error))
        self.table = self._make_table(self.times.copy(), with_velocities=with_velocities)

    def _bound(self, question: Question) -> float:
        robot, t = self._robot, question.t
        refuse_beyond(robot, self.limits, question.q, question.v)
        slope_error, _ = velocity_error_terms(
            question.lever, robot.position_error, robot.velocity_error
        )
        jacobian = pinocchio.computeJointJacobians(robot.model, self._data, question.q)
        jacobian = jacobian.reshape(6, -1)  # Pinocchio makes a vector of a single joint's.
        place = self._data.oMi[question.joint].act(question.local)
        # Nodes that do not depend on t, and t: what is greatest over them never falls with t.
        nodes = grid(min(int(np.sqrt(t / GRID_STEP)) + 2, MOST_NODES))
        table = self._make_table(np.append(nodes[nodes < t], t))
        self._fill(question.q, question.v, 0.0, self.free_time, table)
        lever, along = question.lever[0], question.along
        return float(_largest_displacement(along, place, jacobian, lever, slope_error[0], table))

    def _make_table(self, time: FloatArray, *, with_velocities: bool = False) -> JointTable:
        return make_table(
            time,
            self._turning,
            self.limits.position_error,
            interpolates=self.interpolates,
            with_velocities=with_velocities,
        )

    def _fill(
        self, q: FloatArray, v: FloatArray, age: float, free: float, table: JointTable
    ) -> None:
        fill_table(q, v, age, free, self.limits, table)

    def _check_shapes(self, q: FloatArray, v: FloatArray, age: float) -> None:
        """Refuse what no table can be filled for, whatever the limits."""
        shape = (len(self.limits.lower),)
        if not (q.shape == v.shape == shape and q.dtype == v.dtype == np.float64):
            raise ArmguardError(
                "joint state",
                f"q is {q.dtype} {q.shape} and v is {v.dtype} {v.shape}",
                expected=f"float64 {shape} for both",
            )
        if not abs(age) < np.inf:
            raise ArmguardError("age", f"is {age} s", expected="finite")


def grid(nodes: int) -> FloatArray:
    """Times in [s] at which displacements are taken: dense where they grow like t²."""
    return np.asarray(GRID_STEP * np.arange(nodes) ** 2.0, dtype=np.float64)


@kernel
def _largest_displacement(
    along: FloatArray,
    place: FloatArray,
    jacobian: FloatArray,
    lever: FloatArray,
    slope_error: FloatArray,
    table: JointTable,
) -> float:
    """Greatest displacement over any step of the table; 0 if all are negative."""
    if not set_columns(place[0], place[1], place[2], jacobian, table.box):
        return np.inf
    largest = 0.0
    for node in range(table.time.shape[0] - 1):
        set_span(table, node, node + 1, 1.0)
        displacement = displacement_in_box(
            (along[0], along[1], along[2]), jacobian, lever, slope_error, table.box
        )
        largest = max(largest, displacement)
    return largest


SLICES = 32
"""Steps of the table: more of them would see later contacts, and take longer."""

END = 1.024
"""When the table ends, in [s] from now: by then an arm can be anywhere."""


class JointMotion(JointSpaceMotion):
    """Each joint moves freely within its position, velocity and acceleration limits.

    A tick fills one table for the whole arm, which `armguard.bounds.table_contact_time` turns
    into contact times for any number of pairs of sphere and obstacle.
    """

    interpolates = True
    # Dense where displacements grow like t².
    times = END * (np.arange(SLICES + 1) / SLICES) ** 2.0
    free_time = np.inf

    def tabulate(self, q: FloatArray, v: FloatArray, age: float) -> JointTable:
        """Fill the table of one tick.

        Args:
            q: Measured joint positions, in [rad] or [m]. Shape (nv,), float64.
            v: Measured joint velocities, in [rad]/[s] or [m]/[s]. Shape (nv,), float64.
            age: Now minus the stamp of the state, in [s]; negative where that is newer.

        Returns:
            The table; always the same object, filled again.

        Raises:
            ArmguardError: A vector has the wrong length, the state is not finite or beyond its
                limits by more than its errors, or the age is not finite.
        """
        self._check_shapes(q, v, age)
        refuse_beyond(self._robot, self.limits, q, v)
        self._fill(q, v, age, np.inf, self.table)
        return self.table
