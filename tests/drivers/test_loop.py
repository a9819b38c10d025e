"""Laws of the loop, with an arm and verdicts that a test can hold in its hands."""

import os
import time

import pytest

from armguard.drivers.arm import ArmLostError, ArmState, Program
from armguard.drivers.latencies import Latencies
from armguard.drivers.link import Link
from armguard.drivers.loop import RESUME_DELAY, SMALLEST_SCALE, DriveLoop, Limits
from armguard.verdict import Level
from support.verdict_samples import verdict


class FakeArm:
    """Does what it is told, at once, unless it is told to disobey."""

    def __init__(self):
        self.orders = []
        self.program, self.fraction, self.speed, self.trouble = Program.RUNNING, 1.0, 0.5, ""
        self.takes_slider = True
        self.is_silent = False

    def read(self):
        if self.is_silent:
            return None
        v = self.speed * self.fraction if self.program is Program.RUNNING else 0.0
        now = time.monotonic()
        return ArmState(now, [0.0] * 6, [v] * 6, self.program, self.trouble, self.fraction)

    def scale(self, fraction):
        if self.takes_slider:
            self.fraction = fraction

    def pause(self):
        self.orders.append("pause")
        self.program = Program.PAUSED

    def resume(self):
        self.orders.append("resume")
        self.program = Program.RUNNING

    def stop(self):
        self.orders.append("stop")
        self.program = Program.STOPPED

    def close(self):
        pass


class FakeStreams:
    """A publisher and a reader in one."""

    def __init__(self):
        self.level, self.validity, self.sequence, self.published = Level.CLEAR, 1.0, 0, []
        self.scale = 1.0

    def joints(self, stamp, names, q, v, arm):
        self.published.append((stamp, names, list(q), list(v), arm))

    def latest(self, timeout):
        time.sleep(0.0005)
        if self.level is None:
            return None
        self.sequence += 1
        now = time.monotonic()
        return verdict(
            self.level,
            stamp=now,
            sequence=self.sequence,
            speed_scale=self.scale,
            valid_until=now + self.validity,
        )


@pytest.fixture
def made():
    reading, writing = os.pipe()
    arm, streams = FakeArm(), FakeStreams()
    latencies = Latencies(time.monotonic())
    limits = Limits(speed=0.5, stop_within=0.2)
    loop = DriveLoop(
        arm, tuple("abcdef"), streams, streams, latencies, Link(writing), limits, arm_name="left"
    )

    def turn(seconds):
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            loop.turn()

    yield arm, streams, turn, lambda: os.read(reading, 100_000).decode()
    os.close(reading)
    os.close(writing)


def test_the_slider_follows_the_verdict_up_to_the_cells_speed(made):
    arm, streams, turn, _ = made
    turn(0.05)
    assert arm.fraction == 0.5
    streams.scale = 0.4
    turn(0.05)
    assert arm.fraction == 0.2
    streams.scale = 1e-6
    turn(0.05)
    assert arm.fraction == SMALLEST_SCALE
    assert streams.published[0][1:] == (tuple("abcdef"), [0.0] * 6, [0.5] * 6, "left")
    assert arm.orders == []


@pytest.mark.parametrize(("level", "validity"), [(Level.STOP, 1.0), (Level.CLEAR, -1.0)])
def test_a_stop_pauses_and_what_was_paused_goes_on_after_a_while(made, level, validity):
    arm, streams, turn, _ = made
    turn(0.05)
    streams.level, streams.validity = level, validity
    turn(0.05)
    assert (arm.orders, arm.fraction) == (["pause"], SMALLEST_SCALE)
    streams.level, streams.validity = Level.CLEAR, 1.0
    turn(0.5 * RESUME_DELAY)
    assert arm.orders == ["pause"]
    turn(RESUME_DELAY)
    assert arm.orders == ["pause", "resume"]


def test_what_somebody_else_has_paused_stays_paused(made):
    arm, streams, turn, _ = made
    turn(0.05)
    arm.program = Program.PAUSED
    streams.level = Level.STOP
    turn(0.05)
    streams.level = Level.CLEAR
    turn(2.0 * RESUME_DELAY)
    assert arm.orders == []


def test_a_fault_takes_away_the_right_to_go_on(made):
    arm, streams, turn, read = made
    turn(0.05)
    streams.level = Level.STOP
    turn(0.05)
    arm.trouble = "the robot is in a protective stop"
    turn(0.05)
    arm.trouble, streams.level = "", Level.CLEAR
    turn(2.0 * RESUME_DELAY)
    assert arm.orders == ["pause"]
    assert "tell the robot is in a protective stop\n" in (told := read())
    assert "tell the robot can be driven again\n" in told


def test_an_arm_that_goes_on_is_stopped(made):
    arm, streams, turn, read = made
    turn(0.05)
    arm.pause = lambda: arm.orders.append("pause")
    arm.speed = 10.0  # also at one percent too fast
    streams.level = Level.STOP
    turn(0.15)
    assert "stop" not in arm.orders
    turn(0.1)
    assert arm.orders[-1] == "stop"
    assert "stopping it, which ends its program" in read()
    streams.level = Level.CLEAR
    turn(2.0 * RESUME_DELAY)
    assert "resume" not in arm.orders


def test_an_arm_that_is_silent_mad_or_deaf_counts_as_lost(made):
    arm, streams, turn, _ = made
    turn(0.05)
    arm.is_silent = True
    with pytest.raises(ArmLostError, match="sent no state"):
        turn(1.0)
    arm.is_silent, arm.takes_slider, streams.scale = False, False, 0.3
    with pytest.raises(ArmLostError, match="does not take the speed slider"):
        turn(1.0)
    arm.takes_slider, arm.speed = True, float("nan")
    with pytest.raises(ArmLostError, match="not finite"):
        turn(1.0)
    assert all(state[3][0] >= 0.0 for state in streams.published)


def test_without_any_verdict_it_stands(made):
    arm, streams, turn, _ = made
    streams.level = None
    turn(0.05)
    assert (arm.orders, arm.fraction) == (["pause"], SMALLEST_SCALE)
