"""The whole of a driver: processes, the maker's client library, and a simulated controller."""

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import msgspec
import numpy as np
import pytest

from armguard.drivers.link import Counts
from armguard.drivers.ur import JOINTS
from armguard.drivers.watch import Report, watch
from armguard.exceptions import ArmguardError
from armguard.lab.simulation.ur_controller import (
    PAUSED,
    PLAYING,
    POWER_OFF,
    RUNNING,
    STOPPED,
    UrController,
)
from armguard.streams.nodes import Publisher, VerdictReader
from armguard.verdict import Level
from support.driven_cell import OPTIONS, DrivenCell, find_host
from support.shield_commands import DURATION, SPEED, Pauses, command, move
from support.waiting import PATIENCE, wait_until

pytest.importorskip("rtde_receive", reason="ur-rtde is not installed")

NAMES = list(JOINTS)

DEMO = Path(__file__).parents[2] / "demos/ur5e_shield.toml"


def test_a_program_runs_while_verdicts_allow_it(tmp_path):
    with DrivenCell(tmp_path, "--json") as cell:
        controller, monitor = cell.controller, cell.monitor
        cell.wait_until_moving()

        monitor.tell(Level.SLOW, 0.25)
        wait_until(lambda: abs(controller.pace - 0.25) < 0.001)
        monitor.tell(Level.STOP)
        cell.wait_until_resting()
        wait_until(lambda: controller.program == PAUSED)

        controller.play()  # somebody does, during a STOP
        wait_until(lambda: controller.program == PAUSED)
        assert controller.pace <= 0.011

        monitor.tell(Level.CLEAR)
        cell.wait_until_moving()

        controller.loses = 0.5  # packages
        before = len(monitor.states)
        wait_until(lambda: len(monitor.states) > before + 100)
        assert controller.pace > 0.99
        controller.loses = 0.0

        monitor.is_silent = True
        cell.wait_until_resting()
        wait_until(lambda: controller.program == PAUSED)
        monitor.start_anew()
        monitor.is_silent = False
        cell.wait_for("the monitor was restarted")
        time.sleep(0.5)
        cell.play()

        assert "stopj" not in [one.order for one in controller.received]
        assert cell.end() == 0
        cell.wait_until_resting()
        report = json.loads(cell.output)
        assert report["counts"]["stops"] >= 2
        assert report["counts"]["silences"] >= 1
        assert report["lost"] == report["counts"]["hard_stops"] == 0
        check_states([state for _, state in monitor.states])


def check_states(states):
    """Stamps rise, and positions are where velocities bring the joints between them."""
    assert all(state.names == NAMES for state in states)
    stamps = np.array([state.stamp for state in states])
    q = np.array([np.frombuffer(state.q) for state in states])
    v = np.array([np.frombuffer(state.v) for state in states])
    assert (np.diff(stamps) > 0.0).all()
    assert stamps[-1] <= time.monotonic()
    assert np.abs(v).max() > 0.1
    # Where joints do not change their speed, each state follows from the one before.
    steady = (np.abs(np.diff(v, axis=0)) < 0.01).all(axis=1) & (np.diff(stamps) < 0.1)
    moved = np.diff(q, axis=0)[steady] - (v[1:] * np.diff(stamps)[:, None])[steady]
    assert np.abs(moved).mean() < 0.002


@pytest.mark.hazard("H-20")
def test_a_robot_or_a_driver_that_fails_leaves_no_arm_moving_and_is_connected_anew(tmp_path):
    with DrivenCell(tmp_path) as cell:
        controller = cell.controller
        cell.wait_until_moving()
        for fault in (
            lambda: cell.kill_driver(signal.SIGKILL),
            lambda: cell.kill_driver(signal.SIGSTOP),
            controller.cut,
            lambda: controller.send_garbage(b"\xff" * 3000),
            lambda: controller.send_garbage(b"\0" * 300),
        ):
            before = cell.find_driver()
            fault()
            cell.wait_until_resting()
            wait_until(lambda: controller.program == STOPPED)
            cell.wait_until_driving(before)
            cell.play()

        seen = len(cell.monitor.states)
        controller.send_garbage(b"\0\4U\1" + b"\0\3M" * 5)
        wait_until(lambda: len(cell.monitor.states) > seen + 50)
        for _, state in cell.monitor.states[seen:]:
            assert np.abs(np.frombuffer(state.q)).max() < 3.0
            assert np.abs(np.frombuffer(state.v)).max() < 1.0

        controller.is_frozen = True
        cell.wait_for("the robot has sent no state")
        cell.wait_for("does not answer")
        controller.refuses = True
        controller.is_frozen = False
        cell.wait_for("has ended the connection")
        controller.refuses = False
        cell.wait_until_driving()


