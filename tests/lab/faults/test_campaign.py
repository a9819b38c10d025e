"""The campaign in its short form: the worst of its faults, against real processes."""

import time

import numpy as np
import pytest

from armguard.lab.faults import campaign
from armguard.lab.faults.campaign import Trial, make_trial, place_bodies, run_campaign
from armguard.lab.faults.catalogue import DEFAULT_DURATION, Fault, choose_faults
from armguard.lab.faults.listening import VerdictChange
from armguard.lab.faults.scene import sample_people, sample_pillar
from armguard.verdict import Level, Reason, ReasonKind

CROWD = Fault("crowd", "camera", "disturb", kind="crowd", duration=0.0)
EXCHANGED, KILLED = choose_faults(["camera-identities-swapped", "monitor-killed"])
WORST = [EXCHANGED._replace(duration=DEFAULT_DURATION), KILLED]
"""Data that are sound and wrong, and no monitor at all until a new one starts."""


@pytest.mark.hazard("H-07", "H-14")
def test_exchanged_people_and_a_killed_monitor_are_noticed_and_nobody_is_touched():
    told = []
    report = run_campaign(WORST, lambda text, done: told.append((text, done)))
    assert [outcome.problem for outcome in report.outcomes] == [""] * len(WORST)
    assert [outcome.fault for outcome in report.outcomes] == WORST
    assert report.whole.contacts == 0
    assert report.whole.distance > 0.0
    assert all(outcome.ignoring.contacts for outcome in report.outcomes), "the control is hit"
    first, second = report.replayed  # the monitor was killed once
    assert first.identical
    assert second.identical
    assert min(first.compared, second.compared) > 100
    assert (first.lost, second.lost) == (0, 0)
    assert report.passed
    names = [text.partition(",")[0] for text, _ in told]
    assert names == ["starting", *(fault.name for fault in WORST), "judging", "replaying"]


class StoppedCell:
    """A cell in which joint states are amiss, too, from a fault's end until a reset; its own log of
    verdicts."""

    def __init__(self, *latched):
        self.start = time.monotonic()
        self.verdicts = self
        self.heard = [VerdictChange(0.0, Level.CLEAR, ())]
        self._latched = latched

    @property
    def last_time(self):
        return time.monotonic()

    def is_sound(self, now, patience):
        return not self.heard[-1].reasons

    def check(self):
        """Nothing has ended."""

    def strike(self, fault, begin):
        reasons = tuple(Reason(kind) for kind in self._latched)
        return lambda: self.heard.append(VerdictChange(time.monotonic(), Level.STOP, reasons))

    def is_moving(self):
        return True

    def reset(self):
        self.heard.append(VerdictChange(time.monotonic(), Level.CLEAR, ()))


def test_a_reset_of_what_is_no_sign_of_a_fault_says_what_it_was_for():
    fault = Fault("jumps", "driver", "kill", ("JOINT_STATE_JUMPED",), duration=0.0)
    latched = (ReasonKind.JOINT_STATE_GAP, ReasonKind.JOINT_STATE_JUMPED)
    trial = make_trial(StoppedCell(*latched), fault, 0.3)
    assert (trial.resets, trial.foreign) == (1, ("gap in joint states",))
    trial = make_trial(StoppedCell(*latched[1:]), fault, 0.3)
    assert (trial.resets, trial.foreign) == (1, ())


class SlowCell(StoppedCell):
    """A cell on a machine that needs long for everything, in simulated time."""

    def __init__(self, monkeypatch, *, sound_from=0.0, moves_from=0.0):
        self.now = 0.0
        monkeypatch.setattr(campaign, "time", self)
        super().__init__()
        self.start, self.struck_at = 0.0, None
        self._sound_from, self._moves_from = sound_from, moves_from

    def monotonic(self):
        return self.now

    def sleep(self, duration):
        self.now += duration

    @property
    def last_time(self):
        return self.now

    def is_sound(self, now, patience):
        return now >= self._sound_from

    def is_moving(self):
        return self.now >= self._moves_from

    def strike(self, fault, begin):
        self.struck_at = begin
        return self.end

    def end(self):
        self._sound_from, self._moves_from = self.now + 20.0, self.now + 90.0


def test_a_slow_machine_is_waited_for_before_and_after_a_fault(monkeypatch):
    cell = SlowCell(monkeypatch, sound_from=30.0, moves_from=70.0)
    trial = make_trial(cell, CROWD, 4.0)
    assert 70.0 < trial.begin == cell.struck_at < 70.0 + 2 * 4.0
    assert trial.was_tried
    assert trial.sound - trial.end == pytest.approx(20.0, abs=0.1)
    assert cell.is_moving(), "or the next fault would begin before the arm was seen at work"


@pytest.mark.parametrize("missing", [{"sound_from": np.inf}, {"moves_from": np.inf}])
def test_what_cannot_be_tried_is_no_failure_of_the_monitor(missing, monkeypatch):
    cell = SlowCell(monkeypatch, **missing)
    trial = make_trial(cell, CROWD, 4.0)
    assert cell.struck_at is None
    assert not trial.was_tried
    assert cell.now <= campaign.PATIENCE + 4.0, "it comes to an end"


def test_a_thing_that_drifts_is_there_while_its_fault_lasts():
    fault = Fault("drifting", "camera", "disturb", kind="static", duration=2.0)
    trial = Trial(fault, 10.0, 12.0, None, 0)
    people = sample_people(4.0, 4.0)[0]
    assert place_bodies(trial, 5.0, 4.0, 9.0).tolist() == people.tolist()
    found = place_bodies(trial, 5.0, 4.0, 11.0)
    assert found[2:].tolist() == sample_pillar(1.0)[0].tolist()
    assert len(place_bodies(trial, 5.0, 4.0, 12.1)) == 2
