"""Motion model of an arm that follows a plan, so that only obstacles are unknown.

The controller sends its next piece of trajectory, including its stop, and its tracking errors. The
region of the arm until the end of the piece is computed once, in slabs of time. Contact times are
then computed whenever obstacles change.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import pinocchio

from armguard.bounds.checks import check_question
from armguard.bounds.closing import make_arms
from armguard.bounds.joint_box import displacement_in_box, make_box
from armguard.bounds.limits import JointLimits, read_limits
from armguard.bounds.link_gaps import LinkGaps, make_no_gaps
from armguard.bounds.planned.clamps import place_parts
from armguard.bounds.planned.contact import (
    Permissions,
    PlannedContact,
    Surroundings,
    find_planned_contact,
    make_surroundings,
)
from armguard.bounds.planned.course import ArmShape, PlannedCourse, set_slab
from armguard.bounds.planned.curve import evaluate_curve
from armguard.bounds.planned.harmless import NO_SPEEDS, CourseSpeeds, sum_up_speeds
from armguard.bounds.planned.placing import PlacedArm, check_chain, make_chain, place_all
from armguard.bounds.planned.plan import CheckedPlan, is_plain, make_example
from armguard.bounds.planned.slabs import Slabs, center, include, lay_left_piece, lay_piece
from armguard.bounds.sums import compute_levers, compute_sphere_levers
from armguard.exceptions import ArmguardError
from armguard.jit.arrays import FloatArray, IntArray
from armguard.jit.handle import machine_code, pack
from armguard.jit.kernels import kernel
from armguard.obstacles.regions import make_no_limits
from armguard.obstacles.table import Marks, States
from armguard.obstacles.tethers import Tethers, make_tethers
from armguard.robot.brakes import BrakeCurves
from armguard.robot.joints import is_prismatic
from armguard.robot.kinematics import Kinematics
from armguard.robot.operating_limits import LimitsInForce
from armguard.robot.robot import Robot


class PlannedMotion:
    """The arm follows a plan within its deviation, to rest at its end.

    A proof about a piece must hold until its end, and operating limits can be suspended before. So
    only the piece itself and the robot's own limits are assumed.
    """

    def __init__(
        self,
        robot: Robot,
        base_placement: pinocchio.SE3 | None = None,
        *,
        in_force: LimitsInForce | None = None,
        gaps: LinkGaps | None = None,
    ) -> None:
        """Compute the levers of all spheres, and compile.

        Args:
            robot: The arm.
            base_placement: Placement of the robot's base in the world; None: they coincide.
            in_force: Brakes under the payload in force, shared; None: the robot's brakes under the
                heaviest payload.
            gaps: Bounds on distances between links; None: clamping between links is not considered.

        Raises:
            ArmguardError: The placement is no rigid motion, or a limit of the robot is missing or
                unusable.
        """
        self._robot = robot
        self._limits = read_limits(robot)._replace(brakes=read_limits(robot, in_force).brakes)
        self._handle = pack(self._limits)
        self._kinematics = Kinematics(robot, base_placement)
        spheres = self._kinematics.spheres
        numbers = [robot.model.getJointId(joint) for joint in robot.joints]
        turning = np.array([not is_prismatic(robot.model, number) for number in numbers])
        self._arm = ArmShape(
            tree=spheres.tree,
            lever=compute_sphere_levers(robot),
            box=make_box(turning, np.zeros(len(turning))),
            carrier=np.array(spheres.joint),
            local=np.array(spheres.local),
            exact=np.zeros(len(turning)),
            moves=self._kinematics.placement.moves,
            gaps=make_no_gaps() if gaps is None else gaps,
            arms=make_arms(len(turning)),
        )
        self._nothing_permitted = Permissions(make_no_limits())
        self._no_tethers = make_tethers(0, 0)
        self._still = np.zeros(len(robot.joints))
        self._placed_arm = pack(PlacedArm(make_chain(self._kinematics), self._arm))
        check_chain(self._placed_arm, self._kinematics)
        # All that these are handed is made here, or by kernels.
        times, boxes, plan = np.zeros((2, 1)), np.zeros((2, 1, len(turning))), make_example()
        self._lay_piece = machine_code(lay_piece, plan, self._handle, True, True)
        self._lay_left_piece = machine_code(lay_left_piece, plan, self._handle, 0.0, True)
        self._include = machine_code(include, times, boxes, boxes, plan, self._handle, 0.0)
        self._place_boxes = machine_code(_place_boxes, self._placed_arm, self._handle, boxes)
        self._sum_up_speeds = machine_code(sum_up_speeds, times, *boxes, *boxes, np.int64(1))
        self._place_parts = machine_code(_place_parts, self._placed_arm, np.zeros((1, 1, 3, 4)))
        self._surroundings: tuple[Surroundings | None, Any, Any] = None, None, None

    def lay_out(
        self,
        plan: CheckedPlan,
        before: Sequence[CheckedPlan] = (),
        *,
        with_velocities: bool = False,
    ) -> PlannedCourse:
        """Compute the course of the arm from the check of a piece until rest at its end.

        Args:
            plan: A plan that `armguard.bounds.check_plan` has accepted for this robot.
            before: Pieces that the arm may be following until this one begins; without any, joints
                are free within their limits until then.
            with_velocities: Whether to compute its velocities as well, for contact limits.

        Returns:
            The course, valid for any number of contact times.

        Raises:
            ArmguardError: A plan was not checked, or for a robot with other joints.
        """
        self._check(plan, before)
        slabs = self._lay_piece(plan, self._handle, not before, with_velocities)
        return self._place(plan, before, slabs)

    def lay_out_left(
        self,
        plan: CheckedPlan,
        before: Sequence[CheckedPlan] = (),
        latency: float = 0.0,
        *,
        with_velocities: bool = False,
    ) -> PlannedCourse | None:
        """Compute the course of a piece that each joint may leave at any moment to brake by itself.

        An arm that leaves one of the pieces before is on the course of that one.

        Args:
            plan: What `armguard.bounds.check_plan` found to be in order for this robot.
            before: Pieces that the arm may be following until this one begins.
            latency: Latest time until the arm follows it, in [s].
            with_velocities: As for `lay_out`.

        Returns:
            None if a joint may be faster than its brakes are stated for, or if the piece begins
            later and follows no other piece: the brakes of joints that are free until then are
            unknown.

        Raises:
            ArmguardError: A plan was not checked, or for a robot with other joints.
        """
        self._check(plan, before)
        if plan.stamp > plan.now and not before:
            return None
        slabs = self._lay_left_piece(plan, self._handle, float(latency), with_velocities)
        return self._place(plan, before, slabs) if slabs[0].size else None

    @property
    def brakes(self) -> BrakeCurves:
        """The brakes under the payload in force."""
        return self._limits.brakes

    def _check(self, plan: object, before: Sequence[CheckedPlan] = ()) -> None:
        joints = len(self._limits.lower)
        if not (isinstance(plan, CheckedPlan) and is_plain(plan, joints)):
            other = " with other arrays" if isinstance(plan, CheckedPlan) else ""
            raise ArmguardError(
                "plan",
                f"is a {type(plan).__name__}{other}",
                expected=f"what check_plan returns for a robot with {joints} joints",
            )
        if plan.stamp > plan.now:
            # Else nothing is read of those before.
            for one in before:
                self._check(one)

    def _place(
        self, plan: CheckedPlan, before: Sequence[CheckedPlan], slabs: Slabs
    ) -> PlannedCourse:
        """Place the arm in the middle of each slab; compute balls around everything it sweeps."""
        times, boxes, speeds = slabs
        if plan.stamp > plan.now:
            for one in before:
                self._include(times, boxes, speeds, one, self._handle, plan.now - one.stamp)
        placed = self._place_boxes(self._placed_arm, self._handle, boxes)
        summed = NO_SPEEDS
        if speeds.shape[1] > 0:
            spheres = len(self._arm.carrier)
            parts = self._place_parts(self._placed_arm, placed[0])
            sums = self._sum_up_speeds(times, *boxes, *speeds, spheres)
            summed = pack(CourseSpeeds._make((*sums, parts)))
        return PlannedCourse._make((float(plan.now), *times, *boxes, *placed, summed))

    def contact_time(
        self,
        course: PlannedCourse,
        pairs: IntArray,
        now: float,
        margin: float,
        bodies: States,
        refused_bodies: States,
        marks: Marks,
        permitted: Permissions | None = None,
        tethers: Tethers | None = None,
    ) -> PlannedContact:
        """Earliest possible contact on a course; inf if there is none before the arm is at rest.

        Contact with an arm at rest does not count, since the obstacle causes it. On a course with
        velocities, contact that contact limits permit does not count either.

        Args:
            course: Course of a plan that the arm follows or would follow.
            pairs: Pair numbers, obstacle row × links + link, without ignored pairs; fastest in
                ascending order. Shape (m,), int64.
            now: Time in [s] on the clock of all stamps; outside the course the result is 0.
            margin: Distance that counts as contact already, in [m].
            bodies: Accepted states, by row.
            refused_bodies: Refused samples, which may be true as well.
            marks: Which of these states exist; the result is 0 for a row without any.
            permitted: Permitted contact; None: none.
            tethers: Tethers between the obstacles; None: none.
        """
        pairs = np.ascontiguousarray(pairs, dtype=np.int64)
        # What is compiled for whole numbers would cut off all others that come later.
        now, margin = float(now), float(margin)
        limits, obstacle_speeds = self._nothing_permitted if permitted is None else permitted
        tethers = self._no_tethers if tethers is None else tethers
        speeds = np.empty(len(pairs))
        speeds[:] = obstacle_speeds
        around, handle, find_contact = self._surroundings
        if around is None or not (
            around.bodies is bodies
            and around.refused_bodies is refused_bodies
            and around.marks is marks
            and around.limits is limits
            and around.tethers is tethers
        ):
            # Of a monitor these are the same arrays in every tick, but for a table that has grown.
            around = make_surroundings(self._arm, bodies, refused_bodies, marks, limits, tethers)
            handle = pack(around)
            given = handle, course, pairs, speeds, now, margin
            find_contact = machine_code(find_planned_contact, *given)
            self._surroundings = around, handle, find_contact
        return PlannedContact(*find_contact(handle, course, pairs, speeds, now, margin))

    def advance(
        self,
        course: PlannedCourse,
        plan: CheckedPlan,
        link: str,
        point: npt.ArrayLike,
        direction: npt.ArrayLike,
        t: float,
    ) -> float:
        """Bound on a point's displacement along a direction at every time in [0, t], in [m].

        It is measured from the point's position with every joint on the plan at the beginning of
        the course (or at its measured position, if the plan begins later). Unlike in other models,
        it includes the errors of joints at that time.

        Args:
            course: Result of `lay_out` for the plan.
            plan: That plan.
            link: Name of the link that carries the point.
            point: In the frame of the link's parent joint, in [m]. Shape (3,).
            direction: Unit vector in the world. Shape (3,).
            t: Time from the beginning of the course, in [s], >= 0.

        Returns:
            Never negative, and never falling as t grows.

        Raises:
            ArmguardError: The link is unknown, a shape is wrong, a value is not finite, the time is
                negative, or the direction is not a unit vector.
        """
        local, along = check_question(point, direction, t)
        robot, kinematics = self._robot, self._kinematics
        lever = compute_levers(robot, link, local[None])[0]
        joint = robot.joint_index(link)
        start = plan.measured_q.copy()
        if plan.now >= plan.stamp:
            velocity = np.empty_like(start)
            evaluate_curve(plan.times, plan.q, plan.v, plan.now - plan.stamp, start, velocity)
        kinematics.compute(start, self._still)
        origin = float(along @ kinematics.data.oMi[joint].act(local))
        largest = 0.0
        for slab in np.flatnonzero(course.start <= t):
            x, y, z = course.placement[slab, joint] @ np.append(local, 1.0)
            if not set_slab(self._arm, course, slab, (x, y, z)):
                return np.inf
            given = course.jacobian[slab], lever, self._arm.exact, self._arm.box
            moved = displacement_in_box(tuple(along), *given)
            largest = max(largest, float(along @ [x, y, z]) - origin + moved)
        return largest


@kernel
def _place_parts(handle: Any, placement: FloatArray) -> FloatArray:
    """`place_parts` on the handle of a `PlacedArm`."""
    return place_parts(handle.content.arm, placement)


@kernel
def _place_boxes(
    handle: Any, limits: JointLimits, boxes: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """`place_all` of boxes, (2, slabs, nv), whose least and greatest positions are centered."""
    center(boxes, limits)
    return place_all(handle, boxes[0], boxes[1])
