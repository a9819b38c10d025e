"""What the loop does, whatever tells the arm what to do."""

import math
import os
import time

import msgspec
import pytest

from armguard.drivers import loop as driving
from armguard.drivers.arm import ArmLostError
from armguard.drivers.latencies import Latencies
from armguard.drivers.link import DRIVING, Link
from armguard.drivers.loop import DriveLoop
from armguard.drivers.session import Session
from armguard.verdict import Level
from support import fake_arms
from support.driven_cell import OPTIONS
from support.fake_arms import FakeArm, FakeClock, FakeStreams
from support.shield_commands import command


class Witness:
    """Keeps the moments."""

    def __init__(self):
        self.moments = []

    def act(self, moment):
        self.moments.append(moment)


@pytest.fixture
def made(monkeypatch):
    monkeypatch.setattr(driving.signal, "setitimer", lambda *_: None)
    reading, writing = os.pipe()
    arm, streams, witness, link = FakeArm(), FakeStreams(), Witness(), Link(writing)
    session = Session(OPTIONS, Latencies(time.monotonic()), link)
    loop = DriveLoop(arm, witness, session, [streams], streams)
    yield arm, streams, witness, loop, lambda: os.read(reading, 100_000).decode()
    os.close(reading)
    os.close(writing)


def test_each_state_is_published_and_handed_on_with_the_newest_verdict(made):
    _, streams, witness, loop, read = made
    for _ in range(5):
        loop.turn()
    assert len(streams.published) == len(witness.moments) == 5
    assert all(one.is_new and one.verdict.level is Level.CLEAR for one in witness.moments)
    assert [one[0] for one in streams.published] == [one.state.stamp for one in witness.moments]
    assert not any(one.hindrance for one in witness.moments)
    assert DRIVING in read()


def test_silence_of_the_robot_hinders_it_and_a_long_one_is_its_loss(made):
    arm, streams, witness, loop, _ = made
    loop.turn()
    arm.is_silent = True
    with pytest.raises(ArmLostError, match="has sent no state"):
        loop.run()
    assert len(streams.published) == 1
    assert not any(one.is_new for one in witness.moments[1:])
    silent = [one.now for one in witness.moments if one.hindrance == "the robot is silent"]
    assert OPTIONS.timeout < silent[-1] - witness.moments[0].now <= OPTIONS.longest_silence + 0.01


def test_signs_of_life_come_more_often_than_their_absence_ends_the_process(made, monkeypatch):
    _, streams, witness, _, _ = made
    clock = FakeClock()
    monkeypatch.setattr(driving, "time", clock)
    monkeypatch.setattr(fake_arms, "time", clock)
    options = msgspec.structs.replace(OPTIONS, timeout=0.005)
    reading, writing = os.pipe()
    session = Session(options, Latencies(clock.now), Link(writing))
    loop = DriveLoop(FakeArm(), witness, session, [streams], streams)
    longest, heard = 0.0, clock.now
    for _ in range(200):
        loop.turn()
        os.write(writing, b"-")
        if DRIVING in os.read(reading, 1000).decode():
            longest, heard = max(longest, clock.now - heard), clock.now
    assert 0.0 < longest <= 0.5 * options.longest_silence
    os.close(reading)
    os.close(writing)


def test_trouble_is_told_when_it_changes(made):
    arm, _, witness, loop, read = made
    for trouble in ("", "it burns", "it burns", "it is wet", ""):
        arm.trouble = trouble
        loop.turn()
        assert witness.moments[-1].hindrance == trouble
    told = [line[5:] for line in read().splitlines() if line.startswith("tell ")]
    assert told == ["it burns", "it is wet", "the robot can be driven again"]


@pytest.mark.parametrize(("validity", "is_told"), [(1.0, False), (3.0, True), (math.nan, True)])
def test_verdicts_that_claim_more_than_is_agreed_are_told_once(made, validity, is_told):
    _, streams, _, loop, read = made
    streams.validity = validity
    for _ in range(5):
        loop.turn()
    assert read().count("the cell file has 2e+03 ms") == is_told


@pytest.mark.hazard("H-24")
def test_what_is_said_to_another_arm_counts_as_nothing_and_is_told_once(made):
    _, streams, witness, loop, read = made
    for arm in ("", "left", "left", ""):
        streams.arm = arm
        streams.command = command(time.monotonic(), arm=arm)
        loop.turn()
        heard = witness.moments[-1]
        own = (streams.newest, streams.command) if arm == "" else (None, None)
        assert (heard.verdict, heard.command) == own
    told = "verdicts at ipc:///verdicts are for arm 'left', expected '', and count as none"
    assert read().count(told) == 1


@pytest.mark.parametrize("bad", [float("nan"), float("inf")])
def test_what_is_not_finite_is_not_published(made, bad):
    arm, streams, _, loop, _ = made
    arm.speed = bad
    with pytest.raises(ArmLostError, match="not finite"):
        loop.turn()
    assert streams.published == []


def test_it_ends_with_the_process_that_started_it(made):
    arm, streams, witness, _, _ = made
    reading, writing = os.pipe()
    orphan = msgspec.structs.replace(OPTIONS, parent=1)
    session = Session(orphan, Latencies(time.monotonic()), Link(writing))
    loop = DriveLoop(arm, witness, session, [streams], streams)
    with pytest.raises(KeyboardInterrupt):
        loop.run()
    os.close(reading)
    os.close(writing)
