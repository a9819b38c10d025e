"""The answer to a plan, and what could touch an arm on its course."""

from __future__ import annotations

import math
from typing import NamedTuple

from armguard.bounds.planned.course import PlannedCourse
from armguard.bounds.planned.motion import PlannedMotion
from armguard.jit.arrays import IntArray
from armguard.scheduling.scheduler import Scheduler, Tick
from armguard.verdict import PlanVerdict, Reason, ReasonKind


def refuse_plan(subject: str, detail: str) -> PlanVerdict:
    """The verdict on a plan that cannot be judged, or not in the present situation."""
    reason = Reason(ReasonKind.PLAN_REFUSED, subject, detail)
    return PlanVerdict(False, 0.0, None, None, (reason,))


class CourseContact(NamedTuple):
    """What could touch an arm on its course first."""

    time: float
    """In [s] from now; inf: nothing before it rests."""
    link: str | None
    obstacle: str | None
    evaluated: int
    """Evaluations spent."""


def find_course_contact(
    scheduler: Scheduler,
    motion: PlannedMotion,
    course: PlannedCourse,
    pairs: IntArray,
    tick: Tick,
    margin: float,
) -> CourseContact:
    """What could touch an arm that is on a course.

    Args:
        scheduler: Knows the obstacles.
        motion: That laid out the course.
        course: Where the arm can be.
        pairs: Row × links + link, of all that may be near. Shape (m,).
        tick: The present one.
        margin: Distance that counts as contact already, in [m].
    """
    state = scheduler.arm.state
    found = motion.contact_time(
        course, pairs, tick.now, margin, state.bodies, state.refused_bodies, state.marks
    )
    if found.time == math.inf:
        return CourseContact(math.inf, None, None, found.evaluated)
    if found.pair < 0:
        return CourseContact(found.time, None, None, found.evaluated)
    link, obstacle = scheduler.arm.names(found.pair)
    return CourseContact(found.time, link, obstacle, found.evaluated)
