"""Laws of driving a program, with an arm and verdicts that a test can hold in its hands."""

import contextlib
import os

import msgspec
import pytest

from armguard.drivers import latencies as counting
from armguard.drivers import loop as driving
from armguard.drivers.arm import LEAST_SCALE, ArmLostError, Program
from armguard.drivers.latencies import Latencies
from armguard.drivers.link import Link
from armguard.drivers.loop import DriveLoop
from armguard.drivers.program import RESUME_DELAY, ProgramConduct
from armguard.drivers.session import Session
from armguard.verdict import Level
from support import fake_arms
from support.driven_cell import OPTIONS
from support.fake_arms import FakeArm, FakeClock, FakeStreams


@pytest.fixture
def made(monkeypatch):
    clock = FakeClock()
    for module in (driving, counting, fake_arms):
        monkeypatch.setattr(module, "time", clock)
    monkeypatch.setattr(driving.signal, "setitimer", lambda *_: None)
    reading, writing = os.pipe()
    arm, streams, link = FakeArm(), FakeStreams(), Link(writing)
    latencies, streams.arm = Latencies(clock.now), "left"
    options = msgspec.structs.replace(
        OPTIONS, names=tuple("abcdef"), speed=0.5, stop_within=0.2, timeout=0.1, arm="left"
    )
    loops = []

    def start(is_first):
        session = Session(msgspec.structs.replace(options, is_first=is_first), latencies, link)
        loops[:] = [DriveLoop(arm, ProgramConduct(arm, session), session, [streams], streams)]

    def turn(seconds):
        end = clock.now + seconds
        while clock.now < end:
            loops[0].turn()

    arm.restart_driver = lambda: start(False)
    start(True)

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
    streams.scale = 2.0 * LEAST_SCALE
    turn(0.05)
    assert arm.fraction == LEAST_SCALE
    assert streams.published[0][1:] == (tuple("abcdef"), [0.0] * 6, [0.5] * 6, "left")
    assert arm.orders == []


@pytest.mark.parametrize("scale", [1e-6, LEAST_SCALE, 1.99 * LEAST_SCALE])
def test_slower_than_a_program_can_run_is_standing(made, scale):
    arm, streams, turn, _ = made
    turn(0.05)
    streams.scale = scale
    turn(0.05)
    assert arm.orders == ["pause"]


@pytest.mark.parametrize(("level", "validity"), [(Level.STOP, 1.0), (Level.CLEAR, -1.0)])
def test_a_stop_pauses_and_what_was_paused_goes_on_after_a_while(made, level, validity):
    arm, streams, turn, _ = made
    turn(0.05)
    streams.level, streams.validity = level, validity
    turn(0.05)
    assert (arm.orders, arm.fraction) == (["pause"], LEAST_SCALE)
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


@pytest.mark.parametrize("is_started", [False, True])
def test_what_runs_on_after_a_pause_and_somebody_pauses_later_stays_paused(made, is_started):
    arm, streams, turn, _ = made
    turn(0.05)
    if not is_started:
        arm.pause = lambda: arm.orders.append("pause")  # which the robot does not hear
    streams.level = Level.STOP
    turn(0.02)
    streams.level = Level.CLEAR
    turn(0.1)
    arm.program = Program.RUNNING
    turn(2.0 * RESUME_DELAY)
    arm.program = Program.PAUSED
    turn(2.0 * RESUME_DELAY)
    assert arm.orders == ["pause"]


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


@pytest.mark.hazard("H-19")
@pytest.mark.parametrize("program", [Program.RUNNING, Program.PAUSING])
def test_an_arm_that_creeps_on_under_a_stop_is_stopped(made, program):
    arm, streams, turn, read = made
    turn(0.05)

    def pause():
        arm.program = program

    arm.pause = pause
    streams.level = Level.STOP
    turn(0.3)
    assert arm.orders == ["stop"]
    assert "stopping it, which ends its program" in read()


@pytest.mark.hazard("H-19")
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


def test_a_short_silence_of_the_robot_pauses_its_program(made):
    arm, _, turn, _ = made
    turn(0.05)
    arm.is_silent = True
    turn(0.05)
    assert arm.orders == []
    turn(0.1)
    assert (arm.orders[0], arm.fraction) == ("pause", LEAST_SCALE)


def test_an_arm_that_is_silent_mad_or_deaf_counts_as_lost(made):
    arm, streams, turn, _ = made
    turn(0.05)
    arm.is_silent = True
    with pytest.raises(ArmLostError, match="sent no state"):
        turn(1.0)
    arm.is_silent, arm.takes_slider, streams.scale = False, False, 0.3
    with pytest.raises(ArmLostError, match="does not take the speed slider"):
        turn(1.0)
    arm.takes_slider, arm.speed, arm.program = True, float("nan"), Program.RUNNING
    with pytest.raises(ArmLostError, match="not finite"):
        turn(1.0)
    assert all(state[3][0] >= 0.0 for state in streams.published)