def test_a_command_that_is_killed_takes_its_driver_along_which_stops_the_arm(tmp_path):
    with DrivenCell(tmp_path) as cell:
        cell.wait_until_moving()
        driver = cell.find_driver()
        cell.process.kill()
        cell.wait_until_resting()
        wait_until(lambda: not os.path.exists(f"/proc/{driver}/exe"))
        cell.start()
        cell.wait_until_driving()
        assert cell.controller.pace == 0.0, "nobody has started the program"


@pytest.mark.hazard("H-20")
def test_with_both_processes_dead_the_watchdog_of_the_controller_pauses_the_program(tmp_path):
    with DrivenCell(tmp_path, has_watchdog=True) as cell:
        cell.wait_until_moving()
        cell.process.send_signal(signal.SIGSTOP)
        cell.kill_driver()
        cell.wait_until_resting()
        assert cell.controller.program == PAUSED
        cell.process.send_signal(signal.SIGCONT)


@pytest.mark.hazard("H-24")
def test_a_program_that_ran_on_without_a_network_is_paused_until_a_person_starts_it(tmp_path):
    with DrivenCell(tmp_path) as cell:
        controller = cell.controller
        cell.wait_until_moving()
        controller.refuses = True
        controller.cut()
        cell.wait_for("no order reaches the arm")
        assert controller.program == PLAYING
        controller.refuses = False
        cell.wait_for("the driver was restarted: the program stays paused")
        wait_until(lambda: controller.program == PAUSED)
        time.sleep(0.5)
        cell.play()
        assert "play" not in [one.order for one in controller.received]


@pytest.mark.hazard("H-19")
def test_a_robot_in_local_control_is_slowed_and_paused_once_it_listens_again(tmp_path):
    with DrivenCell(tmp_path, more="stop_within = 60.0") as cell:
        controller = cell.controller
        cell.wait_until_moving()
        controller.is_remote = False
        cell.wait_for("is in local control and ignores pause and scripts: stop it by hand")
        wait_until(lambda: controller.pace < 0.011)
        controller.is_remote = True
        cell.wait_for("the robot can be driven again")
        wait_until(lambda: controller.program == PAUSED)
        assert not cell.has("stopping it")


@pytest.mark.hazard("H-20")
def test_a_driver_that_ends_stops_a_program_that_does_not_pause_and_says_so(tmp_path):
    with DrivenCell(tmp_path, more="stop_within = 3.0") as cell:
        controller = cell.controller
        cell.wait_until_moving()
        controller.obeys_pause = False
        assert cell.end() == 1
        assert cell.has("not seen at rest 3 s after `pause`")
        assert cell.has("the robot was lost: check that the arm is at rest")
        wait_until(lambda: controller.program == STOPPED)


def test_a_robot_that_cannot_be_driven_says_why_and_is_not_started_again(tmp_path):
    with DrivenCell(tmp_path, more="stop_within = 0.5") as cell:
        controller = cell.controller
        cell.wait_until_moving()

        controller.stop_protectively()
        cell.wait_for("is in a protective stop: see what it hit")
        controller.recover()
        cell.wait_for("the robot can be driven again")
        time.sleep(0.5)
        cell.play()

        controller.payload = 7.0
        cell.wait_for("state `payload` in the cell file")
        wait_until(lambda: controller.program == PAUSED)
        controller.payload = 0.0
        time.sleep(0.5)
        cell.play()

        controller.mode = POWER_OFF
        cell.wait_for("is switched off: switch it on")
        controller.mode = RUNNING
        time.sleep(0.5)
        wait_until(lambda: controller.program == PAUSED)
        cell.play()

        controller.obeys_pause = False
        controller.ignores_slider = True
        cell.monitor.tell(Level.STOP)
        cell.wait_for("stopping it, which ends its program")
        cell.wait_until_resting()
        wait_until(lambda: controller.program == STOPPED)

        controller.slider_in_use = True
        controller.cut()
        cell.wait_for("another client of the robot has the speed slider")
        controller.is_remote = False
        cell.wait_for("is not in remote control")


