"""A trajectory that the arm follows until it is stopped: can it be stopped in time?

The arm's way is known until brakes bite, at any time from now until the verdict after this one has
been obeyed. So what is asked in a tick is the stop decision's question, of an arm that is on its
trajectory until then.

Where a new trajectory takes the place of one that the arm may still be following, both are kept
until joint states tell them apart, and both must allow the arm to go on. Joint states never tell
apart two that have come to rest at the same place: of these the older goes, where the newer one
says no more.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from armguard.bounds.planned.check import PlanCheck, check_path_stop
from armguard.bounds.planned.course import PlannedCourse
from armguard.bounds.planned.following import Following
from armguard.bounds.planned.motion import PlannedMotion
from armguard.bounds.planned.plan import CheckedPlan, Plan, Refusal
from armguard.bounds.planned.slabs import PathClock
from armguard.jit.numerics import LIMIT_SLACK
from armguard.monitor.plan_verdict import (
    CourseContact,
    find_course_contact,
    refuse_plan,
)
from armguard.monitor.settings import read_number
from armguard.monitor.stop_decision import find_proving
from armguard.robot.robot import Robot
from armguard.scheduling.scheduler import Scheduler, Tick
from armguard.verdict import PlanVerdict, Reason, ReasonKind

MOST_TRAJECTORIES = 16
"""Trajectories that the arm may be on at a time."""


class Trajectory(NamedTuple):
    """One that the arm may be on."""

    plan: CheckedPlan
    since: float
    """From when on it was followed at the latest: since it was obeyed, or began, in [s]."""
    along: float
    """Where on it the arm was measured last, in [s] as in the plan's times."""
    slowing: float
    """How fast its clock can surely be slowed down anywhere on it, in [1]/[s]; 0 or less: not."""
    stop_lasting: float
    """How long a stop on the path lasts once brakes bite, in [s]."""
    is_told: bool = False
    """Whether the arm has said so; else it is on time, or was when it was taken."""

    @property
    def is_over(self) -> bool:
        """Whether the arm has come to its end, where it rests."""
        return bool(self.along >= self.plan.times[-1])


