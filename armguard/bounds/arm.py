"""All motion models of one arm, each a proof by itself.

Constants are computed once; compiled code computes the parts that depend on the joint state, in the
ticks that need them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import pinocchio

from armguard.bounds.braking import BrakingMotion
from armguard.bounds.isotropic import IsotropicMotion
from armguard.bounds.joint import JointMotion
from armguard.bounds.link_gaps import cover_base, make_link_gaps, make_no_gaps
from armguard.bounds.reach import ReachMotion
from armguard.robot.kinematics import Kinematics
from armguard.robot.operating_limits import LimitsInForce
from armguard.robot.robot import Robot

if TYPE_CHECKING:
    from armguard.bounds.planned.motion import PlannedMotion


class ArmMotion:
    """Reach, isotropic, joint and braking bounds of one arm.

    Args:
        robot: The arm.
        reaction_time: From command to braking torque, in [s].
        base_placement: Placement of the robot's base in the world; None: they coincide.
        with_joints: Whether joint and braking bounds are to be used.
        with_plans: Whether plans are to be judged.
        in_force: The limits and brakes in force, shared; None: the robot's limits.
        with_velocities: Whether tables are to have velocities, as contact limits need.

    Attributes:
        isotropic: Spheres as free bodies.
        reach: What links cannot leave.
        joint: Joints within their limits.
        braking: Joints that brake.
        planned: Joints that follow a plan; None where plans are not judged.
        with_joints: Whether the last two are to be used.
        link_gaps: How distances between links can vary, where contact limits are stated.
        table: Joint displacements of the present tick, filled by compiled code.
        braking_table: The same for an arm that brakes; as `braking.tabulate` filled it last.
    """

    def __init__(
        self,
        robot: Robot,
        reaction_time: float,
        base_placement: pinocchio.SE3 | None = None,
        *,
        with_joints: bool = True,
        with_plans: bool = False,
        in_force: LimitsInForce | None = None,
        with_velocities: bool = False,
    ) -> None:
        self.isotropic = IsotropicMotion(robot, base_placement, operating=in_force)
        self.reach = ReachMotion(robot, base_placement)
        self.joint = JointMotion(
            robot, base_placement, operating=in_force, with_velocities=with_velocities
        )
        self.braking = BrakingMotion(
            robot,
            reaction_time,
            base_placement,
            operating=in_force,
            with_velocities=with_velocities,
        )
        self.link_gaps = make_no_gaps()
        if with_velocities:
            limits = self.joint.limits
            self.link_gaps = make_link_gaps(
                Kinematics(robot, base_placement),
                self.joint.lever,
                self.joint.table.box.turning,
                limits.lower,
                limits.upper,
                cover_base(robot.fixed_points().values(), base_placement),
            )
        self.planned: PlannedMotion | None = None
        if with_plans:
            from armguard.bounds.planned.motion import PlannedMotion

            self.planned = PlannedMotion(
                robot, base_placement, in_force=in_force, gaps=self.link_gaps
            )
        self.with_joints = with_joints
        self.table = self.joint.table
        self.braking_table = self.braking.table