class Shield:
    """Makes the commands of a shield whose arm goes to and fro on its first joint."""

    def __init__(self, home):
        self.home, self.goal, self.begun, self.stop = np.array(home), 1, None, None
        self._pauses = Pauses()

    def __call__(self, now, sequence):
        begun = now - 2.0 * DURATION if self.begun is None else self.begun
        home = self.home if self.begun is not None else self.home - [move(9.0)[0], 0, 0, 0, 0, 0]
        return command(
            now, sequence, self.goal, begun, JOINTS, home, stop=self.stop, take_up_by=now + 0.1
        )

    def send_goal(self, q):
        """Begin in a while at a place where the arm rests: it can be taken up until then."""
        self._pauses.wait()
        self.home, self.stop = np.array(q), None
        self.goal += 1
        self.begun = time.monotonic() + 0.5


def test_the_commands_of_a_shield_are_followed_and_nothing_else_moves_the_arm(tmp_path):
    shielded = "[monitor]\nmotion = 'planned'\n[shield]\njerk = 500.0"
    with DrivenCell(tmp_path, more=shielded) as cell:
        controller = cell.controller
        cell.wait_for_states()
        wait_until(lambda: controller.is_controlled and np.abs(controller.v).max() < 1e-4)
        home = controller.q.copy()
        shield = cell.monitor.make_command = Shield(home)
        time.sleep(0.2)
        assert (controller.q == home).all(), "that goal was there before the driver"

        shield.send_goal(home)
        worst = 0.0
        while (t := time.monotonic() - shield.begun) < DURATION:
            worst = max(worst, abs(controller.q[0] - home[0] - move(t)[0]))
            time.sleep(0.002)
        wait_until(lambda: abs(controller.q[0] - home[0] - SPEED * DURATION) < 1e-4)
        assert worst < 0.1, "a servoed arm is behind by its lag, and by what the machine was busy"
        assert np.abs(controller.q[1:] - home[1:]).max() < 1e-6

        wait_until(lambda: np.abs(controller.v).max() < 1e-4)
        shield.send_goal(controller.q)
        wait_until(lambda: controller.v[0] > 0.2)
        shield.stop = "brake"
        wait_until(lambda: "servo stop" in [one.order for one in controller.received])
        wait_until(lambda: np.abs(controller.v).max() < 1e-4)

        time.sleep(0.1)
        controller.slider = 0.5  # somebody moves it
        cell.wait_for("the speed slider is at 50%: set it to 100%")
        controller.slider = 1.0
        cell.wait_for("the robot can be driven again")
        shield.send_goal(controller.q)
        wait_until(lambda: controller.v[0] > 0.2)
        cell.process.send_signal(signal.SIGSTOP)
        cell.kill_driver()
        wait_until(lambda: "watchdog" in [one.order for one in controller.received])
        wait_until(lambda: np.abs(controller.v).max() < 1e-4)
        assert controller.program == STOPPED
        seen = cell.find_driver()
        cell.process.send_signal(signal.SIGCONT)

        wait_until(lambda: cell.find_driver() not in (None, seen) and controller.clients == 2)
        wait_until(lambda: controller.program == PLAYING)
        there = controller.q.copy()
        shield.home, shield.begun = there, time.monotonic()
        time.sleep(0.5)
        assert np.abs(controller.q - there).max() == 0.0, "no goal has come since"

        driver = cell.find_driver()
        controller.is_frozen = True
        cell.process.kill()
        wait_until(lambda: not os.path.exists(f"/proc/{driver}/exe"))


