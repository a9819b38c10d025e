"""A simulated arm in a ROS 2 graph, built from docs/nodes on Fast DDS, and what drives it."""

import functools
import os
import random
import shutil
import subprocess
import tempfile
import threading
from pathlib import Path

import pytest

from support.driven_cell import DriverProcess
from support.waiting import wait_until

ROOT = Path(__file__).parents[2]
LOOPBACK = f"file://{ROOT / 'demos' / 'ros2_loopback.xml'}"
"""Keeps Cyclone DDS on this machine."""

CELL = """
[robot]
name = "panda"
[robot.driver]
name = "ros2"
domain = {domain}
timeout = 0.5
trajectory = "/joint_trajectory_controller/joint_trajectory"
[robot.driver.obstacles.camera]
topic = "/people"
type = "geometry_msgs/msg/PoseArray"
radius = 0.2
[sources.camera]
{more}
"""


def find_domain():
    """A domain that no other test has."""
    return random.SystemRandom().randrange(10, 100)


@functools.cache
def build_arm():
    """The path of the program; skips where it cannot be built."""
    if not Path("/usr/include/fastdds").exists() or not shutil.which("g++"):
        pytest.skip("no g++ or no Fast DDS: apt-get install g++ libfastrtps-dev")
    program = Path(tempfile.mkdtemp()) / "ros2_arm"
    source = ROOT / "docs" / "nodes" / "ros2_arm.cpp"
    command = ["g++", "-std=c++17", source, "-lfastrtps", "-lfastcdr", "-o", program]
    subprocess.run(command, check=True)
    return program


class Ros2Arm:
    """The simulated arm, as a process; a context.

    Attributes:
        places: Times, positions and velocities of its first joint.
        speeds: Times of speeds that it heard, and the speeds.
        levels: Levels of diagnostics that it heard, and their messages.
        trajectories: Times of trajectories that it heard.
    """

    def __init__(self, domain):
        self.domain = domain
        self.places, self.speeds, self.levels, self.trajectories = [], [], [], []

    def __enter__(self):
        self.process = subprocess.Popen(
            [build_arm(), str(self.domain)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self._reader = threading.Thread(target=self._read, args=[self.process.stdout], daemon=True)
        self._reader.start()
        return self

    def __exit__(self, *_):
        self.process.kill()
        self.process.wait()
        self._reader.join()
        self.process.stdin.close()
        self.process.stdout.close()

    def _read(self, lines):
        for line in lines:
            word, *rest = line.split()
            if word == "at" and len(rest) == 3:
                self.places.append(tuple(map(float, rest)))
            elif word == "speed" and len(rest) == 2:
                self.speeds.append((float(rest[1]), float(rest[0])))
            elif word == "trajectory" and len(rest) == 2:
                self.trajectories.append(float(rest[1]))
            elif word == "level":
                self.levels.append((int(rest[0]), " ".join(rest[1:])))

    def tell(self, line):
        """Send it a line."""
        self.process.stdin.write(f"{line}\n")
        self.process.stdin.flush()

    def acknowledge_hold(self, restarted):
        """Let it go on after a restart, once diagnostics ask for that."""
        asked = f"STOP: hold: the {restarted} was restarted; publish true to /armguard/acknowledge"
        wait_until(lambda: self.levels[-1][1].startswith(asked))
        self.wait_until_resting()
        self.tell("acknowledge")

    @property
    def speed(self):
        """How fast its first joint is, in [rad/s]."""
        return abs(self.places[-1][2]) if self.places else 0.0

    def find_fastest(self, since):
        """The greatest speed of its first joint since a time, in [rad/s]."""
        return max((abs(v) for t, _, v in self.places if t >= since), default=0.0)

    def wait_until_moving(self):
        """Return when it moves; its first joint stands at the end of each swing."""
        wait_until(lambda: self.speed > 0.1)

    def wait_until_resting(self):
        """Return when it has rested for a while."""
        wait_until(lambda: len(self.places) > 50 and self._rests())

    def _rests(self):
        return all(abs(v) < 1e-6 for _, _, v in self.places[-50:])


class GraphCell(DriverProcess):
    """A ROS 2 graph on this machine with what drives its arm; a context.

    Args:
        folder: For its files.
        options: Of the command.
        more: Tables behind the usual ones.
    """

    def __init__(self, folder, *options, more=""):
        self.domain = find_domain()
        super().__init__(folder, CELL.format(domain=self.domain, more=more), *options)
        self.environment = os.environ | {"CYCLONEDDS_URI": LOOPBACK}
        self.arm = Ros2Arm(self.domain)

    def __enter__(self):
        self.arm.__enter__()
        return super().__enter__()

    def __exit__(self, *_):
        super().__exit__()
        self.arm.__exit__()

    def list_messages(self, kind):
        """What has come to the monitor of one kind."""
        return [one for _, one in list(self.monitor.states) if isinstance(one, kind)]
