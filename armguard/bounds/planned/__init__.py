"""An arm that follows a plan: plans, their check, and the bound on the arm's motion."""

from armguard.bounds.planned.check import check_plan
from armguard.bounds.planned.motion import PlannedMotion
from armguard.bounds.planned.plan import CheckedPlan, Plan, Refusal
from armguard.bounds.planned.stop import append_stop, stop_on_path

__all__ = [
    "CheckedPlan",
    "Plan",
    "PlannedMotion",
    "Refusal",
    "append_stop",
    "check_plan",
    "stop_on_path",
]
