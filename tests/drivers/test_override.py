"""Laws of an override, with an arm and verdicts that a test can hold in its hands."""

import os

import msgspec
import pytest

from armguard.drivers.arm import ArmState, Program
from armguard.drivers.latencies import Latencies
from armguard.drivers.link import Link
from armguard.drivers.measurement import Measurement
from armguard.drivers.moment import Moment
from armguard.drivers.override import REPEAT, OverrideConduct
from armguard.drivers.session import Session
from armguard.verdict import Level
from support.driven_cell import OPTIONS
from support.verdict_samples import verdict

VALIDITY = 0.02


class Made:
    """A conduct, what its arm was told, and time that a test sets."""

    def __init__(self, *, can_brake=True, measurement=None, acknowledgement="nod", **options):
        self.now, self.sequence, self.verdict = 100.0, 0, None
        self.sent, self.reports, self.braked = [], [], []
        self.can_brake, self.v = can_brake, 0.5
        self.acknowledgement, self.is_acknowledged = acknowledgement, False
        self._reading, writing = os.pipe()
        self.latencies = Latencies(0.0)
        replaced = msgspec.structs.replace(OPTIONS, stop_within=0.5, **options)
        session = Session(replaced, self.latencies, Link(writing), measurement)
        self.conduct = OverrideConduct(self, session)

    def set_speed(self, scale):
        self.sent.append((self.now, scale))

    def report(self, verdict, problem):
        self.reports.append((verdict, problem))

    def stop(self):
        self.braked.append(self.now)
        return self.can_brake

    def hear(self, level, scale=1.0, **changes):
        """A new verdict."""
        self.sequence += 1
        fields = {"stamp": self.now, "valid_until": self.now + VALIDITY, "speed_scale": scale}
        self.verdict = verdict(level, sequence=self.sequence, **(fields | changes))

    def act(self, after=0.001, hindrance="", is_new=True):
        self.now += after
        state = ArmState(self.now, [0.0], [self.v], Program.RUNNING, "", 1.0)
        self.conduct.act(Moment(self.now, self.verdict, None, state, is_new, hindrance))

    @property
    def speed(self):
        return self.sent[-1][1]

    def read(self):
        return os.read(self._reading, 100_000).decode()

    def acknowledge(self):
        """Somebody acknowledges, between two turns."""
        self.is_acknowledged = True
        self.act()
        self.is_acknowledged = False


def test_nothing_but_a_valid_verdict_lets_it_move():
    made = Made()
    made.act()
    assert made.speed == 0.0
    assert made.reports[-1] == (None, "no verdict yet")
    made.hear(Level.SLOW, 0.3)
    made.act()
    assert made.speed == 0.3
    made.act(VALIDITY)
    assert made.speed == 0.0, "it has expired"
    assert made.reports[-1] == (None, "no valid verdict")
    made.hear(Level.CLEAR)
    made.act(hindrance="the robot is silent")
    assert made.speed == 0.0
    assert made.reports[-1] == (None, "the robot is silent")
    made.act()
    assert made.speed == 1.0


@pytest.mark.parametrize("scale", [float("nan"), -1.0, 1.5, 0.0, float("inf")])
def test_a_scale_that_is_none_is_a_stop(scale):
    made = Made()
    made.hear(Level.CLEAR, scale)
    made.act()
    assert made.speed == 0.0


def test_a_speed_is_sent_with_each_verdict_and_repeated_without_one():
    made = Made()
    for _ in range(10):
        made.hear(Level.CLEAR)
        made.act()
    assert len(made.sent) == 10
    for _ in range(round(10 * REPEAT / 0.001)):
        made.act()
    gaps = [b - a for (a, _), (b, _) in zip(made.sent, made.sent[1:], strict=False)]
    assert max(gaps) <= REPEAT + 0.0011
    assert made.speed == 0.0


def test_stops_are_counted_once_with_their_cause():
    made = Made()
    for level in (Level.CLEAR, Level.STOP, Level.STOP, Level.CLEAR):
        made.hear(level, 0.0 if level is Level.STOP else 1.0)
        made.act()
    made.act(VALIDITY)
    counts = made.latencies.counts
    assert (counts.stops, counts.silences, counts.hard_stops) == (2, 1, 0)


@pytest.mark.parametrize(("can_brake", "words"), [(True, "braking it"), (False, "by hand")])
def test_an_arm_that_moves_on_is_braked_by_another_way(can_brake, words):
    made = Made(can_brake=can_brake)
    made.hear(Level.STOP, 0.0)
    begun = made.now
    while made.now < begun + 1.2:
        made.act()
    assert made.braked[0] - begun == pytest.approx(0.502, abs=0.002)
    assert len(made.braked) == 2
    assert words in made.read()
    count = len(made.braked)
    for _ in range(1000):
        made.act(is_new=False)
    assert len(made.braked) == count, "of an arm that is silent nothing is known"
    made.v = 0.0
    for _ in range(1000):
        made.act()
    assert len(made.braked) == count


def test_a_measurement_stops_it_on_purpose():
    measurement = Measurement(1)
    made = Made(measurement=measurement)
    while not measurement.is_done:
        made.hear(Level.CLEAR)
        made.act(0.002)
        state = ArmState(made.now, [0.0], [made.v], Program.RUNNING, "", 1.0)
        measurement.add(made.now, state)
        made.v = 0.0 if made.speed == 0.0 else 0.5
    assert measurement.problem == ""
    assert len(measurement.stops) == 1


@pytest.mark.hazard("H-24")
@pytest.mark.parametrize("restarted", ["monitor", "driver"])
def test_after_a_restart_it_stands_until_somebody_acknowledges(restarted):
    made = Made(is_first=restarted == "monitor")
    if restarted == "monitor":
        made.hear(Level.STOP, 0.0)
        made.act()
        # It came before the restart was noticed, so it is not about it.
        made.is_acknowledged = True
        made.hear(Level.CLEAR, run="second")
        made.act()
        made.is_acknowledged = False
    told = f"hold: the {restarted} was restarted; nod to let the arm go on"
    for _ in range(10):
        made.hear(Level.CLEAR, run="second")
        made.act()
    assert made.speed == 0.0
    assert made.reports[-1] == (None, told)
    made.hear(Level.STOP, 0.0, run="second")
    made.acknowledge()
    made.hear(Level.CLEAR, run="second")
    made.act()
    assert made.speed == 0.0, "nothing could be let go on under a STOP"
    made.acknowledge()
    assert made.speed == 1.0
    made.hear(Level.SLOW, 0.5, run="second")
    made.act()
    assert made.speed == 0.5
    assert made.read().splitlines() == [f"tell {told}", "tell acknowledged: the arm may go on"]
    made.hear(Level.CLEAR, run="third")
    made.act()
    assert made.speed == 0.0, "each restart is another one"


def test_a_graph_that_decides_itself_is_not_held():
    made = Made(acknowledgement="", is_first=False)
    for run in ("first", "second"):
        made.hear(Level.CLEAR, run=run)
        made.act()
        assert made.speed == 1.0
