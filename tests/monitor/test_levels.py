import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from armguard.monitor.levels import VerdictRule
from armguard.settings import Settings
from armguard.verdict import Level, Reason, ReasonKind

HOLD = 0.3
SLOW, AWARE = 0.1, 0.4
LATCHED = Reason(ReasonKind.TIME_BACKWARDS, "clock")


def make_rule(rise_delay=HOLD):
    return VerdictRule(Settings(slow_margin=SLOW, aware_margin=AWARE, rise_delay=rise_delay))


def decide(rule, now, contact_time, stop_time=1.0, *, complete=True, standing=False):
    earned = rule.grade(contact_time, stop_time)
    return rule.decide(now, earned, complete=complete, standing=standing)


def latch(rule, reason, since="0.000 s"):
    rule.latch(reason, since)


def test_grades_at_their_boundaries():
    rule, stop_time = make_rule(), 0.7
    borders = [0.7, 0.7 + SLOW, 0.7 + AWARE]
    for level, border in zip(Level, borders, strict=False):
        assert rule.grade(border, stop_time) is level
        assert rule.grade(math.nextafter(border, math.inf), stop_time) is Level(level + 1)
    assert rule.grade(0.0, 0.0) is Level.STOP
    assert rule.grade(math.inf, stop_time) is Level.CLEAR


@pytest.mark.parametrize(("contact_time", "stop_time"), [(math.nan, 1.0), (1.0, math.nan)])
def test_what_is_no_number_is_a_stop(contact_time, stop_time):
    assert make_rule().grade(contact_time, stop_time) is Level.STOP


def test_an_endless_stop_time_is_a_stop():
    assert make_rule().grade(math.inf, math.inf) is Level.STOP


def test_the_first_complete_verdict_stands_at_once():
    rule = make_rule()
    assert decide(rule, 0.0, 9.0, complete=False) == (Level.STOP, False)
    assert decide(rule, 0.001, 9.0) == (Level.CLEAR, False)


def test_levels_fall_at_once_and_rise_after_hold():
    rule = make_rule()
    assert decide(rule, 10.0, 9.0) == (Level.CLEAR, False)
    assert decide(rule, 10.1, 0.5) == (Level.STOP, False)
    assert decide(rule, 10.2, 9.0) == (Level.STOP, True)
    just_before = math.nextafter(10.1 + HOLD, 0.0)
    assert decide(rule, just_before - 1e-9, 9.0) == (Level.STOP, True)
    assert decide(rule, 10.1 + HOLD + 1e-9, 9.0) == (Level.CLEAR, False)


def test_hold_ends_exactly():
    rule = make_rule(rise_delay=0.25)
    decide(rule, 1.0, 0.5)
    assert decide(rule, math.nextafter(1.25, 0.0), 9.0) == (Level.STOP, True)
    assert decide(rule, 1.25, 9.0) == (Level.CLEAR, False)


def test_a_level_rises_step_by_step_as_older_evidence_expires():
    rule = make_rule()
    decide(rule, 0.0, 0.5)
    decide(rule, 0.1, 1.05)
    decide(rule, 0.2, 1.3)
    decide(rule, 0.25, 9.0)
    assert decide(rule, 0.299, 9.0) == (Level.STOP, True)
    assert decide(rule, 0.301, 9.0) == (Level.SLOW, True)
    assert decide(rule, 0.401, 9.0) == (Level.AWARE, True)
    assert decide(rule, 0.501, 9.0) == (Level.CLEAR, False)


def test_a_flicker_during_hold_starts_it_anew():
    rule = make_rule()
    decide(rule, 0.0, 0.5)
    decide(rule, 0.2, 0.5)
    assert decide(rule, 0.4, 9.0) == (Level.STOP, True)
    assert decide(rule, 0.51, 9.0)[0] is Level.CLEAR


@pytest.mark.parametrize("fault", [{"standing": True}, {"complete": False}])
def test_a_passing_fault_stops_and_is_held(fault):
    rule = make_rule()
    decide(rule, 0.0, 9.0)
    assert decide(rule, 0.1, 9.0, **fault) == (Level.STOP, False)
    assert decide(rule, 0.39, 9.0) == (Level.STOP, True)
    assert decide(rule, 0.41, 9.0) == (Level.CLEAR, False)


@pytest.mark.hazard("H-24")
@pytest.mark.parametrize("then", [1e6 + 0.001, 0.0, -50.0])
def test_a_latched_fault_stays_until_reset_and_then_there_must_be_evidence(then):
    """Time may start anew."""
    rule = make_rule()
    decide(rule, 0.0, 9.0)
    latch(rule, LATCHED)
    for now in (0.1, 5.0, 1e6):
        assert decide(rule, now, 9.0)[0] is Level.STOP
    rule.reset()
    assert decide(rule, then, 9.0) == (Level.STOP, True)
    assert decide(rule, then + 0.99 * HOLD, 9.0) == (Level.STOP, True)
    assert decide(rule, then + 1.01 * HOLD, 9.0) == (Level.CLEAR, False)


@pytest.mark.parametrize("then", [1e6 + 60.0, 0.0, -50.0])
def test_a_reset_asks_for_evidence_though_nothing_was_low_for_long(then):
    rule = make_rule()
    for now in (0.0, 5.0, 1e6):
        assert decide(rule, now, 9.0) == (Level.CLEAR, False)
    rule.reset()
    assert decide(rule, then, 9.0) == (Level.STOP, True)
    assert decide(rule, then + 0.99 * HOLD, 9.0) == (Level.STOP, True)
    assert decide(rule, then + 1.01 * HOLD, 9.0) == (Level.CLEAR, False)


