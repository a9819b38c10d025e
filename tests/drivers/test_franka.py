"""A Franka: what the driver says of it and sends it, and the whole of it against franka-sim."""

import json
import math
import os
import signal
import socket
import struct
import sys
import threading
import time

import numpy as np
import pytest

from armguard.drivers import franka
from armguard.drivers.arm import Program
from armguard.drivers.franka import FrankaArm, FrankaProgramArm, limit_thresholds
from armguard.verdict import Level
from support.driven_franka import (
    GUIDING,
    IDLE,
    PYTHON,
    REFLEX,
    USER_STOPPED,
    DrivenFranka,
    FrankaPeer,
)
from support.shield_commands import DURATION, Pauses, command, move
from support.waiting import wait_until

needs_library = pytest.mark.skipif(
    not PYTHON,
    reason="ARMGUARD_FRANKA_SIM names no Python with franka-sim (python -m venv, then pip install "
    "franka-sim, which needs another numpy)",
)


@pytest.mark.parametrize("force", [1.0, 30.0, 65.0, 140.0, 1e6])
def test_a_force_at_the_tool_exceeds_a_threshold_whatever_its_direction(force):
    torques, forces = limit_thresholds(force)
    directions = np.random.default_rng(0).normal(size=(1000, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    assert (np.abs(1.0001 * force * directions) > forces[:3]).any(axis=1).all()
    assert all(np.array(torques) <= franka.TORQUES)
    assert all(np.array(forces) <= franka.FORCES)
    assert all(np.array(torques) <= 0.1 * force)


class FakeState:
    """What the library tells of a robot."""

    def __init__(self, mode="Idle", errors="", m_total=0.0):
        self.robot_mode = type("Mode", (), {"name": mode})
        self.current_errors, self.last_motion_errors, self.m_total = "", errors, m_total


def test_each_mode_in_which_it_cannot_be_driven_has_words():
    arm = object.__new__(FrankaArm)
    arm._payload, arm._control, arm._cause = 5.0, None, ""
    for mode in ("Idle", "Move"):
        assert arm._find_trouble(FakeState(mode)) == ""
    for mode in ("Other", "Guiding", "Reflex", "UserStopped", "AutomaticErrorRecovery"):
        assert arm._find_trouble(FakeState(mode)).startswith("the robot ")
    assert "(joint_reflex)" in arm._find_trouble(FakeState("Reflex", "joint_reflex"))
    for payload in (5.1, math.nan, math.inf):
        assert "payload" in arm._find_trouble(FakeState(m_total=payload))
    arm._cause = "the robot has ended its motion"
    assert arm._find_trouble(FakeState()) == "the robot has ended its motion"
    assert arm._find_trouble(FakeState()) == ""


@pytest.mark.parametrize("program", Program)
def test_a_stop_without_a_motion_ends_the_program_and_leaves_the_arm_able_to_move(program):
    arm = object.__new__(FrankaProgramArm)
    arm._control, arm._is_stopping, arm._has_begun = None, False, True
    arm._program = program
    assert not arm.stop()
    assert arm._find_program() is Program.STOPPED
    assert not arm._is_stopping


@pytest.fixture(scope="module")
def peer():
    pytest.importorskip("pylibfranka", reason="pylibfranka is not installed")
    with FrankaPeer() as peer:
        yield peer


@pytest.fixture
def lenient(peer):
    """One that a busy machine cannot stop: a stall of either process is no reflex."""
    peer.enforce(communication=False, limits=False)
    return peer


@needs_library
def test_a_program_moves_the_arm_while_verdicts_allow_it(tmp_path, lenient):
    with DrivenFranka(tmp_path, lenient, "--json") as cell:
        monitor, peer = cell.monitor, cell.peer
        monitor.is_silent = True
        cell.wait_for(" states; age ")
        assert peer.speed < 0.01, "there is no verdict yet"

        monitor.is_silent = False
        peer.enforce(communication=False, limits=True)
        assert any(keeps_limits(cell) for _ in range(10)), "this machine stalls too often"

        peer.enforce(communication=False, limits=False)
        cell.wait_until_moving()
        monitor.tell(Level.SLOW, 0.2)
        cell.wait_until_moving(0.02, 0.2)
        monitor.tell(Level.STOP)
        cell.wait_until_resting()
        rested = peer.q
        monitor.tell(Level.CLEAR)
        cell.wait_until_moving()
        assert np.abs(np.subtract(peer.q, rested)).max() < 0.3, "it goes on from there"

        monitor.is_silent = True
        cell.wait_until_resting()
        monitor.start_anew()
        monitor.is_silent = False
        time.sleep(0.6)
        assert peer.speed < 0.01, "a person has to start it"

        for state, said in (
            ({"robot_mode": GUIDING}, "is guided by hand: switch it to execution in Desk"),
            ({"robot_mode": USER_STOPPED}, "is stopped by its user stop: release it"),
            ({"robot_mode": REFLEX}, "has stopped by a reflex"),
            ({"robot_mode": IDLE, "m_load": 9.0}, "state `payload` in the cell file"),
        ):
            peer.set_state(**state)
            cell.wait_for(said)
        peer.set_state(m_load=0.0)
        cell.wait_for("the robot can be driven again")
        assert peer.speed < 0.01

        assert cell.end() == 0
        counts = json.loads(cell.output)["counts"]
        assert counts["stops"] >= 2
        assert counts["silences"] >= 1
        assert counts["hard_stops"] == 0
        states = [state for _, state in monitor.states]
        assert states[0].names == list(franka.JOINTS[1])
        assert (np.diff([state.stamp for state in states]) > 0.0).all()
        assert states[-1].stamp <= time.monotonic()


def keeps_limits(cell):
    """Whether the robot takes all positions for a while; where some are lost it need not."""
    cell.wait_until_moving()
    began, rates = time.monotonic(), []
    while (passed := time.monotonic() - began) < 1.0:
        cell.monitor.tell(Level.SLOW, 0.3 if int(4.0 * passed) % 2 else 1.0)
        rates.append(cell.peer.ask("server.robot_state.state['control_command_success_rate']"))
        if cell.peer.mode == REFLEX:
            assert min(rates) < 1.0, "no position was lost, and the robot has not taken one"
            cell.start()
            return False
    return True


class BadRobot(threading.Thread):
    """Answers clients: the first with nonsense, the second as a robot of another version."""

    def __init__(self, host):
        super().__init__(daemon=True)
        self._server = socket.create_server((host, 1337))

    def run(self):
        for answer in (bytes(30), struct.pack("<IIIBH", 0, 0, 15, 1, 9)):
            connection, _ = self._server.accept()
            with connection:
                connection.recv(100)
                connection.sendall(answer)
                connection.recv(100)  # until the driver ends it
        self._server.close()


@needs_library
def test_whatever_fails_the_arm_rests_and_a_person_starts_it_again(tmp_path, peer):
    peer.enforce(communication=True, limits=False)
    with DrivenFranka(tmp_path, peer) as cell:
        cell.wait_until_moving()
        before = cell.find_driver()
        cell.kill_driver(signal.SIGKILL)
        cell.wait_until_resting()
        wait_until(lambda: cell.find_driver() not in (None, before))
        cell.wait_for("program stopped")
        assert peer.speed < 0.01, "a verdict allows it, and nobody has started it"

        cell.start()
        cell.wait_until_moving()
        cell.kill_driver(signal.SIGSTOP)
        wait_until(lambda: peer.mode == REFLEX)
        cell.wait_until_resting()
        cell.wait_for("the driver's process hung and was killed: without positions the robot stops")
        cell.wait_for("has stopped by a reflex")
        assert peer.speed < 0.01

        peer.enforce(communication=False, limits=False)
        cell.start()
        cell.wait_until_moving()
        port = peer.ask("server.client_udp_port")
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as garbage:
            garbage.sendto(b"nonsense", ("127.0.0.1", port))
        cell.wait_for("libfranka: incorrect object size")
        cell.wait_until_resting()

        cell.wait_until_reading()
        peer.freeze()
        cell.wait_for("the robot has sent no state")
        peer.thaw()
        cell.wait_until_reading()
        peer.__exit__()
        cell.wait_for("Connection to FCI refused")
        peer.__enter__()
        cell.wait_until_reading()
        assert peer.speed < 0.01

        peer.__exit__()
        BadRobot(peer.host).start()
        cell.wait_for("libfranka: Incorrect TCP message size")
        assert cell.process.wait(60.0) == 2
        wait_until(lambda: cell.has("ncompatible library version"))
        peer.__enter__()  # for the tests to come


SIZE = 0.02
"""Of motions, so small since a simulation that a busy machine halts sees them jump."""


class Shield:
    """Makes the commands of a shield whose arm goes on its first joint from where it rests."""

    def __init__(self, peer):
        self.peer, self.reached = peer, np.array(peer.q)
        self.home, self.goal, self.begun, self.stop = self.reached, 1, -math.inf, None
        self._pauses = Pauses()

    def __call__(self, now, sequence):
        begun = max(self.begun, now - 2.0 * DURATION)
        names, late = franka.JOINTS[1], now + 0.1
        return command(
            now, sequence, self.goal, begun, names, self.home, SIZE, stop=self.stop, take_up_by=late
        )

    @property
    def end(self):
        """Where the motion ends."""
        return self.home + SIZE * move(9.0)[0] * np.eye(7)[0]

    @property
    def left(self):
        """What is left of the motion for the positions that the robot gets."""
        return self.end[0] - self.peer.ask("COMMANDS[-1][1][0]")

    def send_goal(self, home):
        """Begin there in a while."""
        self._pauses.wait()
        self.home, self.stop = home, None
        self.goal += 1
        self.begun = time.monotonic() + 0.3

    def move_until(self, condition):
        """Send goals until a motion is as wanted: a machine that stalls ends one or the other."""
        for attempt in range(10):
            # It rests at the end of the last motion, or where a stall has ended one.
            self.send_goal(self.reached if attempt % 2 == 0 else np.array(self.peer.q))
            while time.monotonic() < self.begun + DURATION + 0.5:
                if condition():
                    return
            wait_until(lambda: self.peer.speed < 0.01)
        raise AssertionError("no motion was as wanted")


@needs_library
def test_the_commands_of_a_shield_are_followed_and_nothing_else_moves_the_arm(tmp_path, lenient):
    peer = lenient
    shielded = "[monitor]\nmotion = 'planned'\n[shield]\njerk = 500.0"
    with DrivenFranka(tmp_path, peer, more=shielded) as cell:
        cell.wait_for(" states; age ")
        home = np.array(peer.q)
        shield = cell.monitor.make_command = Shield(peer)
        time.sleep(0.3)
        assert np.abs(peer.q - home).max() < 1e-3, "that goal was there before the driver"

        shield.move_until(lambda: abs(shield.left) < 1e-4)
        assert np.abs(peer.q - home)[1:].max() < 1e-2
        shield.reached = shield.end
        cell.wait_until_resting()

        shield.move_until(lambda: 2e-3 < shield.left < 6e-3)
        shield.stop = "brake"
        cell.wait_until_resting()
        assert shield.left > 1e-4
        assert peer.mode == IDLE

        shield.move_until(lambda: 2e-3 < shield.left < 6e-3)
        cell.process.kill()
        cell.wait_until_resting()
        assert shield.left > 1e-4


@pytest.mark.skipif("ARMGUARD_DRIVE_MINUTE" not in os.environ, reason="takes more than a minute")
@needs_library
def test_a_minute_at_full_rate_with_stops(tmp_path, lenient):
    with DrivenFranka(tmp_path, lenient, "--json") as cell:
        cell.wait_until_moving()
        begun, rested = time.monotonic(), []
        while time.monotonic() - begun < 60.0:
            time.sleep(0.3)
            cell.monitor.tell(Level.STOP)
            cell.wait_until_resting()
            rested.append(time.monotonic() - cell.monitor.changed)
            cell.monitor.tell(Level.CLEAR)
            cell.wait_until_moving()
        count, duration = len(cell.monitor.states), time.monotonic() - begun
        assert cell.end() == 0
        sys.stderr.write(
            f"{len(rested)} stops in {duration:.1f} s, {count / duration:.0f} states/s; "
            f"at rest within {max(rested):.2f} s; {cell.output}\n"
        )
