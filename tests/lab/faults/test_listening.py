import time

import pytest

from armguard.lab.faults.listening import VerdictLog
from armguard.streams import VerdictPublisher
from armguard.verdict import Level, Reason, ReasonKind
from support.verdict_samples import verdict
from support.waiting import wait_until

PATIENCE = 20.0
SILENT = Reason(ReasonKind.SOURCE_SILENT, "camera")
GAP = Reason(ReasonKind.JOINT_STATE_GAP, "joint states")
NEAR = Reason(ReasonKind.CONTACT, "hand", "left")


@pytest.fixture
def wire(tmp_path):
    """Verdicts that are published, and what is heard of them."""
    publisher = VerdictPublisher(f"ipc://{tmp_path}/verdicts", 0.0)
    with VerdictLog(publisher.address) as log:
        wait_until(lambda: say(publisher) or log.heard)
        yield publisher, log
    publisher.close()


def say(publisher, level=Level.CLEAR, **changes):
    publisher.publish(verdict(level, **changes))


def test_verdicts_are_kept_where_they_change(wire):
    publisher, log = wire
    count = len(log.heard)
    sequence = 1
    for level, reasons in (
        (Level.CLEAR, ()),
        (Level.CLEAR, ()),
        (Level.SLOW, (NEAR,)),
        (Level.STOP, (NEAR, SILENT)),
        (Level.STOP, (SILENT,)),
    ):
        sequence += 1
        say(publisher, sequence=sequence, level=level, reasons=reasons)
    wait_until(lambda: len(log.heard) >= count + 2 and log.heard[-1].kinds)
    levels = [(one.level, one.kinds) for one in log.heard[-3:]]
    assert levels == [
        (Level.CLEAR, frozenset()),
        (Level.SLOW, frozenset()),
        (Level.STOP, {ReasonKind.SOURCE_SILENT}),
    ], "contacts are no fault"
    assert log.heard[-1].reasons == (SILENT,)
    now = time.monotonic()
    assert not log.is_sound(now, PATIENCE)
    say(publisher, sequence=sequence + 1, level=Level.SLOW, reasons=(NEAR,))
    wait_until(lambda: log.is_sound(time.monotonic(), PATIENCE))
    say(publisher, sequence=sequence + 2, level=Level.STOP, reasons=(GAP, NEAR, SILENT))
    wait_until(lambda: log.heard[-1].kinds)
    assert log.heard[-1].reasons == (GAP, SILENT), "all of them, the weightiest first"
    assert not log.is_sound(log.last_time + 1.0, 0.5), "silence is not sound"


def test_what_was_not_heard_is_counted(wire):
    publisher, log = wire
    before = sum(count for _, count in log.missing)
    say(publisher, sequence=2)
    say(publisher, sequence=12)
    wait_until(lambda: sum(count for _, count in log.missing) == before + 9)
    say(publisher, sequence=1, level=Level.SLOW)  # a monitor that was started anew
    wait_until(lambda: log.heard[-1].level is Level.SLOW)
    assert sum(count for _, count in log.missing) == before + 9
