"""The whole of a driver in a ROS 2 graph: processes, Cyclone DDS here, and Fast DDS at the arm."""

import json
import os
import sys
import time

import numpy as np
import pytest

from armguard.messages.incoming import JointsMessage, ObstaclesMessage
from armguard.verdict import Level
from support.driven_cell import VALIDITY
from support.ros2_arm import GraphCell, Ros2Arm, build_arm
from support.shield_commands import DURATION, SPEED, command, move
from support.waiting import wait_until

pytest.importorskip("cyclonedds", reason="cyclonedds is not installed")

NAMES = [f"panda_joint{number}" for number in range(1, 8)]
READY = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]


@pytest.fixture(autouse=True)
def arm_is_built():
    build_arm()


def is_nowhere(message):
    """Whether an obstacle could be anywhere: the monitor refuses it, and says so."""
    return bool(np.isnan(np.frombuffer(message.position)).any())


def test_an_arm_in_a_graph_moves_while_verdicts_allow_it(tmp_path):
    with GraphCell(tmp_path) as cell:
        arm, monitor = cell.arm, cell.monitor
        arm.wait_until_moving()
        wait_until(lambda: (0, "CLEAR") in arm.levels)
        wait_until(lambda: cell.list_messages(JointsMessage))
        state = cell.list_messages(JointsMessage)[-1]
        assert state.names == NAMES
        q = np.frombuffer(state.q)
        assert list(q[1:]) == READY[1:]
        assert abs(state.stamp - time.monotonic()) < 1.0
        wait_until(lambda: cell.list_messages(ObstaclesMessage))
        ball = cell.list_messages(ObstaclesMessage)[-1]
        assert (ball.ids, ball.source, ball.frame) == (["0"], "camera", "world")
        assert np.frombuffer(ball.position).tolist() == [3.0, 0.0, 0.5]
        assert np.frombuffer(ball.radius).tolist() == [0.2]

        monitor.tell(Level.SLOW, 0.25)
        wait_until(lambda: arm.speeds[-1][1] == 0.25)
        wait_until(lambda: arm.levels[-1][0] == 1)
        monitor.tell(Level.STOP)
        arm.wait_until_resting()
        wait_until(lambda: arm.levels[-1][0] == 2)

        # What a stranger sends is told, and counts as nothing, or as an obstacle anywhere.
        monitor.tell(Level.CLEAR)
        arm.wait_until_moving()
        driver, seen = cell.find_driver(), len(monitor.states)
        arm.tell("garbage")
        cell.wait_for("values of velocity for 7 joints")
        cell.wait_for("messages cannot be read")

        def is_obstacle_spoilt():
            arm.tell("garbage")  # again, since a loaded machine loses messages
            return any(map(is_nowhere, cell.list_messages(ObstaclesMessage)))

        wait_until(is_obstacle_spoilt)
        wait_until(lambda: len(monitor.states) > seen + 300)
        for state in cell.list_messages(JointsMessage):
            assert np.abs(np.frombuffer(state.q)).max() < 3.0
            assert np.abs(np.frombuffer(state.v)).max() < 1.0
        assert cell.find_driver() == driver

        monitor.is_silent = True
        arm.wait_until_resting()
        wait_until(lambda: arm.levels[-1] == (2, "STOP: no valid verdict"))
        monitor.start_anew()
        monitor.is_silent = False
        arm.acknowledge_hold("monitor")
        arm.wait_until_moving()

        cell.kill_driver()
        arm.wait_until_resting()
        wait_until(lambda: cell.find_driver() not in (None, driver))
        arm.acknowledge_hold("driver")
        arm.wait_until_moving()

        driver = cell.find_driver()
        arm.tell("mute")
        cell.wait_for("the robot is silent")
        arm.wait_until_resting()
        arm.__exit__()
        monitor.tell(Level.STOP)
        with Ros2Arm(cell.domain) as other:
            cell.wait_for("the robot sends states again")
            wait_until(lambda: other.levels and other.speeds)
            assert other.find_fastest(0.0) == 0.0
            monitor.tell(Level.CLEAR)
            other.wait_until_moving()
            assert cell.find_driver() == driver, "nothing was started anew"
            cell.process.kill()
            other.wait_until_resting()
            wait_until(lambda: not os.path.exists(f"/proc/{driver}/exe"))


