import pytest

from armguard.lab.extremes import ticks
from armguard.lab.extremes.report import REFUSED, SOUND, UNSOUND
from armguard.lab.extremes.ticks import list_cases

LONG = {
    ("obstacles", "10,000"), ("obstacles", "100,000"), ("spheres a link", "512"), ("joints", "10"),
    ("spheres a link", "216"), ("joints", "7"), ("joints", "14"),
}  # fmt: skip


@pytest.fixture(scope="module")
def lines():
    lines = [case.measure(0) for case in list_cases() if (case.group, case.name) not in LONG]
    return {(line.group, line.case): line for line in lines}


def test_no_tick_says_more_than_an_adversary_allows(lines):
    assert {line.outcome for line in lines.values()} == {SOUND, REFUSED}
    compared = [line.tight for line in lines.values() if line.tight == line.tight]
    assert len(compared) > 10
    assert all(0.0 <= tight <= 1.0 for tight in compared)


@pytest.mark.parametrize(
    ("case", "why"),
    [
        (("rate", "1 Hz"), "brakes not stated for such speeds: panda_joint"),
        (("bounds in a tick", "1e6 m/s², 1e6 m/s"), "beyond what bodies do"),
        (("coordinates", "1e6 m, as tables are"), "extent"),
        (("age in a tick", "1 s"), "source silent"),
    ],
)
def test_what_is_refused_says_why(case, why, lines):
    assert lines[case].outcome == REFUSED
    assert why in lines[case].note


def test_what_is_far_from_zero_says_what_it_says_near_it(lines):
    near = lines["stamps", "since 1970"]
    assert near.tight == pytest.approx(lines["coordinates", "1e6 m, extent=2e6"].tight, rel=1e-3)
    assert near.tight == pytest.approx(lines["stamps", "1e12 s"].tight, rel=1e-2)


def test_what_says_too_much_is_found_out(monkeypatch):
    monkeypatch.setattr(ticks, "_hunt", lambda *given: 1e-6)
    (case,) = (one for one in list_cases() if one.name == "1000 Hz")
    assert case.measure(0).outcome == UNSOUND
