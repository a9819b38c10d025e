import pytest

from armguard.monitor.plan_verdict import PlanVerdict, refuse_plan
from armguard.verdict import Effect, ReasonKind


def test_a_refusal_is_the_worst_that_there_is_to_say_and_names_its_reason():
    found = refuse_plan("q", "is not finite everywhere")
    assert found[:4] == (False, 0.0, None, None)
    (reason,) = found.reasons
    assert reason == (ReasonKind.PLAN_REFUSED, "q", "is not finite everywhere")
    assert reason.kind.effect is Effect.NOTE
    with pytest.raises(AttributeError):
        found.safe = True
    assert isinstance(found, PlanVerdict)
