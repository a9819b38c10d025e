"""What the arm does if it follows a plan: obstacles are then all that is unknown.

The controller tells its next piece of trajectory and how far off it the arm may be; at its end the
arm brakes. Where it can be meanwhile is laid out once for each plan, and then asked for contact
times as often as obstacles change.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pinocchio

from armguard.bounds.limits import read_limits
from armguard.bounds.model import check_duration, check_question, read_only
from armguard.bounds.planned.check import CheckedPlan, check_plan
from armguard.bounds.planned.contact import PlannedContact, find_planned_contact
from armguard.bounds.planned.course import BLOCK, ArmShape, PlannedCourse, deviation_along
from armguard.bounds.planned.curve import evaluate_curve
from armguard.bounds.planned.plan import Plan, Refusal
from armguard.bounds.planned.slabs import make_slabs
from armguard.bounds.sums import compute_levers, compute_sphere_levers
from armguard.exceptions import ArmguardError
from armguard.jit.arrays import FloatArray, IntArray
from armguard.jit.numerics import SUM_ROUNDING
from armguard.obstacles.table import Marks, States, make_states
from armguard.robot.joints import is_prismatic
from armguard.robot.kinematics import Kinematics
from armguard.robot.operating_limits import LimitsInForce, OperatingLimits, put_in_force
from armguard.robot.robot import Robot


class PlannedMotion:
    """The arm follows a plan within its deviation and brakes at its end."""

    def __init__(
        self,
        robot: Robot,
        reaction_time: float,
        base_placement: pinocchio.SE3 | None = None,
        *,
        lever: FloatArray | None = None,
        operating: OperatingLimits | LimitsInForce | None = None,
    ) -> None:
        """Compute the levers of all spheres, and compile.

        Args:
            robot: The arm.
            reaction_time: From the plan's end to braking torque, in [s], >= 0.
            base_placement: Placement of the robot's base in the world; None: they coincide.
            lever: What `compute_sphere_levers` found for this robot; None: it is computed here.
            operating: What joints keep to where no plan says where they are, before it begins and
                after its end until they brake; None: the robot's limits.

        Raises:
            ArmguardError: The reaction time is negative or not finite, the placement is no rigid
                motion, a limit of the robot is missing or unusable, or operating limits do not fit
                it.
        """
        self._robot = robot
        self.reaction_time = check_duration("reaction_time", reaction_time)
        self._limits = read_limits(robot, put_in_force(robot, operating))
        self._kinematics = Kinematics(robot, base_placement)
        spheres = self._kinematics.spheres
        numbers = [robot.model.getJointId(joint) for joint in robot.joints]
        self._arm = ArmShape(
            radius=spheres.radius,
            first_child=spheres.first_child,
            child_count=spheres.child_count,
            root=spheres.root,
            lever=compute_sphere_levers(robot) if lever is None else read_only(lever),
            turning=np.array([not is_prismatic(robot.model, number) for number in numbers]),
            stack=np.zeros(len(spheres), dtype=np.int64),
        )
        self._still = np.zeros(len(robot.joints))
        self._compile()

    def lay_out(self, plan: CheckedPlan, brake_after: float = math.inf) -> PlannedCourse:
        """Where the arm can be from when the plan was checked until it rests.

        Args:
            plan: What `armguard.bounds.check_plan` found to be in order for this robot.
            brake_after: When braking is commanded, in [s] from when the plan was checked; at the
                plan's end at the latest. Where the plan lasts for the reaction time beyond, joints
                stay on it until they brake; at its end they are free for so long.

        Returns:
            Arrays of their own, good for any number of contact times.

        Raises:
            ArmguardError: The plan was not checked, or for a robot with other joints, or it begins
                after braking is commanded.
        """
        joints = len(self._limits.lower)
        if not (isinstance(plan, CheckedPlan) and plan.q.shape[1:] == (joints,)):
            raise ArmguardError(
                "plan",
                f"is a {type(plan).__name__}",
                expected=f"what check_plan returns for a robot with {joints} joints",
            )
        wait = max(plan.stamp - plan.now, 0.0)
        if not brake_after >= wait:
            raise ArmguardError(
                "brake_after", f"is {brake_after} s", expected=f"at least {wait} s, the plan's lead"
            )
        slabs = make_slabs(plan, self._limits, self.reaction_time, brake_after)
        kinematics, count = self._kinematics, len(slabs.start)
        centers = np.empty((count, len(kinematics.spheres), 3))
        jacobian = np.empty((count, 6, joints))
        for slab in range(count):
            kinematics.compute(slabs.middle[slab], self._still)
            centers[slab] = kinematics.centers
            jacobian[slab] = kinematics.data.J
        block_balls, arm_ball = self._enclose(centers, slabs.half)
        return PlannedCourse(plan.now, *slabs, centers, jacobian, block_balls, arm_ball)

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
        return PlannedContact(
            *find_planned_contact(
                pairs, now, margin, course, self._arm, bodies, refused_bodies, marks
            )
        )

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
            deviation = deviation_along(
                *along, *place, course.jacobian[slab], course.half[slab], lever, self._arm.turning
            )
            largest = max(largest, float(along @ place) - origin + deviation)
        return largest

    def _enclose(self, centers: FloatArray, half: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Balls around what links sweep, (blocks, links, 4), and one around those, (4,)."""
        roots = self._arm.root
        places = centers[:, roots]
        reach = half @ self._arm.lever[roots].T
        first = np.arange(0, len(half), BLOCK)
        low, high = np.minimum.reduceat(places, first), np.maximum.reduceat(places, first)
        middles = 0.5 * (low + high)
        away = np.linalg.norm(places - np.repeat(middles, BLOCK, axis=0)[: len(half)], axis=2)
        radii = np.maximum.reduceat(away + reach, first) + self._arm.radius[roots]
        balls = _widen(np.concatenate([middles, radii[..., None]], axis=2))
        middle = 0.5 * (low.min(axis=(0, 1)) + high.max(axis=(0, 1)))
        radius = (np.linalg.norm(middles - middle, axis=2) + balls[..., 3]).max()
        return balls, _widen(np.append(middle, radius))

    def _compile(self) -> None:
        """Run every kernel once on nothing, so that none is compiled when a plan is due."""
        robot, still = self._robot, self._still
        q = np.clip(still, robot.lower_position_limit, robot.upper_position_limit)
        times = [0.0, 1.0 + self.reaction_time]
        rest = Plan(0.0, times, [q, q], [still, still], np.ones(len(q)))
        plan = check_plan(rest, robot, 0.0, q, still, 0.0)
        if isinstance(plan, Refusal):
            raise ArmguardError(robot.name, f"cannot even rest: {plan}")
        marks = Marks(*([np.zeros(0, dtype=bool)] * 5), *([np.zeros(0, dtype=np.int64)] * 3))
        none = np.zeros(0, dtype=np.int64)
        self.lay_out(plan, 0.0)
        self.contact_time(self.lay_out(plan), none, 0.0, 0.0, make_states(0), make_states(0), marks)


def _widen(balls: FloatArray) -> FloatArray:
    """The balls with room for the rounding of what they were made from. Shape (..., 4)."""
    balls[..., 3] += SUM_ROUNDING * np.abs(balls).sum(axis=-1)
    return balls
