import json
import math
import re

import pytest

from armguard.app.loop import LoopReport, Spread
from armguard.app.realtime import Realtime
from armguard.app.summary import REASON_LIMIT, VerdictCounts, draw_summary, summarise
from armguard.app.terminal import make_console
from armguard.verdict import Level, Reason, ReasonKind
from support.verdict_samples import verdict


def make_report(**changes):
    fields = {
        "ticks": 12,
        "late": 1,
        "missed": 2,
        "tick": Spread(20e-6, 1e-3, 2e-3, 3e-3),
        "drain": Spread(8e-6, 5e-4, 1e-3, 2e-3),
        "step": Spread(7e-6, 4e-4, 9e-4, 1e-3),
        "publish": Spread(5e-6, 1e-4, 2e-4, 4e-4),
        "received": 5,
        "faults": {"malformed: cam0": 3},
        "monitor_faults": 4,
    }
    return LoopReport(**(fields | changes))


def test_programs_find_every_key_and_strict_json():
    summary = summarise(make_report(), VerdictCounts())
    expected = {"ticks", "stops", "levels", "min_contact_time", "tick_us", "incomplete", "faults"}
    assert expected <= set(summary)
    for part in ("tick_us", "drain_us", "step_us", "publish_us"):
        assert list(summary[part]) == ["p50", "p99", "p99.9", "max"]
    assert summary["step_us"] == {"p50": 7.0, "p99": 400.0, "p99.9": 900.0, "max": 1000.0}
    assert summary["min_contact_time"] is None
    assert json.loads(json.dumps(summary, allow_nan=False)) == summary


def test_a_run_without_joint_states_was_a_stop_all_the_time():
    counts = VerdictCounts()
    counts.waiting = 12
    shown = show(summarise(make_report(), counts), 80)
    assert "%" not in shown
    assert "all the time: no usable joint state arrived" in shown
    assert "none possible" not in shown


def test_stops_are_listed_with_their_reasons_the_most_frequent_first():
    counts = VerdictCounts()
    counts.stops = 13
    counts.reasons.update({"gap in joint states": 1, "source silent: [bold]cam": 9})
    counts.reasons.update({f"obstacle refused: {n}": 1 for n in range(10)})
    summary = summarise(make_report(), counts)
    assert next(iter(summary["stop_reasons"].items())) == ("source silent: [bold]cam", 9)
    assert len(summary["stop_reasons"]) == 12
    shown = show(summary, 80)
    assert "9 × source silent: [bold]cam" in shown
    assert "4 × 4 further reasons" in shown
    assert shown.index("9 ×") < shown.index("1 × gap in joint states")


def test_a_run_without_a_single_tick_has_a_summary():
    nothing = make_report(ticks=0, tick=Spread(math.nan, math.nan, math.nan, 0.0))
    summary = summarise(nothing, VerdictCounts())
    assert summary["tick_us"] == {"p50": None, "p99": None, "p99.9": None, "max": 0.0}
    assert json.loads(json.dumps(summary, allow_nan=False)) == summary
    assert "ticks" in show(summary, 80)


@pytest.mark.parametrize(
    ("granted", "words"),
    [
        (None, "not asked for"),
        (Realtime(10, True, ()), "scheduled with priority 10, memory locked"),
        (Realtime(0, True, ("no",)), "scheduling refused, memory locked"),
        (Realtime(10, False, ("no",)), "scheduled with priority 10, memory not locked"),
    ],
)
def test_what_the_system_granted_is_told(granted, words):
    summary = summarise(make_report(realtime=granted), VerdictCounts())
    known = granted and {"priority": granted.priority, "memory_locked": granted.memory_locked}
    assert summary["realtime"] == known
    assert words in show(summary, 80)


@pytest.mark.parametrize("width", [40, 80, 200])
def test_people_see_it_whole_at_any_width(width):
    counts = VerdictCounts()
    counts.min_contact_time = 0.125
    shown = show(summarise(make_report(), counts), width)
    assert "0.125 s" in shown
    assert all(level.name in shown for level in Level)
    assert max(map(len, shown.splitlines())) <= width
    assert "\x1b" not in shown


def show(summary, width):
    console = make_console()
    console.width = width
    with console.capture() as capture:
        console.print(draw_summary(summary))
    return capture.get()


def count(*verdicts):
    counts = VerdictCounts()
    for one in verdicts:
        counts.count(one)
    return counts


def test_a_stop_is_a_fall_to_it_and_a_beginning_with_it():
    stop, clear = verdict(Level.STOP), verdict(Level.CLEAR)
    assert count(clear, clear).stops == 0
    assert count(stop, stop).stops == 1
    assert count(stop, clear, stop, stop, clear, stop).stops == 3


def test_ticks_without_any_joint_state_count_only_as_waiting():
    waiting = verdict(Level.STOP, 0.0, sequence=0, link=None, complete=False)
    counts = count(waiting, waiting, verdict(Level.CLEAR))
    assert counts.waiting == 2
    assert counts.stops == counts.incomplete == counts.levels[Level.STOP] == 0
    assert counts.min_contact_time == 1.0


