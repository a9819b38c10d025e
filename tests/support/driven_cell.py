"""A cell that a driver drives: a simulated controller, a stand-in for the monitor, and the driver.

The driver is `armguard drive` as a process of its own, with the client library of the maker's
robots in it. The stand-in publishes verdicts of one level at a rate, and keeps the joint states.
"""

import itertools
import os
import signal
import subprocess
import sys
import threading
import time

import zmq

from armguard.drivers.options import DriveOptions
from armguard.lab.simulation.ur_controller import UrController
from armguard.messages.incoming import decode
from armguard.streams.nodes import VerdictPublisher
from armguard.verdict import Level
from support.verdict_samples import verdict
from support.waiting import wait_until

PERIOD, VALIDITY = 0.002, 0.05
"""Between two verdicts of the stand-in, and how long each is valid, in [s]: a busy machine must not
make it expire."""

AGREED = f"\n[thresholds]\nlatency = {VALIDITY - 0.001:.6g}\n"
"""What a cell file says of that: it is a period, of a monitor's usual 1000 Hz, and the latency."""

CELL = """
sources = {{}}
[robot]
name = "ur5e"
[robot.driver]
name = "ur"
host = "{host}"
model = "UR5e"
timeout = {timeout}
{more}
"""

OPTIONS = DriveOptions(
    driver="ur",
    host="127.0.0.1",
    model="UR5e",
    rate=500.0,
    timeout=0.1,
    names=("a", "b"),
    speed=1.0,
    stop_within=1.0,
    deceleration=4.0,
    validity=2.0,
    payload=5.0,
    joints=("ipc:///joints",),
    verdicts="ipc:///verdicts",
)
"""Of a driver's process, as good as any."""

_hosts = itertools.count(1)


def find_host():
    """An address of this machine that no other test has."""
    number = next(_hosts)
    return f"127.{os.getpid() // 250 % 250 + 1}.{os.getpid() % 250 + 1}.{number % 250 + 1}"


class StandIn:
    """Publishes verdicts and keeps joint states; a context.

    Attributes:
        states: Joint states that have come, with the time of each.
    """

    def __init__(self, folder):
        self.joints, self.verdicts = f"ipc://{folder}/joints", f"ipc://{folder}/verdicts"
        self.states = []
        self.level, self.scale = Level.CLEAR, 1.0
        self.is_silent = False
        self.changed = 0.0
        self.make_command = None
        """Makes the command of a tick from its time and number; None: there is no shield."""
        self._sequence = 0
        self._is_replaced = False
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._ending.set()
        self._thread.join()

    def start_anew(self):
        """Let another monitor take its place."""
        self._is_replaced = True

    def tell(self, level, scale=1.0):
        """From now on this level."""
        self.scale, self.level, self.changed = scale, level, time.monotonic()

    def _serve(self):
        publisher = VerdictPublisher(self.verdicts, 0.0)
        socket = zmq.Context.instance().socket(zmq.SUB)
        socket.subscribe(b"")
        socket.bind(self.joints)
        tick = time.monotonic()
        while not self._ending.is_set():
            while socket.poll(0):
                self.states.append((time.monotonic(), decode(socket.recv())))
            if self._is_replaced:
                publisher.close()
                publisher = VerdictPublisher(self.verdicts, 0.0)
                self._is_replaced = False
            if not self.is_silent:
                self._sequence += 1
                now = time.monotonic()
                publisher.publish(
                    verdict(
                        self.level,
                        stamp=now,
                        sequence=self._sequence,
                        speed_scale=0.0 if self.level is Level.STOP else self.scale,
                        valid_until=now + VALIDITY,
                    )
                )
                if self.make_command is not None:
                    publisher.command(self.make_command(now, self._sequence))
            tick += PERIOD
            time.sleep(max(0.0, tick - time.monotonic()))
        publisher.close()
        socket.close(0)


