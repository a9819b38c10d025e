"""A Franka: what the driver says of it and sends it, and the whole of it against franka-sim."""

import json
import math
import time

import numpy as np
import pytest

from armguard.drivers import franka
from armguard.drivers.franka import FrankaArm, limit_thresholds
from armguard.verdict import Level
from support.driven_franka import (
    PYTHON,
    DrivenFranka,
    FrankaPeer,
)
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
        cell.wait_until_moving()
        monitor.tell(Level.SLOW, 0.2)
        wait_until(lambda: 0.02 < peer.speed < 0.2)
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
        cell.wait_for("the monitor was started anew: the program stays paused until a person")
        time.sleep(0.5)
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