def test_the_soonest_contact_is_of_a_pair():
    assert count().min_contact_time == math.inf
    unknown = verdict(Level.STOP, 0.0, link=None, complete=False)
    clear, slow = verdict(Level.CLEAR, math.inf, link=None), verdict(Level.SLOW, 0.25)
    counts = count(clear, unknown, unknown, slow, unknown)
    assert counts.min_contact_time == 0.25
    assert counts.incomplete == 2, "how often it began"


def test_stops_are_counted_by_their_weightiest_reason():
    silent = Reason(ReasonKind.SOURCE_SILENT, "cam", "0.3 s")
    later = silent._replace(detail="0.4 s")
    contact = Reason(ReasonKind.CONTACT, "hand and ball", "in 0.1 s")
    hold = Reason(ReasonKind.HOLD)
    stops = [(silent, contact), (later,), (later, hold), (hold, contact), ()]
    clear = verdict(Level.CLEAR)
    counts = VerdictCounts()
    for reasons in stops:
        for one in (verdict(Level.STOP, reasons=reasons), verdict(Level.STOP), clear):
            counts.count(one)
    assert counts.reasons == {
        "source silent: cam": 3,
        "contact possible: hand and ball": 1,
        "no reason": 1,
    }
    assert counts.reasons.total() == counts.stops


def test_notes_are_no_reason_of_a_stop_and_late_data_are_told_apart_from_nearness():
    note = Reason(ReasonKind.OBSTACLE_REFUSED, "ball")
    contact = Reason(ReasonKind.CONTACT, "hand and ball", "in 0.1 s")
    late = Reason(ReasonKind.LATE_DATA, "camera", "182 ms old, usually 10 ms")
    unknown = late._replace(kind=ReasonKind.LATE_DATA_UNKNOWN)
    counts = VerdictCounts()
    for reasons in ((note, contact), (contact, late), (note, unknown, contact), (late, contact)):
        counts.count(verdict(Level.STOP, reasons=reasons))
        counts.count(verdict(Level.CLEAR))
    assert counts.reasons == {
        "contact possible: hand and ball": 1,
        "late data: camera": 2,
        "late data, effect unknown: camera": 1,
    }


def test_names_made_up_from_outside_neither_fill_the_memory_nor_move_the_cursor():
    counts = VerdictCounts()
    for number in range(1000):
        reason = Reason(ReasonKind.SOURCE_SILENT, f"\x1b[2J{number}" + "x" * 10_000)
        counts.count(verdict(Level.STOP, reasons=(reason,)))
        counts.count(verdict(Level.CLEAR))
    assert len(counts.reasons) == REASON_LIMIT + 1
    assert counts.reasons["other reasons"] == 1000 - REASON_LIMIT
    assert all(reason.isprintable() and len(reason) < 300 for reason in counts.reasons)


def test_ticks_that_knew_nothing_have_no_contact():
    silent = Reason(ReasonKind.SOURCE_SILENT, "cam")
    contact = Reason(ReasonKind.CONTACT, "hand and ball")
    # Where a source was silent for long, its obstacle could be anywhere.
    counts = count(verdict(Level.STOP, 0.0, reasons=(silent, contact)))
    assert counts.min_contact_time == math.inf
    assert count(verdict(Level.STOP, 0.0, complete=False)).min_contact_time == math.inf
    assert count(verdict(Level.STOP, math.nan, link=None)).min_contact_time == math.inf
    # Touching is a contact, and so is what is possible soon, whatever else is wrong.
    assert count(verdict(Level.STOP, 0.0, reasons=(contact,))).min_contact_time == 0.0
    assert count(verdict(Level.STOP, 0.1, reasons=(silent,))).min_contact_time == 0.1
    touched = Reason(ReasonKind.IN_CONTACT, "hand and left_hand", "for 2.3 s")
    assert count(verdict(Level.STOP, 0.0, reasons=(touched, contact))).min_contact_time == 0.0


def test_what_contact_limits_permitted_is_told_only_where_they_are_stated():
    summary = summarise(make_report(), count(verdict(Level.AWARE, 0.1, harm_time=0.1)))
    assert summary["contact_limits"] is None
    assert "contact allowed" not in show(summary, 80)
    allowed = Reason(ReasonKind.CONTACT_ALLOWED, "hand and left_hand", "at most 0.21 of 0.9 m/s")
    permitted = verdict(
        Level.AWARE, 0.1, harm_time=0.5, contact_speed=0.21, reasons=(allowed,), stamp=1.0
    )
    far = verdict(Level.CLEAR, 2.0, harm_time=2.0, contact_speed=0.0)
    summary = summarise(make_report(), count(permitted, far, far, far))
    assert summary["contact_limits"] == {
        "ticks": 1,
        "min_harm_time": 0.5,
        "max_contact_speed": 0.21,
    }
    shown = show(summary, 80)
    assert re.search(r"soonest contact *│ 0\.100 s", shown)
    assert re.search(r"soonest harm *│ 0\.500 s", shown)
    assert re.search(r"contact allowed *│ .* % of the time, at most 0\.21 m/s", shown)
    unproved = permitted._replace(contact_speed=math.inf, harm_time=math.inf)
    summary = summarise(make_report(), count(unproved))
    assert summary["contact_limits"] == {
        "ticks": 1,
        "min_harm_time": None,
        "max_contact_speed": None,
    }
    assert "speed unknown" in show(summary, 80)
    json.dumps(summary, allow_nan=False)
    assert "never possible" in show(summarise(make_report(), count(far)), 80)
