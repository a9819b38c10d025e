import pytest

from armguard.messages.reasons import ReasonMessage, read_reasons, write_reasons
from armguard.verdict import Reason, ReasonKind


def test_reasons_of_every_kind_are_read_as_they_were_written():
    reasons = tuple(Reason(kind, "hand", f"number {kind}") for kind in ReasonKind)
    assert read_reasons(write_reasons(reasons)) == reasons


def test_a_kind_that_is_unknown_is_an_error():
    with pytest.raises(ValueError, match="mood"):
        read_reasons([ReasonMessage("mood", "", "")])