def test_the_demo_of_a_shield_moves_a_simulated_arm_to_its_goal(tmp_path):
    host = find_host()
    cell = tmp_path / "cell.toml"
    cell.write_text(DEMO.read_text().replace("127.0.0.1", host))
    places = {name: f"ipc://{tmp_path}/{name}" for name in ("joints", "obstacles", "verdicts")}
    addresses = [text for name, place in places.items() for text in (f"--{name}", place)]
    controller = UrController(host, "UR5e")
    controller.program = STOPPED  # so that it rests until the driver's own program runs
    with contextlib.ExitStack() as opened:
        opened.enter_context(controller)
        for command_name in ("shield", "drive"):
            one = [sys.executable, "-m", "armguard", command_name, str(cell), *addresses]
            process = opened.enter_context(
                subprocess.Popen(one, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL)
            )
            opened.callback(process.kill)
        publisher = opened.enter_context(Publisher(places["joints"]))
        reader = opened.enter_context(VerdictReader(places["verdicts"]))
        assert publisher.wait(5.0 * PATIENCE), "its kernels may have to be compiled first"
        wait_until(lambda: reader.latest(0.1) and reader.command and reader.command.times)
        goal = controller.q + np.array([0.3, 0.0, -0.2, 0.0, 0.0, 0.5])
        pauses, again = Pauses(), 0.0

        def has_arrived():
            # A busy machine may hold the driver up so long that it brakes and wants another goal.
            nonlocal again
            if time.monotonic() > again:
                pauses.wait()
                path = np.stack([controller.q, goal])
                publisher.goal(time.monotonic() + PATIENCE, JOINTS, paths=[(path, None)])
                again = time.monotonic() + 10.0
            reader.latest()
            return np.abs(controller.q - goal).max() < 0.01

        wait_until(has_arrived)


@pytest.mark.hazard("H-15")
def test_another_robot_than_that_of_the_cell_is_refused():
    with UrController(find_host(), "UR10") as controller:
        options = msgspec.structs.replace(OPTIONS, host=controller.host)
        said = r"is a UR10 with URSoftware 5\.12\..*, no UR5e"
        with pytest.raises(ArmguardError, match=said):
            watch(options, lambda line: None, lambda: False, 60.0)
        assert controller.received == [], "nothing is ordered of a robot that is another one"


def test_a_report_is_plain_data():
    assert json.loads(json.dumps(Report(Counts()).__struct_fields__))


@pytest.mark.skipif("ARMGUARD_DRIVE_MINUTE" not in os.environ, reason="takes more than a minute")
def test_a_minute_at_full_rate_with_a_stop_every_other_second(tmp_path):
    with DrivenCell(tmp_path, "--json", timeout=0.2) as cell:
        cell.wait_until_moving()
        begun, reached, rested = time.monotonic(), [], []
        while time.monotonic() - begun < 60.0:
            time.sleep(0.5)
            seen = len(cell.controller.received)
            cell.monitor.tell(Level.STOP)
            wait_until(lambda: cell.controller.slider == 0.01)
            told = next(
                one.time for one in cell.controller.received[seen:] if one.order == "slider"
            )
            reached.append(told - cell.monitor.changed)
            cell.wait_until_resting()
            rested.append(time.monotonic() - cell.monitor.changed)
            wait_until(lambda: cell.controller.program == PAUSED)
            cell.monitor.tell(Level.CLEAR)
            cell.wait_until_moving()
        duration = time.monotonic() - begun
        stamps = np.array([state.stamp for _, state in cell.monitor.states])
        assert cell.end() == 0
        report = json.loads(cell.output)
        sys.stderr.write(
            f"{len(reached)} stops in {duration:.1f} s, {len(stamps) / duration:.0f} states/s; "
            f"STOP to slider p50 {1e3 * np.median(reached):.1f}, "
            f"p99 {1e3 * np.percentile(reached, 99):.1f}, max {1e3 * max(reached):.1f} ms; "
            f"at rest within {max(rested):.2f} s; {report}\n"
        )
        assert report["lost"] == 0
        assert np.percentile(reached, 99) < 0.05
