import itertools

import pytest

from armguard.verdict import (
    Effect,
    Level,
    Reason,
    ReasonKind,
    Verdict,
    find_weightiest,
    sort_reasons,
)


def test_levels_are_ordered():
    assert list(Level) == [Level.STOP, Level.SLOW, Level.AWARE, Level.CLEAR]
    assert Level.STOP < Level.SLOW < Level.AWARE < Level.CLEAR


def test_every_reason_says_what_it_does():
    assert len({kind.text for kind in ReasonKind}) == len(ReasonKind)
    assert {kind.effect for kind in ReasonKind} == set(Effect)
    for kind, subject, detail in itertools.product(ReasonKind, ("", "cam"), ("", "3 > 2")):
        text = str(Reason(kind, subject, detail))
        assert all(part in text for part in (kind.text, subject, detail))


def test_the_weightiest_reason_is_what_latches_and_last_of_all_a_note():
    kinds = [
        ReasonKind.JOINT_STATE_GAP,
        ReasonKind.HOLD,
        ReasonKind.SOURCE_SILENT,
        ReasonKind.LATE_DATA,
        ReasonKind.LATE_DATA_UNKNOWN,
        ReasonKind.CONTACT_FORBIDDEN,
        ReasonKind.CONTACT,
        ReasonKind.CONTACT_ALLOWED,
        ReasonKind.OBSTACLE_REFUSED,
        ReasonKind.NO_SOURCES_EXPECTED,
    ]
    in_order = [Reason(kind) for kind in kinds]
    # The two notes weigh the same, and stay in their order.
    for turn in range(8):
        reasons = [*in_order[turn:8], *in_order[:turn], *in_order[8:]]
        sort_reasons(reasons)
        assert reasons == in_order
    assert find_weightiest(reversed(in_order)) == in_order[0]
    for first in range(1, len(kinds)):
        assert find_weightiest(in_order[first:]) == in_order[max(first, 2)]
    assert find_weightiest([Reason(ReasonKind.HOLD)]) is None


def test_a_verdict_tells_the_time_of_harm_where_contact_limits_are_stated():
    verdict = Verdict(0.0, 1, Level.AWARE, 0.05, 0.1, 1.0, None, None, True, 0, (), 0.003)
    for harm_time in (0.05, 0.5):
        told = str(verdict._replace(harm_time=harm_time))
        assert "contact time 0.050 s, stop time 0.100 s" in told
    told = str(verdict._replace(harm_time=0.5, contact_speed=0.0))
    assert "contact time 0.050 s, harm time 0.500 s, stop time 0.100 s" in told


def test_a_verdict_tells_until_when_the_piece_is_proved_that_it_rests_on():
    verdict = Verdict(0.0, 1, Level.AWARE, 0.05, 0.1, 1.0, None, None, True, 0, (), 0.003)
    assert "proved" not in str(verdict)
    assert str(verdict._replace(proved_until=2.5)).endswith("speed 100 %, proved until 2.500 s")


def test_a_verdict_is_frozen():
    verdict = Verdict(0.0, 1, Level.STOP, 0.0, 1.0, 0.0, None, None, False, 0, (), 0.003)
    with pytest.raises(AttributeError):
        verdict.level = Level.CLEAR
    assert (verdict.separation, verdict.certificate) == (None, None)
