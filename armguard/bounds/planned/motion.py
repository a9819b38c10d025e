"""What the arm does if it follows a plan: obstacles are then all that is unknown.

The controller tells its next piece of trajectory, its stop included, and how far off it the arm may
be. Where the arm can be until the end of the piece is laid out in slabs of time, and then asked for
contact times as often as obstacles change.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import pinocchio

from armguard.bounds.checks import check_question, read_only
from armguard.bounds.joint_box import displacement_in_box, make_box
from armguard.bounds.limits import read_limits
from armguard.bounds.planned.check import PlanCheck, StopCheck
from armguard.bounds.planned.contact import PlannedContact, Surroundings, find_planned_contact
from armguard.bounds.planned.course import ArmShape, PlannedCourse, set_slab
from armguard.bounds.planned.curve import evaluate_curve
from armguard.bounds.planned.following import Following
from armguard.bounds.planned.placing import PlacedArm, check_chain, make_chain, place_all
from armguard.bounds.planned.plan import CheckedPlan, Plan, Refusal, is_plain
from armguard.bounds.planned.slabs import JointSlabs, SlabMaker
from armguard.bounds.planned.stop import append_stop
from armguard.bounds.sums import compute_levers, compute_sphere_levers
from armguard.exceptions import ArmguardError
from armguard.jit.arrays import FloatArray, IntArray
from armguard.jit.handle import machine_code, pack
from armguard.obstacles.obstacles import Obstacles
from armguard.obstacles.table import Marks, States
from armguard.robot.brakes import BrakeCurves, find_gentlest_stop
from armguard.robot.joints import is_prismatic
from armguard.robot.kinematics import Kinematics
from armguard.robot.operating_limits import LimitsInForce
from armguard.robot.robot import Robot


class PlannedMotion:
    """The arm follows a plan within its deviation, to rest at its end.

    What was proved of a piece is to stand until its end, and operating limits may cease to be in
    force before: beside the piece itself it is the robot's own limits that count.
    """

    def __init__(
        self,
        robot: Robot,
        base_placement: pinocchio.SE3 | None = None,
        *,
        lever: FloatArray | None = None,
        in_force: LimitsInForce | None = None,
    ) -> None:
        """Compute the levers of all spheres, and compile.

        Args:
            robot: The arm.
            base_placement: Placement of the robot's base in the world; None: they coincide.
            lever: What `compute_sphere_levers` found for this robot; None: it is computed here.
            in_force: How joints stop under the payload in force, shared; None: the robot's brakes
                under the heaviest payload.

        Raises:
            ArmguardError: The placement is no rigid motion, or a limit of the robot is missing or
                unusable.
        """
        self._robot = robot
        self._limits = read_limits(robot)._replace(brakes=read_limits(robot, in_force).brakes)
        self._slabs = SlabMaker(self._limits)
        self._kinematics = Kinematics(robot, base_placement)
        spheres = self._kinematics.spheres
        numbers = [robot.model.getJointId(joint) for joint in robot.joints]
        turning = np.array([not is_prismatic(robot.model, number) for number in numbers])
        self._arm = ArmShape(
            tree=spheres.tree,
            lever=compute_sphere_levers(robot) if lever is None else read_only(lever),
            box=make_box(turning, np.zeros(len(turning))),
            carrier=np.array(spheres.joint),
            local=np.array(spheres.local),
            exact=np.zeros(len(turning)),
        )
        self._still = np.zeros(len(robot.joints))
        self._placed_arm = pack(PlacedArm(make_chain(self._kinematics), self._arm))
        check_chain(self._placed_arm, self._kinematics)
        # All that these are handed is made here, or by kernels.
        middle = np.zeros((1, len(robot.joints)))
        self._place_all = machine_code(place_all, self._placed_arm, middle, middle)
        self._surroundings: tuple[Surroundings | None, Any, Any] = None, None, None
        self._compile()

    def lay_out(self, plan: CheckedPlan, before: Sequence[CheckedPlan] = ()) -> PlannedCourse:
        """Where the arm can be from when a piece was checked until it rests at the piece's end.

        Args:
            plan: What `armguard.bounds.check_plan` found to be in order for this robot.
            before: Pieces that the arm may be following until this one begins; without any, joints
                are free within their limits until then.

        Returns:
            Arrays of their own, good for any number of contact times.

        Raises:
            ArmguardError: A plan was not checked, or for a robot with other joints.
        """
        self._check(plan, before)
        return self._place(plan.now, self._slabs.lay_piece(plan, before))

    def lay_out_left(
        self, plan: CheckedPlan, before: Sequence[CheckedPlan] = (), latency: float = 0.0
    ) -> PlannedCourse | None:
        """The same of a piece that joints may leave, each at any moment, to brake by themselves.

        An arm that leaves one of the pieces before is on the course of that one.

        Args:
            plan: What `armguard.bounds.check_plan` found to be in order for this robot.
            before: Pieces that the arm may be following until this one begins.
            latency: Until the arm follows it at the latest, in [s].

        Returns:
            None where a joint may be faster than its brakes are stated for, and where the piece is
            yet to begin and follows none.

        Raises:
            ArmguardError: A plan was not checked, or for a robot with other joints.
        """
        self._check(plan, before)
        slabs = self._slabs.lay_left_piece(plan, before, latency)
        return None if slabs is None else self._place(plan.now, slabs)

    @property
    def brakes(self) -> BrakeCurves:
        """How joints stop under the payload in force."""
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

    def _place(self, epoch: float, slabs: JointSlabs) -> PlannedCourse:
        """The arm in the middle of each slab, and the balls around all that it sweeps."""
        placed = self._place_all(self._placed_arm, slabs.middle, slabs.half)
        return PlannedCourse(float(epoch), *slabs, *placed)

    def contact_time(
        self,
        course: PlannedCourse,
        pairs: IntArray,
        now: float,
        margin: float,
        bodies: States,
        refused_bodies: States,
        marks: Marks,
    ) -> PlannedContact:
        """Earliest possible contact on a course; inf if there is none before the arm rests.

        Contact of a resting arm does not count: that is the obstacle's doing.

        Args:
            course: Of a plan that the arm follows, or would.
            pairs: Pair numbers, obstacle row × links + link, those to be ignored left out;
                quickest in ascending order. Shape (m,), int64.
            now: In [s] on the clock of all stamps; within the course, else the answer is 0.
            margin: Distance that counts as contact already, in [m].
            bodies: Accepted states, by row.
            refused_bodies: Refused samples beside them, which may be true as well.
            marks: Which of those there are; where there is neither, the answer is 0.
        """
        pairs = np.ascontiguousarray(pairs, dtype=np.int64)
        # What is compiled for whole numbers would cut off all others that come later.
        now, margin = float(now), float(margin)
        around, handle, find_contact = self._surroundings
        if around is None or not (
            around.bodies is bodies
            and around.refused_bodies is refused_bodies
            and around.marks is marks
        ):
            # Of a monitor these are the same arrays in every tick, but for a table that has grown.
            around = Surroundings(self._arm, bodies, refused_bodies, marks)
            handle = pack(around)
            find_contact = machine_code(find_planned_contact, handle, course, pairs, now, margin)
            self._surroundings = around, handle, find_contact
        return PlannedContact(*find_contact(handle, course, pairs, now, margin))

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

        It is counted from where the point would be, were every joint where the plan has it when
        the course begins (where it was measured, if the plan begins later). Unlike that of other
        models it includes what joints may be off at that time.

        Args:
            course: What `lay_out` made of the plan.
            plan: That plan.
            link: Name of the link that carries the point.
            point: In the frame of the link's parent joint, in [m]. Shape (3,).
            direction: Unit vector in the world. Shape (3,).
            t: From the beginning of the course, in [s], >= 0.

        Returns:
            Never negative, and never falling as t grows.

        Raises:
            ArmguardError: An unknown link, a wrong shape, a value that is not finite, a negative
                time, or a direction that is no unit vector.
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
            kinematics.compute(course.middle[slab], self._still)
            place = kinematics.data.oMi[joint].act(local)
            set_slab(self._arm, course, slab, (place[0], place[1], place[2]))
            deviation = displacement_in_box(
                along[0],
                along[1],
                along[2],
                course.jacobian[slab],
                lever,
                self._arm.exact,
                self._arm.box,
            )
            largest = max(largest, float(along @ place) - origin + deviation)
        return largest

    def _compile(self) -> None:
        """Run every kernel once on nothing, so that none is compiled when a plan is due."""
        robot, still = self._robot, self._still
        q = np.clip(still, robot.lower_position_limit, robot.upper_position_limit)
        times, q = np.array([0.0, 1.0]), np.array([q, q])
        rest = Plan(0.0, times, q, np.zeros_like(q), np.ones(len(still)))
        plan = PlanCheck(robot).check(rest, 0.0, q[0], still, 0.0)
        if isinstance(plan, Refusal):
            raise ArmguardError(robot.name, f"cannot even rest: {plan}")
        StopCheck(robot, self.brakes)
        Following(robot)
        append_stop(rest, find_gentlest_stop(self.brakes, plan.top_speed))
        self.lay_out(plan._replace(now=-0.1), [plan])
        course = self.lay_out(plan._replace(now=-0.1))
        self.lay_out_left(plan)
        table, none = Obstacles().table, np.zeros(0, dtype=np.int64)
        states = table.accepted, table.refused_states, table.marks
        self.contact_time(course, none, 0.0, 0.0, *states)
