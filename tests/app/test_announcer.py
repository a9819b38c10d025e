import re
import threading
import time

import pytest

from armguard.app.announcer import INTERVAL, QUEUE_LIMIT, Announcer
from armguard.verdict import Level, Reason, ReasonKind
from support.verdict_samples import verdict

GAP = Reason(ReasonKind.JOINT_STATE_GAP, "joint states", "0.2 s between two")
SILENT = Reason(ReasonKind.SOURCE_SILENT, "cam", "0.3 s")
HOLD = Reason(ReasonKind.HOLD)
CONTACT = Reason(ReasonKind.CONTACT, "hand and ball", "in 0.1 s")
PATIENCE = 20.0
CLEAR = verdict(Level.CLEAR)


def announce(*verdicts, **options):
    """Lines about verdicts, given as (now, verdict), without their times of day."""
    written = []
    with Announcer(write=written.append, **options) as announcer:
        announcer.remedy = "to end it: armguard reset"
        for now, one in verdicts:
            announcer.observe(now, one)
    return [re.sub(r"^armguard: \d\d:\d\d:\d\d\.\d{3} ", "", line) for line in written]


def stop(*reasons, **changes):
    return verdict(Level.STOP, reasons=reasons, **changes)


def test_each_change_of_level_is_told_with_its_weightiest_reasons():
    lines = announce(
        (0.0, stop(SILENT, CONTACT)),
        (1.0, stop(SILENT._replace(detail="1.3 s"), CONTACT)),
        (2.0, CLEAR),
        (3.0, CLEAR),
        (4.0, verdict(Level.SLOW, reasons=(CONTACT, HOLD, HOLD, HOLD, HOLD))),
        (5.0, verdict(Level.CLEAR, link=None)),
    )
    assert lines == [
        "STOP  source silent: cam (0.3 s); contact possible: hand and ball (in 0.1 s)\n",
        "CLEAR contact time 1 s\n",
        f"SLOW  {CONTACT}; {HOLD}; {HOLD}; 2 more reasons\n",
        "CLEAR no contact possible\n",
    ]


def test_contact_that_is_allowed_and_one_that_lasts_are_told():
    allowed = Reason(
        ReasonKind.CONTACT_ALLOWED,
        "panda_hand and left_hand",
        "at most 0.21 of 0.9 m/s (hand: a test)",
    )
    touched = Reason(ReasonKind.IN_CONTACT, "panda_hand and left_hand", "for 2.3 s")
    moved = Reason(ReasonKind.MOVED_BY_CONTACT, "panda_joint4", "by 0.02 rad")
    lines = announce(
        (0.0, verdict(Level.AWARE, reasons=(allowed,))), (1.0, stop(touched)), (2.0, stop(moved))
    )
    assert str(allowed).startswith("contact allowed: panda_hand and left_hand (at most 0.21 of 0.9")
    assert lines == [
        f"AWARE {allowed}\n",
        "STOP  in contact: panda_hand and left_hand (for 2.3 s)\n",
        "STOP  contact moved a joint: panda_joint4 (by 0.02 rad)\n",
    ]


def test_a_stop_of_another_cause_is_told_and_waiting_for_evidence_is_none():
    waiting = Reason(ReasonKind.NOT_YET_COMPLETE, "joints", "no joint state has arrived yet")
    lines = announce(
        (0.0, stop(waiting)),
        (1.0, stop(SILENT)),
        (2.0, stop(CONTACT)),
        (3.0, stop(HOLD)),
        (4.0, stop(CONTACT, HOLD)),
    )
    assert [line.split(":")[0] for line in lines] == [
        "STOP  not everything evaluated yet",
        "STOP  source silent",
        "STOP  contact possible",
    ]


def test_each_latch_is_told_once_with_its_remedy_until_it_is_reset():
    jump = Reason(ReasonKind.JOINT_STATE_JUMPED, "j1", "by a lot")
    lines = announce(
        (0.0, stop(GAP)),
        (1.0, stop(GAP)),
        (2.0, stop(GAP, jump)),
        (3.0, CLEAR),
        (4.0, stop(GAP)),
    )
    remedy = "to end it: armguard reset\n"
    assert [line for line in lines if line.startswith(("latched", "reset"))] == [
        f"latched: {GAP}; {remedy}",
        f"latched: {jump}; {remedy}",
        "reset: nothing is latched any more\n",
        f"latched: {GAP}; {remedy}",
    ]


def test_flutter_is_a_few_lines_a_second_that_hide_no_stop():
    flutter = [(0.001 * n, stop(CONTACT) if n % 2 else CLEAR) for n in range(10_001)]
    lines = announce(*flutter, (11.0, CLEAR))
    assert len(lines) <= 10.0 / INTERVAL + 2
    told = sum(int(more) for more in re.findall(r"\((\d+) more changes", "".join(lines)))
    assert told + len(lines) == 10_001
    assert "down to STOP: contact possible: hand and ball" in lines[-1]
    # A single short stop is told, too, and so is the level that stays.
    lines = announce((0.0, CLEAR), (0.1, stop(CONTACT)), (0.101, CLEAR), (0.5, CLEAR))
    assert len(lines) == 2
    assert lines[1].startswith("CLEAR")
    assert "down to STOP" in lines[1]


def test_latches_that_come_and_go_do_not_flood():
    lines = announce(*((0.001 * n, stop(GAP) if n % 2 else CLEAR) for n in range(10_000)))
    assert len(lines) < 4 * 10.0 / INTERVAL


def test_a_terminal_that_blocks_holds_up_nothing_and_what_was_lost_is_told():
    stuck, release = threading.Event(), threading.Event()
    written = []

    def write(text):
        stuck.set()
        assert release.wait(PATIENCE)
        written.append(text)

    with Announcer(write=write) as announcer:
        announcer.tell("first")
        assert stuck.wait(PATIENCE)
        for number in range(1000):
            announcer.tell(f"line {number}")
        assert announcer.dropped == 1000 - QUEUE_LIMIT
        release.set()
        end = time.monotonic() + PATIENCE
        while len(written) < QUEUE_LIMIT + 2:
            assert time.monotonic() < end
            time.sleep(0.01)
    assert written[0].endswith(" first\n")
    assert written[QUEUE_LIMIT].endswith(f" line {QUEUE_LIMIT - 1}\n")
    assert f"{1000 - QUEUE_LIMIT} lines were dropped" in written[-1]


def test_the_end_does_not_wait_for_a_terminal_that_stays_blocked():
    release = threading.Event()
    begin = time.monotonic()
    with Announcer(write=lambda text: release.wait(PATIENCE)) as announcer:
        announcer.tell("first")
    assert time.monotonic() - begin < PATIENCE / 2
    release.set()


@pytest.mark.parametrize("text", ["\x1b[2J" * 1000, "two\nlines"])
def test_names_from_outside_cannot_write_on_the_terminal_as_they_like(text):
    (line,) = announce((0.0, stop(SILENT._replace(subject=text))))
    assert line[:-1].isprintable()
    assert len(line) < 1200


def test_a_quiet_one_tells_only_what_it_is_told_to():
    assert announce((0.0, stop(GAP)), (1.0, CLEAR), quiet=True) == []
    written = []
    with Announcer(quiet=True, write=written.append, wall_clock=lambda: 0.25) as announcer:
        announcer.tell("a fault")
    (line,) = written
    assert re.fullmatch(r"armguard: \d\d:\d\d:00\.250 a fault\n", line)
