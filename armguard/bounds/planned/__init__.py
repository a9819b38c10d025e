"""An arm that follows a plan: plans, their check, and the bound on the arm's motion."""

from armguard.bounds.planned.check import check_plan
from armguard.bounds.planned.motion import PlannedMotion
from armguard.bounds.planned.plan import CheckedPlan, Plan, Refusal
from armguard.bounds.planned.slabs import PathClock
from armguard.bounds.planned.stop import append_stop

__all__ = [
    "CheckedPlan",
    "PathClock",
    "Plan",
    "PlannedMotion",
    "Refusal",
    "append_stop",
    "check_plan",
]