class DriverProcess:
    """`armguard drive` and a stand-in for the monitor; a context.

    Args:
        folder: For its files.
        text: The cell file.
        options: Of the command.

    Attributes:
        environment: Of the process.
    """

    def __init__(self, folder, text, *options):
        self.monitor = StandIn(folder)
        self.cell = folder / "cell.toml"
        self.cell.write_text(text + AGREED)
        self.lines = []
        self.output = ""
        self.environment = None
        self._options = options
        self.process = None

    def __enter__(self):
        self.monitor.__enter__()
        self.start()
        return self

    def start(self):
        """Start the driver."""
        self._close()
        addresses = ["--joints", self.monitor.joints, "--verdicts", self.monitor.verdicts]
        addresses += ["--obstacles", self.monitor.joints]
        command = [sys.executable, "-m", "armguard", "drive", str(self.cell), *addresses]
        self.process = subprocess.Popen(
            [*command, *self._options],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=self.environment,
        )
        self._reader = threading.Thread(target=self._read, args=[self.process], daemon=True)
        self._reader.start()

    def _read(self, process):
        self.lines.extend(line.rstrip("\n") for line in process.stderr)

    def _close(self):
        if self.process is None:
            return
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        self.process.stdout.close()
        self._reader.join()
        self.process.stderr.close()

    def __exit__(self, *_):
        self._close()
        self.monitor.__exit__()

    def end(self):
        """End the driver as Ctrl-C does; its exit code."""
        self.process.send_signal(signal.SIGINT)
        self.output = self.process.stdout.read()
        return self.process.wait()

    def kill_driver(self, number=signal.SIGKILL):
        """Send a signal to the process that holds the connection."""
        os.kill(self.find_driver(), number)

    def find_driver(self):
        """The process that holds the connection; None while there is none."""
        path = f"/proc/{self.process.pid}/task/{self.process.pid}/children"
        with open(path) as file:
            children = file.read().split()
        return int(children[0]) if children else None

    def wait_for(self, text):
        """Return when a line of the driver has this in it."""
        wait_until(lambda: self.has(text) or self.process.poll() is not None)
        assert self.has(text), self.lines

    def wait_for_states(self):
        """Return when the first joint state has come: the driver drives."""
        wait_until(lambda: self.monitor.states or self.process.poll() is not None)
        assert self.monitor.states, self.lines

    def has(self, text):
        """Whether a line of the driver has this in it."""
        return any(text in line for line in self.lines)


class DrivenCell(DriverProcess):
    """A simulated controller, and what drives it; a context.

    Args:
        folder: For its files.
        more: Lines of `[robot.driver]`, and tables behind it.
        timeout: As there, in [s]: a busy machine must not make anything silent for so long.
        options: Of the command.
        controller: Keywords of the controller.
    """

    def __init__(self, folder, *options, more="", timeout=0.5, **controller):
        self.host = find_host()
        super().__init__(folder, CELL.format(host=self.host, more=more, timeout=timeout), *options)
        self.controller = UrController(self.host, **controller)

    def __enter__(self):
        self.controller.__enter__()
        return super().__enter__()

    def __exit__(self, *_):
        super().__exit__()
        self.controller.__exit__()

    def wait_until_driving(self, other_than=None):
        """Return when a driver is connected that is another one than that process."""
        wait_until(lambda: self.find_driver() not in (None, other_than))
        wait_until(lambda: self.controller.clients == 1)
        seen = len(self.monitor.states)
        wait_until(lambda: len(self.monitor.states) > seen + 10 and self.controller.slider == 1.0)

    def play(self):
        """Somebody starts the program on the robot, which then runs."""
        assert self.controller.pace <= 0.011, "nothing moves before that"
        assert self.controller.play()
        wait_until(lambda: self.controller.pace > 0.99)

    def wait_until_moving(self):
        """Return when the driver drives, and the program runs at full speed."""
        self.wait_for_states()
        wait_until(lambda: self.controller.pace > 0.99 or self.process.poll() is not None)
        assert self.process.poll() is None, self.lines

    def wait_until_resting(self):
        """Return when the arm rests."""
        wait_until(lambda: self.controller.pace == 0.0)