@pytest.mark.parametrize(("delay", "is_lost"), [(0.02, False), (0.08, False), (10.0, True)])
@pytest.mark.parametrize("rise", [-1.0, 1.0])
def test_a_slider_that_is_late_is_taken_and_one_that_stays_is_not(made, delay, rise, is_lost):
    arm, streams, turn, _ = made
    orders, begun = [], 0.1 if rise > 0.0 else 1.0
    streams.scale = begun
    turn(0.05)

    def scale(fraction):
        orders.append((fake_arms.time.now, fraction))
        while orders and fake_arms.time.now - orders[0][0] >= delay:
            arm.fraction = orders.pop(0)[1]

    arm.scale = scale
    with pytest.raises(ArmLostError, match="slider") if is_lost else contextlib.nullcontext():
        for k in range(90):
            streams.scale = begun + rise * 0.01 * k
            turn(0.01)


@pytest.mark.hazard("H-19")
def test_a_slider_that_does_not_fall_is_lost_within_the_longest_silence(made):
    arm, streams, turn, _ = made
    turn(0.05)
    arm.takes_slider, streams.scale = False, 0.1
    turn(0.29)
    with pytest.raises(ArmLostError, match=r"reports 0\.5, ordered was 0\.05"):
        turn(0.02)


@pytest.mark.hazard("H-08")
def test_without_any_verdict_it_stands(made):
    arm, streams, turn, _ = made
    streams.level = None
    turn(0.05)
    assert (arm.orders, arm.fraction) == (["pause"], LEAST_SCALE)


@pytest.mark.hazard("H-24")
@pytest.mark.parametrize("says_goodbye", [False, True])
def test_a_program_stays_paused_when_the_monitor_was_restarted(made, says_goodbye):
    arm, streams, turn, read = made
    turn(0.05)
    if says_goodbye:
        streams.level, streams.validity, streams.sequence = Level.STOP, 0.0, -1
        turn(0.0004)
        assert streams.sequence == 0
    streams.is_silent = True
    turn(3.0)
    assert arm.orders == ["pause"]
    streams.level, streams.validity, streams.run = Level.CLEAR, 1.0, "second"
    streams.is_silent = False
    turn(2.0 * RESUME_DELAY)
    assert arm.orders == ["pause"]
    assert "the monitor was restarted" in read()


@pytest.mark.hazard("H-24")
@pytest.mark.parametrize("delay", [0.0, 0.1])
@pytest.mark.parametrize("cause", ["driver", "monitor", "fault"])
def test_a_program_that_runs_on_through_a_restart_or_a_fault_needs_a_persons_start(
    made, cause, delay
):
    """However late the robot obeys an order to pause."""
    arm, streams, turn, read = made
    turn(0.05)
    pauses, pause = [], arm.pause

    def obey_later():
        pauses.append(streams.newest.stamp)
        if streams.newest.stamp - pauses[0] >= delay:
            pause()

    arm.pause = obey_later
    if cause == "driver":
        arm.restart_driver()
    elif cause == "monitor":
        streams.run = "second"
    else:
        arm.trouble = "the robot is in a protective stop"
        turn(0.001)
        arm.trouble = ""
    turn(0.05)
    assert arm.fraction == (LEAST_SCALE if delay else 0.5)
    streams.level = Level.STOP
    turn(0.2)
    streams.level = Level.CLEAR
    turn(2.0 * RESUME_DELAY)
    assert (arm.orders, arm.program) == (["pause"], Program.PAUSED)
    assert (f"the {cause} was restarted" in read()) == (cause != "fault")
    arm.program = Program.RUNNING  # a person starts it
    turn(0.1)
    assert (arm.orders, arm.fraction) == (["pause"], 0.5)


@pytest.mark.hazard("H-24")
def test_what_the_driver_before_has_paused_stays_paused(made):
    arm, _, turn, read = made
    arm.program = Program.PAUSED
    arm.restart_driver()
    turn(2.0 * RESUME_DELAY)
    assert (arm.orders, "restarted" in read()) == ([], False)


def test_an_arm_that_people_move_is_not_said_to_ignore_a_pause(made):
    arm, streams, turn, read = made
    turn(0.05)
    arm.trouble, arm.fraction = "the robot is guided by hand", 0.0
    arm.stop = lambda: arm.orders.append("stop")  # no motion runs
    arm.read = lambda: FakeArm.read(arm)._replace(v=[0.5] * 6)
    turn(2.0)
    assert "stop" in arm.orders
    assert "stopping it" not in read()
    arm.trouble, streams.level = "", Level.CLEAR
    turn(2.0 * RESUME_DELAY)
    assert "resume" not in arm.orders
