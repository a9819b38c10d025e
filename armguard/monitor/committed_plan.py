"""The plan that the arm follows, once it was found safe to commit.

A piece is safe when nothing can touch the arm while it follows the piece, as closely as its
controller promises, and brakes at its end; obstacles alone are unknown. So a controller that moves
on safe pieces only never has to be stopped: where the next piece is refused, it brakes at the end
of the one that it has.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from armguard.bounds.planned.check import CheckedPlan, check_following, check_plan
from armguard.bounds.planned.course import PlannedCourse
from armguard.bounds.planned.motion import PlannedMotion
from armguard.bounds.planned.plan import Plan, Refusal
from armguard.robot.robot import Robot
from armguard.scheduling.scheduler import Scheduler, Tick
from armguard.verdict import Reason, ReasonKind


class PlanVerdict(NamedTuple):
    """Whether a piece of trajectory may be committed; frozen."""

    safe: bool
    """Whether it may: then it is what the monitor takes the arm to follow from now on."""
    contact_time: float
    """Earliest possible contact on the way, in [s] from now; inf if there is none before the arm
    rests, 0 where that is unknown."""
    link: str | None
    """Link of the pair that could touch first; None if none can."""
    obstacle: str | None
    """Its obstacle, alike."""
    reasons: tuple[Reason, ...]
    """Why not."""


class CommittedPlan:
    """Judges plans and remembers the last one that was safe.

    Args:
        robot: The arm.
        scheduler: Knows the pairs.
        response_time: Until the verdict after the present one is obeyed, in [s].
        margin: Distance that counts as contact already, [m].
    """

    def __init__(
        self, robot: Robot, scheduler: Scheduler, response_time: float, margin: float
    ) -> None:
        self._robot = robot
        self._scheduler = scheduler
        self._response_time = response_time
        self._margin = margin
        self.reset()

    def reset(self) -> None:
        """Forget the plan: from now on the arm may do what its joints can."""
        self._plan: Plan | None = None
        self._checked: CheckedPlan | None = None
        self._motion: PlannedMotion | None = None

    def commit(self, plan: Plan, tick: Tick) -> PlanVerdict:
        """Judge a plan at the last tick; a safe one takes the place of the one before."""
        now = tick.now
        checked = check_plan(plan, self._robot, now, tick.q, tick.v, now - tick.arm_age)
        if isinstance(checked, Refusal):
            return refuse_plan(checked.subject, checked.detail)
        motion = self._scheduler.arm.motion.planned
        assert motion is not None, "a monitor commits to plans only where it bounds them"
        course = motion.lay_out(checked)
        found = self._find_contact(motion, course, tick)
        if found is not None:
            return found
        self._plan, self._checked, self._motion = _own(plan), checked, motion
        return PlanVerdict(True, math.inf, None, None, ())

    def check_followed(self, tick: Tick, stamp: float) -> Reason | None:
        """Why the arm does not follow its plan any more; None if it does, or has none."""
        if self._checked is None:
            return None
        if self._motion is not self._scheduler.arm.motion.planned:
            self.reset()
            return Reason(ReasonKind.PLAN_VOID, "tool", "was changed meanwhile")
        strayed = check_following(self._checked, self._robot, tick.q, tick.v, stamp)
        if strayed is None:
            return None
        self.reset()
        return Reason(ReasonKind.PLAN_VOID, strayed.subject, strayed.detail)

    def drop(self, subject: str, detail: str) -> Reason | None:
        """Forget the plan, whose proof rests on what is gone; None if there is no plan."""
        if self._checked is None:
            return None
        self.reset()
        return Reason(ReasonKind.PLAN_VOID, subject, detail)

    def rests(self, tick: Tick) -> bool:
        """Whether the arm, on its plan, rests before contact if it brakes after the next tick.

        That the whole piece was safe is not enough here: whatever else stops the arm early makes
        it brake elsewhere. Takes most of a millisecond, and is asked only where a STOP is near.
        """
        plan, motion = self._plan, self._motion
        if plan is None or motion is None:
            return False
        checked = check_plan(
            plan,
            self._robot,
            tick.now,
            tick.q,
            tick.v,
            tick.now - tick.arm_age,
            longest_lag=math.inf,
        )
        if isinstance(checked, Refusal) or plan.stamp > tick.now:
            return False
        course = motion.lay_out(checked, brake_after=self._response_time)
        return self._find_contact(motion, course, tick) is None

    def _find_contact(
        self, motion: PlannedMotion, course: PlannedCourse, tick: Tick
    ) -> PlanVerdict | None:
        """What could touch the arm on its course; None if nothing can."""
        scheduler = self._scheduler
        rest = course.epoch + float(course.end[-1])
        pairs = scheduler.near_pairs(tick, rest - tick.now)
        state = scheduler.arm.state
        found = motion.contact_time(
            course, pairs, tick.now, self._margin, state.bodies, state.refused_bodies, state.marks
        )
        if found.time == math.inf:
            return None
        link, obstacle = (None, None) if found.pair < 0 else scheduler.arm.names(found.pair)
        detail = f"contact possible in {found.time:.4g} s"
        reason = Reason(ReasonKind.PLAN_UNSAFE, f"{link} and {obstacle}", detail)
        return PlanVerdict(False, found.time, link, obstacle, (reason,))


def refuse_plan(subject: str, detail: str) -> PlanVerdict:
    """The verdict on a plan that cannot be judged, or not in the present situation."""
    return _find_fault(Reason(ReasonKind.PLAN_REFUSED, subject, detail))


def _find_fault(reason: Reason) -> PlanVerdict:
    return PlanVerdict(False, 0.0, None, None, (reason,))


def _own(plan: Plan) -> Plan:
    """A plan whose arrays no other code can change."""
    return Plan._make(field if field is None else np.array(field) for field in plan)._replace(
        stamp=float(plan.stamp)
    )