class Shield:
    """Makes the commands of a shield whose arm turns its first joint."""

    def __init__(self):
        self.home, self.goal, self.begun, self.stop = np.array(READY), 1, None, None

    def __call__(self, now, sequence):
        begun = now - 2.0 * DURATION if self.begun is None else self.begun
        home = self.home - [move(9.0)[0] if self.begun is None else 0.0, *[0.0] * 6]
        return command(
            now, sequence, self.goal, begun, NAMES, home, stop=self.stop, take_up_by=now + 0.1
        )

    def set_off(self, arm):
        """Send goals until the arm sets off: a busy machine may miss the beginning of a motion."""
        while True:
            arm.wait_until_resting()
            self.home, self.stop = np.array([arm.places[-1][1], *READY[1:]]), None
            self.goal += 1
            self.begun = time.monotonic() + 0.4
            end = self.begun + DURATION
            wait_until(lambda end=end: arm.places[-1][2] > 0.3 or time.monotonic() > end)
            if arm.places[-1][2] > 0.3:
                return

    def is_done(self, arm):
        """Whether the arm rests at the end of its motion."""
        return abs(arm.places[-1][1] - self.home[0] - SPEED * DURATION) < 1e-6


def test_the_commands_of_a_shield_are_trajectories(tmp_path):
    shielded = "[monitor]\nmotion = 'planned'\n[shield]\njerk = 500.0"
    with GraphCell(tmp_path, more=shielded) as cell:
        arm = cell.arm
        shield = cell.monitor.make_command = Shield()
        cell.wait_for(" commands, ")
        assert arm.trajectories == [], "that goal was there before the driver"

        shield.set_off(arm)
        arm.wait_until_resting()
        assert shield.is_done(arm)
        off = [
            abs(q - shield.home[0] - move(t - shield.begun)[0])
            for t, q, _ in arm.places
            if 0.0 < t - shield.begun < DURATION
        ]
        assert np.quantile(off, 0.9) < 1e-3, "but for what is between two readings of a clock"

        for _ in range(10):
            shield.set_off(arm)
            shield.stop = "brake"
            arm.wait_until_resting()
            if not shield.is_done(arm):
                break  # on a busy machine the motion may be over by then
        assert not shield.is_done(arm)

        shield.set_off(arm)
        cell.kill_driver()
        arm.wait_until_resting()
        assert shield.is_done(arm), "whatever is silent"
        cell.wait_for("the arm rests at the end of the motion that was sent last")


@pytest.mark.skipif("ARMGUARD_DRIVE_MINUTE" not in os.environ, reason="takes more than a minute")
def test_a_minute_at_full_rate_with_a_stop_every_other_second(tmp_path):
    with GraphCell(tmp_path, "--json") as cell:
        arm, monitor = cell.arm, cell.monitor
        arm.wait_until_moving()
        begun, reached, silent = time.monotonic(), [], []
        while time.monotonic() - begun < 60.0:
            time.sleep(0.3)
            since = time.monotonic()
            monitor.is_silent = len(reached) > len(silent)
            if not monitor.is_silent:
                monitor.tell(Level.STOP)
            wait_until(lambda: arm.speeds[-1][1] == 0.0)
            told = arm.speeds[-1][0]
            if told > since:  # else verdicts had expired before, on a busy machine
                (silent if monitor.is_silent else reached).append(told - since)
            arm.wait_until_resting()
            monitor.is_silent = False
            monitor.tell(Level.CLEAR)
            arm.wait_until_moving()
        duration = time.monotonic() - begun
        states = cell.list_messages(JointsMessage)
        assert cell.end() == 0
        report = json.loads(cell.output)
        late = 1e3 * np.array(reached)
        sys.stderr.write(
            f"{len(reached)} stops in {duration:.1f} s, {len(states) / duration:.0f} states/s; "
            f"STOP to the arm p50 {np.median(late):.1f}, p99 {np.percentile(late, 99):.1f}, "
            f"max {late.max():.1f} ms; silence of {1e3 * VALIDITY:.0f} ms, to the arm: "
            f"max {1e3 * max(silent):.1f} ms; {report}\n"
        )
        assert report["lost"] == 0
