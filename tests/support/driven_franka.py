"""A Franka that a driver drives: franka-sim as a process of its own, a stand-in, and the driver.

`ARMGUARD_FRANKA_SIM` names the Python of the environment that franka-sim is installed in: it needs
another version of numpy than armguard.
"""

import ast
import math
import os
import signal
import subprocess
from pathlib import Path

from support.driven_cell import DriverProcess, find_host
from support.waiting import wait_until

PYTHON = os.environ.get("ARMGUARD_FRANKA_SIM", "")

IDLE, MOVING, GUIDING, REFLEX, USER_STOPPED = 1, 2, 3, 4, 5
"""Modes of the robot."""

HOME = (0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.785)
"""Where the simulated arm begins, in [rad]."""

WAYPOINTS = [[0.6, 0.1, 0.0, -1.57, 0.0, 1.57, 0.785], [-0.6, 0.2, 0.1, -1.8, 0.0, 1.57, 0.785]]

CELL = """
sources = {{}}
[robot]
name = "panda"
operating = {{ velocity = 0.3, acceleration = 0.2 }}
[robot.driver]
name = "franka"
host = "{host}"
model = "FR3"
timeout = 0.5
{more}
"""


class FrankaPeer:
    """The simulated robot; a context."""

    def __init__(self):
        self.host = find_host()
        self.process = None

    def __enter__(self):
        self.process = subprocess.Popen(
            [PYTHON, str(Path(__file__).with_name("franka_peer.py")), self.host],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        wait_until(lambda: self.ask("server.server_socket is not None"))
        return self

    def __exit__(self, *_):
        self.process.kill()
        self.process.wait()
        self.process.stdin.close()
        self.process.stdout.close()

    def ask(self, expression):
        """The value of an expression there."""
        return ast.literal_eval(self.order(f"answer = {expression}"))

    def order(self, line):
        """Have a line of Python run there."""
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()
        answer = self.process.stdout.readline().rstrip("\n")
        assert not answer.startswith("Traceback"), answer
        return answer

    def enforce(self, *, communication, limits):
        """Whether a driver that stalls, and positions beyond limits, end a motion by a reflex."""
        self.order(f"server.enforce_comm_constraints = server.comm.enforce = {communication}")
        self.order(f"server.enforce_motion_limits = {limits}")

    @property
    def q(self):
        return self.ask("see(server)")[0]

    @property
    def speed(self):
        return self.ask("see(server)")[1]

    @property
    def mode(self):
        return self.ask("see(server)")[2]

    def set_state(self, **values):
        """Set parts of what the robot says of itself."""
        self.order(f"server.robot_state.state.update({values!r})")

    def freeze(self):
        self.process.send_signal(signal.SIGSTOP)

    def thaw(self):
        self.process.send_signal(signal.SIGCONT)


class DrivenFranka(DriverProcess):
    """One with a peer that the test has started.

    Args:
        folder: For its files.
        peer: The robot.
        options: Of the command.
        more: Lines of `[robot.driver]`, and tables behind it.
    """

    def __init__(self, folder, peer, *options, more=f"waypoints = {WAYPOINTS}"):
        super().__init__(folder, CELL.format(host=peer.host, more=more), *options)
        self.peer = peer

    def start(self):
        """Start the driver, as a person does who has seen why the arm stopped."""
        super().start()
        self._seen = len(self.lines)

    def wait_until_moving(self, slowest=0.1, fastest=math.inf):
        """Return when the program moves the arm; it is started again where the machine stalls."""

        def moves():
            if any("program stopped" in line for line in self.lines[self._seen :]):
                self.start()
            return slowest < self.peer.speed < fastest or self.process.poll() is not None

        wait_until(moves)
        assert self.process.poll() is None, self.lines

    def wait_until_reading(self):
        """Return when joint states come, from now on."""
        seen = len(self.monitor.states)
        wait_until(lambda: len(self.monitor.states) > seen + 50)

    def wait_until_resting(self):
        """Return when the arm rests, and no motion runs."""
        wait_until(lambda: self.peer.speed < 0.01 and self.peer.mode != MOVING)
