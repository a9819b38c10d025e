"""The answer to a plan that is refused."""

from __future__ import annotations

from armguard.verdict import PlanVerdict, Reason, ReasonKind


def refuse_plan(subject: str, detail: str) -> PlanVerdict:
    """The verdict on a plan that cannot be judged, or not in the present situation."""
    reason = Reason(ReasonKind.PLAN_REFUSED, subject, detail)
    return PlanVerdict(False, 0.0, None, None, (reason,))
