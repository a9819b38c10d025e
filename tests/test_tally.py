import math

from armguard.tally import REASON_LIMIT, Tally
from armguard.verdict import Level, Reason, ReasonKind
from support.verdict_samples import verdict


def count(*verdicts):
    tally = Tally()
    for one in verdicts:
        tally.count(one)
    return tally


def test_every_tick_is_counted_once():
    levels = [Level.STOP, Level.SLOW, Level.STOP, Level.CLEAR, Level.CLEAR]
    tally = count(*map(verdict, levels))
    assert tally.levels == {Level.STOP: 2, Level.SLOW: 1, Level.AWARE: 0, Level.CLEAR: 2}
    assert sum(tally.levels.values()) == len(levels)


def test_a_stop_is_a_fall_to_it_and_a_beginning_with_it():
    stop, clear = verdict(Level.STOP), verdict(Level.CLEAR)
    assert count(clear, clear).stops == 0
    assert count(stop, stop).stops == 1
    assert count(stop, clear, stop, stop, clear, stop).stops == 3


def test_ticks_without_any_joint_state_count_only_as_waiting():
    waiting = verdict(Level.STOP, 0.0, sequence=0, link=None, complete=False)
    tally = count(waiting, waiting, verdict(Level.CLEAR))
    assert tally.waiting == 2
    assert tally.stops == tally.incomplete == tally.levels[Level.STOP] == 0
    assert tally.min_contact_time == 1.0


def test_the_soonest_contact_is_of_a_pair():
    assert count().min_contact_time == math.inf
    unknown = verdict(Level.STOP, 0.0, link=None, complete=False)
    tally = count(verdict(Level.CLEAR, math.inf, link=None), unknown, verdict(Level.SLOW, 0.25))
    assert tally.min_contact_time == 0.25
    assert tally.incomplete == 1


def test_stops_are_counted_by_their_weightiest_reason():
    silent = Reason(ReasonKind.SOURCE_SILENT, "cam", "0.3 s")
    later = silent._replace(detail="0.4 s")
    contact = Reason(ReasonKind.CONTACT, "hand and ball", "in 0.1 s")
    hold = Reason(ReasonKind.HOLD)
    stops = [(silent, contact), (later,), (later, hold), (hold, contact), ()]
    clear = verdict(Level.CLEAR)
    tally = Tally()
    for reasons in stops:
        for one in (verdict(Level.STOP, reasons=reasons), verdict(Level.STOP), clear):
            tally.count(one)
    assert tally.reasons == {
        "source silent: cam": 3,
        "contact possible: hand and ball": 1,
        "no reason": 1,
    }
    assert tally.reasons.total() == tally.stops


def test_names_made_up_from_outside_neither_fill_the_memory_nor_move_the_cursor():
    tally = Tally()
    for number in range(1000):
        reason = Reason(ReasonKind.SOURCE_SILENT, f"\x1b[2J{number}" + "x" * 10_000)
        tally.count(verdict(Level.STOP, reasons=(reason,)))
        tally.count(verdict(Level.CLEAR))
    assert len(tally.reasons) == REASON_LIMIT + 1
    assert tally.reasons["other reasons"] == 1000 - REASON_LIMIT
    assert all(reason.isprintable() and len(reason) < 300 for reason in tally.reasons)


def test_ticks_that_knew_nothing_have_no_contact():
    silent = Reason(ReasonKind.SOURCE_SILENT, "cam")
    contact = Reason(ReasonKind.CONTACT, "hand and ball")
    # Where a source was silent for long, its obstacle could be anywhere.
    tally = count(verdict(Level.STOP, 0.0, reasons=(silent, contact)))
    assert tally.min_contact_time == math.inf
    assert count(verdict(Level.STOP, 0.0, complete=False)).min_contact_time == math.inf
    assert count(verdict(Level.STOP, math.nan, link=None)).min_contact_time == math.inf
    # Touching is a contact, and so is what is possible soon, whatever else is wrong.
    assert count(verdict(Level.STOP, 0.0, reasons=(contact,))).min_contact_time == 0.0
    assert count(verdict(Level.STOP, 0.1, reasons=(silent,))).min_contact_time == 0.1