class FollowedTrajectory:
    """Keeps the trajectories that the arm may be on, and says whether it can be stopped in time.

    Args:
        robot: The arm.
        scheduler: Knows the pairs.
        response_time: Until the verdict after the present one is obeyed, in [s].
        latency: Until an answer is obeyed, in [s].
        reaction_time: From then until brakes bite, in [s].
        margin: Distance that counts as contact already, in [m].
        on_path: Whether the arm stops on its path; else each joint by itself.
        path_deceleration: How fast such a stop surely slows the path's clock down, in [1]/[s];
            None: as fast as brakes guarantee.

    Attributes:
        evaluated: Evaluations, since it was set to 0.
        is_on_time: Whether the clock of what is followed is time itself; else the arm tells it.
    """

    def __init__(
        self,
        robot: Robot,
        scheduler: Scheduler,
        response_time: float,
        latency: float,
        reaction_time: float,
        margin: float,
        *,
        on_path: bool,
        path_deceleration: float | None,
    ) -> None:
        self.evaluated = 0
        self._robot = robot
        self._scheduler = scheduler
        self._check = PlanCheck(robot)
        self._following = Following(robot)
        self._response_time = response_time
        self._latency = latency
        self._reaction_time = reaction_time
        self._margin = margin
        self._on_path = on_path
        self._path_deceleration = path_deceleration
        self._proving = find_proving(response_time)
        self._proved_until = self._proved_end = self._prove_at = -math.inf
        self._proved_of: PlannedMotion | None = None
        self.reset()

    def reset(self) -> None:
        """Forget all trajectories: from now on the arm may do what its joints can."""
        self._trajectories: list[Trajectory] = []
        self.is_on_time = True
        self._stamp = -math.inf
        self._forget_proof()

    @property
    def is_followed(self) -> bool:
        """Whether the arm is on a trajectory."""
        return bool(self._trajectories)

    @property
    def plans(self) -> list[CheckedPlan]:
        """The trajectories that the arm may be on."""
        return [one.plan for one in self._trajectories]

    @property
    def stop_lasting(self) -> float | None:
        """How long a stop lasts once brakes bite, in [s]; None where joints stop by themselves."""
        if not (self._on_path and self._trajectories):
            return None
        return max(one.stop_lasting for one in self._trajectories)

    def is_over(self) -> bool:
        """Whether the arm has come to the end of all its trajectories, if it is on any."""
        return all(one.is_over for one in self._trajectories)

    def follow(self, plan: Plan, tick: Tick) -> PlanVerdict:
        """Take a trajectory at the last tick, if it is in order."""
        robot, now = self._robot, tick.now
        stamp = now - tick.arm_age
        checked = self._check.check(plan, now, tick.q, tick.v, stamp)
        if isinstance(checked, Refusal):
            return refuse_plan(*checked)
        motion = self._planned_motion()
        refusal = self._check_operating(checked)
        if refusal is None and self._on_path:
            if self._path_deceleration is None:
                refusal = check_path_stop(checked, robot, motion.brakes)
            # Brakes may bite at any time, and the error of a stop applies from then on.
            checked = checked._replace(deviation=checked.stop_deviation)
        if refusal is not None:
            return refuse_plan(*refusal)
        if len(self._trajectories) >= MOST_TRAJECTORIES:
            detail = (
                f"is the {MOST_TRAJECTORIES + 1}th that the arm may be on: change it less often"
            )
            return refuse_plan("plan", detail)
        if self.is_on_time:
            # Where its clock is the arm's own, what it does next is not known that closely.
            first = max(now, checked.stamp)
            for one in self._trajectories:
                last = max(first, now + self._latency)
                refusal, _ = self._following.compare(one.plan, checked, first, last)
                if refusal is not None:
                    return refuse_plan(*refusal)
        along = stamp - checked.stamp
        if not self.is_on_time:
            along, checked = max(along, 0.0), self._free_clock(checked)
        # Until it begins, joints may be off it at any speed.
        stopping = motion.find_path_stop(checked, self._path_deceleration)
        since = max(now + self._latency, checked.stamp)
        new = Trajectory(checked, since, along, *stopping)
        self._trajectories.append(new)
        self._forget_proof()
        self._stamp = max(self._stamp, stamp)
        contact, _ = self._find_contact(tick, self._response_time)
        return PlanVerdict(True, contact.time, contact.link, contact.obstacle, ())

    def find_excess(self) -> Refusal | None:
        """Why the arm may be on a trajectory that breaks what the controller is said to keep to."""
        found = (self._check_operating(one.plan) for one in self._trajectories)
        return next((refusal for refusal in found if refusal is not None), None)

    def _check_operating(self, plan: CheckedPlan) -> Refusal | None:
        """Why a plan breaks the limits that the controller is said to keep to; None if not.

        What may be near the arm is known by these velocities, and how far joints can be off where
        they were measured by these accelerations.
        """
        limits = self._scheduler.arm.state.scene.limits
        for words, unit, found, most in (
            (
                "goes at",
                "velocity in force with error",
                plan.top_speed,
                limits.operating_velocity + limits.velocity_error,
            ),
            (
                "speeds up by",
                "acceleration in force",
                plan.top_speedup,
                limits.operating_acceleration * (1.0 + LIMIT_SLACK),
            ),
        ):
            off = np.flatnonzero(~(found <= most + LIMIT_SLACK))
            if len(off):
                j = int(off[0])
                detail = f"{words} {found[j]:.4g}, {unit} is {most[j]:.4g}"
                return Refusal(self._robot.joints[j], detail)
        return None

    def update(self, tick: Tick, stamp: float, path_time: object) -> Reason | None:
        """Take a tick's joint state; why the arm follows no trajectory any more, if so.

        Args:
            tick: The tick.
            stamp: Of its joint state, in [s].
            path_time: Where on the trajectory the arm says it is, in [s]; None: it is followed on
                time.
        """
        if not self._trajectories:
            return None
        if path_time is None and not self.is_on_time:
            self.reset()
            detail = "is missing, expected in every step once it was told"
            return Reason(ReasonKind.PLAN_VOID, "path_time", detail)
        told: float | None = None
        if path_time is not None:
            told = read_number(path_time)
            if not -math.inf < told < math.inf:
                self.reset()
                detail = f"is {path_time!r}, expected a finite number of seconds"
                return Reason(ReasonKind.PLAN_VOID, "path_time", detail)
            if self.is_on_time:
                self.is_on_time = False
                self._forget_proof()
                self._trajectories = [
                    one._replace(plan=self._free_clock(one.plan)) for one in self._trajectories
                ]
        strayed: Refusal | None = None
        kept = []
        passed = stamp - self._stamp
        for one in self._trajectories:
            found = self._following.check(one.plan, tick.q, tick.v, stamp, told)
            along = stamp - one.plan.stamp if told is None else told
            gone = along - one.along
            if (
                found is None
                and one.is_told
                and not -LIMIT_SLACK <= gone <= max(passed, 0.0) + LIMIT_SLACK
            ):
                detail = (
                    f"went on by {gone:.6g} s in {passed:.6g} s, expected no less than 0 nor more"
                )
                found = Refusal("path_time", detail)
            if found is None:
                is_told = told is not None
                kept.append(
                    Trajectory(one.plan, one.since, along, one.slowing, one.stop_lasting, is_told)
                )
            strayed = found or strayed
        self._stamp = stamp
        if not kept:
            assert strayed is not None, "the last one was not followed"
            self.reset()
            return Reason(ReasonKind.PLAN_VOID, *strayed)
        self._trajectories = _leave_out_finished(kept)
        return None

    def rests(self, tick: Tick) -> bool:
        """Whether the arm surely rests before contact, told to stop only after the next tick."""
        return self.is_followed and self._is_free(tick, self._response_time)

    def is_braked(self, tick: Tick) -> bool:
        """Whether brakes are stated for every speed on the way, told to stop after the next tick.

        Args:
            tick: The present one.
        """
        return self.is_followed and all(
            self._lay_out(one, tick, self._response_time, 1.0) is not None
            for one in self._trajectories
        )

    def is_free(self, tick: Tick, told_after: float, pace: float) -> bool:
        """Whether the arm surely rests before contact if its clock keeps to a pace until it stops.

        Args:
            tick: The present one.
            told_after: When the arm is told to stop, in [s] from now.
            pace: The greatest pace of its clock, in [0, 1]; of one that is time itself 1.
        """
        if pace == 1.0:
            return self._is_free(tick, told_after)
        return self._find_contact(tick, told_after, pace)[0].time == math.inf

    def find_gain(self) -> float:
        """How much sooner an arm rests whose clock stands still than one at full pace, in [s].

        Both are told to stop after the next tick. Of a stop on the path nothing says that a slow
        clock could not be at full pace again by then.
        """
        if self._on_path:
            return 0.0
        motion, delay = self._planned_motion(), self._response_time + self._reaction_time
        return max(motion.find_gain(one.plan.top_speed, delay) for one in self._trajectories)

    def _is_free(self, tick: Tick, told_after: float) -> bool:
        """Whether the arm surely rests before contact, told to stop only after some time, in [s].

        That is proved of a later time first: an arm that can be told to stop then can be told to at
        any time before. So the proof answers in ticks to come, too, while the arm is where it had
        it be: on the trajectories that it was made of, no pace of their clocks above 1. Of one that
        is held to a lower pace nothing is kept, for what it does in the ticks to come is not known.
        """
        told = tick.time + told_after
        if (
            told <= self._proved_until
            and self._proved_of is self._planned_motion()
            and self._scheduler.is_way_proved(told, self._proved_end)
        ):
            return True
        if self._proving > 0.0 and not tick.time < self._prove_at:
            contact, end = self._find_contact(tick, told_after + self._proving)
            if contact.time == math.inf:
                self._proved_until, self._proved_end = told + self._proving, tick.time + end
                self._proved_of = self._planned_motion()
                self._scheduler.keep_way_proof(self._proved_until, self._proved_end)
                return True
            # It can only be asked of this tick; and so it will be for the ones to come.
            self._prove_at = tick.time + self._proving
        return self._find_contact(tick, told_after)[0].time == math.inf

    def _forget_proof(self) -> None:
        """Forget what was proved of other trajectories, or another clock."""
        self._proved_until = self._proved_end = self._prove_at = -math.inf
        self._proved_of = None
        self._scheduler.forget_way_proofs()

    def _find_contact(
        self, tick: Tick, told_after: float, pace: float = 1.0
    ) -> tuple[CourseContact, float]:
        """What could touch an arm that is told to stop within some time, on its way to rest.

        And how long it takes to rest, in [s]; 0 where that is not known.
        """
        motion, scheduler = self._planned_motion(), self._scheduler
        first, latest = CourseContact(math.inf, None, None, 0), 0.0
        for one in self._trajectories:
            course = self._lay_out(one, tick, told_after, pace)
            if course is None:
                return CourseContact(0.0, None, None, 0), 0.0
            latest = max(latest, float(course.end[-1]))
            pairs = scheduler.near_pairs(tick, float(course.end[-1]))
            found = find_course_contact(scheduler, motion, course, pairs, tick, self._margin)
            self.evaluated += found.evaluated
            if not found.time >= first.time:
                first = found
        return first, latest

    def _lay_out(
        self, one: Trajectory, tick: Tick, told_after: float, pace: float
    ) -> PlannedCourse | None:
        """Where an arm on a trajectory can be until it rests; None where that is not known."""
        if self.is_on_time and one.along < 0.0:
            # Until it begins, joints are free, and the stop decision is asked of that anyway.
            return None
        now = tick.now
        plan = one.plan._replace(
            now=now, measured_stamp=now - tick.arm_age, measured_q=tick.q, measured_v=tick.v
        )
        clock = PathClock(
            one.along,
            tick.arm_age,
            self.is_on_time,
            now - one.since,
            pace,
            one.slowing,
            self._path_deceleration is not None,
        )
        latest = told_after + self._reaction_time
        return self._planned_motion().lay_out_stop(plan, clock, latest, on_path=self._on_path)

    def _planned_motion(self) -> PlannedMotion:
        motion = self._scheduler.arm.motion.planned
        assert motion is not None, "a monitor follows trajectories only where it bounds them"
        return motion

    def _free_clock(self, plan: CheckedPlan) -> CheckedPlan:
        """The plan of an arm with a clock of its own, which speeds up and slows down as it can."""
        limits = np.array(self._robot.acceleration_limit, dtype=np.float64)
        return plan._replace(acceleration=2.0 * limits)


def _leave_out_finished(trajectories: list[Trajectory]) -> list[Trajectory]:
    """Those without which the arm could be anywhere else; the newest last, as they were."""
    return [
        one
        for i, one in enumerate(trajectories)
        if not any(_rests_within(one, newer) for newer in trajectories[i + 1 :])
    ]


def _rests_within(one: Trajectory, newer: Trajectory) -> bool:
    """Whether an arm that rests at the end of one does so at the end of a newer one as well.

    So it is where both have come to the same end, and whatever the arm may be off the first, it may
    be off the newer one: place, velocity, and what becomes of both while it stops. The newer one
    was also followed for a shorter time, which says less about velocities.
    """
    if not (one.is_over and newer.is_over):
        return False
    first, second = one.plan, newer.plan
    return bool(
        (first.q[-1] == second.q[-1]).all()
        and (first.deviation <= second.deviation).all()
        and (first.stop_deviation <= second.stop_deviation).all()
        and (first.velocity_deviation <= second.velocity_deviation).all()
        and (first.acceleration <= second.acceleration).all()
        and one.since <= newer.since
    )
