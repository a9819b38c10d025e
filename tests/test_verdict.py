import itertools

import pytest

from armguard.verdict import Effect, Level, Reason, ReasonKind, Verdict


def test_levels_are_ordered():
    assert list(Level) == [Level.STOP, Level.SLOW, Level.AWARE, Level.CLEAR]
    assert Level.STOP < Level.SLOW < Level.AWARE < Level.CLEAR


def test_every_reason_says_what_it_does():
    assert len({kind.text for kind in ReasonKind}) == len(ReasonKind)
    assert {kind.effect for kind in ReasonKind} == set(Effect)
    for kind, subject, detail in itertools.product(ReasonKind, ("", "cam"), ("", "3 > 2")):
        text = str(Reason(kind, subject, detail))
        assert all(part in text for part in (kind.text, subject, detail))


def test_a_verdict_is_frozen():
    verdict = Verdict(0.0, 1, Level.STOP, 0.0, 1.0, 0.0, None, None, False, 0, (), 0.003)
    with pytest.raises(AttributeError):
        verdict.level = Level.CLEAR
    assert (verdict.separation, verdict.certificate) == (None, None)
