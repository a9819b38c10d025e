"""An arm that follows a plan: plans, their check, and the bound on the arm's motion."""

from armguard.bounds.planned.check import CheckedPlan, check_plan
from armguard.bounds.planned.motion import PlannedMotion
from armguard.bounds.planned.plan import Plan, Refusal

__all__ = [
    "CheckedPlan",
    "Plan",
    "PlannedMotion",
    "Refusal",
    "check_plan",
]