def test_evidence_after_a_reset_is_counted_from_the_first_tick():
    """Whatever that tick saw; one that is not complete is no evidence either."""
    rule = make_rule()
    rule.reset()
    assert decide(rule, 5.0, 9.0, complete=False) == (Level.STOP, False)
    assert decide(rule, 5.1, 9.0, complete=False) == (Level.STOP, False)
    assert decide(rule, 5.1 + 0.99 * HOLD, 9.0) == (Level.STOP, True)
    assert decide(rule, 5.1 + 1.01 * HOLD, 9.0) == (Level.CLEAR, False)


def test_without_hold_a_reset_recovers_at_once():
    rule = make_rule(rise_delay=0.0)
    decide(rule, 0.0, 9.0)
    rule.reset()
    assert decide(rule, 0.0, 9.0) == (Level.CLEAR, False)


def test_a_latched_fault_before_the_first_verdict():
    rule = make_rule()
    latch(rule, LATCHED)
    assert decide(rule, 0.0, 9.0)[0] is Level.STOP
    rule.reset()
    assert decide(rule, 0.001, 9.0, complete=False)[0] is Level.STOP
    assert decide(rule, 0.002, 9.0, standing=True)[0] is Level.STOP
    assert decide(rule, 0.003, 9.0) == (Level.STOP, True)


def test_the_first_of_a_kind_is_kept():
    rule = make_rule()
    latch(rule, LATCHED, "1.000 s")
    latch(rule, Reason(ReasonKind.TIME_BACKWARDS, "joint states"), "2.000 s")
    latch(rule, Reason(ReasonKind.TIME_INVALID, detail="stamp nan"), "3.000 s")
    assert [reason.kind for reason in rule.latched.values()] == [
        ReasonKind.TIME_BACKWARDS,
        ReasonKind.TIME_INVALID,
    ]
    first, second = rule.latched.values()
    assert str(first) == f"{LATCHED.kind.text}: clock (latched since 1.000 s)"
    assert second.detail == "stamp nan; latched since 3.000 s"


events = st.lists(
    st.tuples(
        st.floats(0.0, 0.2),
        st.sampled_from([0.5, 1.05, 1.3, 9.0, math.inf, math.nan]),
        st.sampled_from(["none", "none", "none", "standing", "incomplete", "latch", "reset"]),
    ),
    max_size=40,
)


@given(events)
def test_the_level_is_the_lowest_of_the_last_hold(history):
    """Against the definition: a list of all raw levels, and what a latch and a reset mean."""
    rule = make_rule()
    now, raw, latched, settled = 0.0, [], False, False
    for wait, contact_time, event in history:
        now += wait
        if event == "latch":
            latch(rule, LATCHED)
            latched = True
        if event == "reset":
            rule.reset()
            raw, latched, settled = [(now, Level.STOP)], False, True
        complete, standing = event != "incomplete", event == "standing"
        level, held = decide(rule, now, contact_time, complete=complete, standing=standing)
        earned = rule.grade(contact_time, 1.0)
        if latched or standing or not complete:
            earned = Level.STOP
        settled = settled or (complete and not latched)
        if settled:
            raw.append((now, earned))
        expected = min((one for at, one in raw if now - at < HOLD or at == now), default=0)
        assert level == expected
        assert level <= earned
        assert held == (settled and level < earned)


@given(st.floats(0.0), st.floats(0.0), st.floats(0.0, 1e9))
def test_an_arm_that_rests_in_time_need_not_stop_and_gains_nothing_else(
    contact_time, stop_time, now
):
    rule = make_rule()
    without = rule.grade(contact_time, stop_time)
    rests = rule.grade(contact_time, stop_time, rests=True)
    assert rests is (Level.SLOW if without is Level.STOP else without)
    stop = Level.STOP, False
    assert make_rule().decide(now, rests, complete=True, standing=True) == stop
    assert make_rule().decide(now, rests, complete=False, standing=False) == stop
    assert make_rule().decide(now, rests, complete=True, standing=False) == (rests, False)


def test_a_held_level_keeps_what_began_it_and_says_when_it_may_rise():
    rule, one, other = (
        make_rule(),
        Reason(ReasonKind.CONTACT, "a and b"),
        Reason(ReasonKind.OVERDUE),
    )

    def go(now, contact_time, *reasons, standing=False):
        level, held = decide(rule, now, contact_time, standing=standing)
        rule.keep_cause(now, contact_time, 1.0, reasons)
        return rule.find_cause(level) if held else None

    assert go(10.0, 9.0) is None
    assert go(10.1, 0.5, one) is None
    # The same STOP goes on for another reason: the first one is what began it.
    assert go(10.2, 9.0, other, standing=True) is None
    held = go(10.3, 9.0)
    assert held == (one, 0.5, 1.0, 10.1, pytest.approx(10.2 + HOLD))
    assert decide(rule, held.rises_at + 1e-9, 9.0) == (Level.CLEAR, False)
    # Another STOP has a cause of its own.
    assert go(11.0, 9.0, other, standing=True) is None
    assert go(11.1, 9.0)[0] == other
    # A level that a lower one interrupted begins anew after that.
    for now, contact_time, reason in [(12.0, 1.04, one), (12.1, 0.5, one), (12.2, 1.05, other)]:
        go(now, contact_time, reason)
    go(12.4, 1.06, one)
    assert go(12.5, 9.0) == (other, 1.05, 1.0, 12.2, pytest.approx(12.4 + HOLD))
    rule.reset()
    assert go(0.0, 9.0) == (None, math.inf, math.inf, 0.0, HOLD)
    assert "reset; may rise in 0.3 s" in go(0.0, 9.0).describe(Level.STOP, 0.0)
