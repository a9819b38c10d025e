"""The running cell of the campaign: real processes and sockets, and what is done to them.

    camera ──obstacles──▶ armguard run ──verdicts──▶ drives ──▶ what truly happened
                             ▲    │ └──recording       │
                             └────┼──joints── driver ◀─┘
                                  └──frames──▶ view

Nothing is a short cut: `armguard run` is started by its command line, and ends by signals.
"""

from __future__ import annotations

import contextlib
import os
import resource
import signal
import socket
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import IO
from urllib.parse import urlsplit

import msgspec

from armguard.exceptions import ArmguardError
from armguard.lab.faults import nodes
from armguard.lab.faults.catalogue import Fault
from armguard.lab.faults.disturbance import Disturbance
from armguard.lab.faults.listening import LineLog, VerdictLog
from armguard.lab.faults.scene import CELL, ROBOT
from armguard.lab.simulation.processes import start_device, start_monitor
from armguard.robot.robot import Robot
from armguard.streams.nodes import Publisher
from armguard.view.process import ViewProcess, launch

START_TIMEOUT = 600.0
"""How long the monitor may take to start, in [s]: the first time, it compiles."""

END_TIMEOUT = 60.0
"""How long a process may take to end when it is told to, in [s]."""

SLOW_SHARE, SLOW_CYCLE = 0.05, 0.5
"""A slow disk lets the process that writes go on for so much of each so many seconds."""

STREAM, TAKEN_IN = "/feed", b"HTTP/1.1 101"
"""Where a browser gets what the page draws, and the begin of the answer to one that is let in."""

TOKEN = "campaign"
"""What a reset brings."""


class FaultyCell:
    """Starts the processes of the cell, strikes them, and ends them all; a context.

    Args:
        folder: For sockets, recordings and logs.

    Attributes:
        start: When the people were farthest, on the machine's monotonic clock, in [s].
        verdicts: What is heard of the monitor.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.truth = folder / "truth"
        self.recordings = folder / "recordings"
        self.recordings.mkdir()
        self.start = time.monotonic()
        self.verdicts = VerdictLog(self._address("verdicts"))
        self._joints = len(Robot.load(ROBOT).joints)
        self._cell = folder / "cell.toml"
        self._cell.write_text(CELL)
        self._logs: list[LineLog] = []
        self._resources = contextlib.ExitStack()
        self._processes: dict[str, subprocess.Popen[bytes]] = {}
        self._view: ViewProcess | None = None

    @property
    def lines(self) -> list[tuple[float, str]]:
        """What monitors wrote on standard error, with the times at which it came."""
        return [line for log in self._logs for line in log.lines]

    def __enter__(self) -> FaultyCell:
        try:
            self._log: IO[bytes] = self._resources.enter_context((self.folder / "log").open("ab"))
            self._resources.callback(self._end)
            self._resources.enter_context(self.verdicts)
            self._reset = self._resources.enter_context(Publisher(self._address("joints")))
            self._start_monitor()
            for name in ("drives", "driver", "camera"):
                self._start_node(name)
            self._start_view()
            self._wait(lambda: bool(self.verdicts.heard))
            self._wait(lambda: self.truth.exists())
        except BaseException:
            self._resources.close()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self._resources.close()

    def is_moving(self) -> bool:
        """Whether the arm truly moves at present."""
        last = self.truth.stat().st_size // (8 * nodes.row_width(self._joints)) - 1
        rows = nodes.read_rows(self.truth, self._joints, max(last, 0))
        return bool(rows[-1:, -self._joints :].any())

    def reset(self) -> None:
        """End a latched STOP."""
        self._reset.reset(TOKEN)

    def strike(self, fault: Fault, begin: float) -> Callable[[], object]:
        """Do what a fault does.

        Args:
            fault: The fault.
            begin: When a disturbed stream is disturbed from on, in [s]; a process is struck now.

        Returns:
            What ends it.
        """
        if fault.act == "disturb":
            disturbance = Disturbance(
                kind=fault.kind,
                begin=begin,
                end=begin + fault.duration,
                field=fault.field,
                value=fault.value,
            )
            orders = self._processes[fault.part].stdin
            assert orders is not None
            orders.write(msgspec.json.encode(disturbance) + b"\n")
            orders.flush()
            return lambda: None  # it ends by itself
        time.sleep(max(0.0, begin - time.monotonic()))
        if fault.act == "hang":
            return self._hang_browser()
        pid = self._find(fault.part)
        if fault.act == "full":
            return _fill_disk(pid)
        if fault.act == "slow":
            return _slow_down(pid, begin + fault.duration)
        os.kill(pid, signal.SIGKILL if fault.act == "kill" else signal.SIGSTOP)
        if fault.act == "stop":
            return lambda: os.kill(pid, signal.SIGCONT)
        return lambda: self._revive(fault.part)

    def check(self) -> None:
        """See that all processes are there.

        Raises:
            ArmguardError: One has ended that nobody ended.
        """
        for name, process in self._processes.items():
            if process.poll() is not None:
                words = (self.folder / "log").read_text(errors="replace")
                raise ArmguardError(
                    f"the {name} process", f"has ended by itself ({process.returncode}): {words}"
                )

    def _address(self, name: str) -> str:
        return f"ipc://{self.folder}/{name}"

    def _wait(self, condition: Callable[[], bool]) -> None:
        deadline = time.monotonic() + START_TIMEOUT
        while not condition():
            self.check()
            if time.monotonic() > deadline:
                raise ArmguardError("armguard run", f"did not start within {START_TIMEOUT:g} s")
            time.sleep(0.02)

    def _start_monitor(self) -> None:
        names = ("obstacles", "joints", "verdicts", "view")
        process = start_monitor(
            self._cell,
            {name: self._address(name) for name in names},
            *("--reset-token", TOKEN, "--record", str(self.recordings)),
            log=subprocess.PIPE,
        )
        assert process.stderr is not None
        self._logs.append(LineLog(process.stderr))
        self._processes["monitor"] = process

    def _start_node(self, name: str) -> None:
        made: dict[str, nodes.Node] = {
            "drives": nodes.Drives(verdicts=self._address("verdicts"), truth=str(self.truth)),
            "driver": nodes.Driver(joints=self._address("joints"), truth=str(self.truth)),
            "camera": nodes.Camera(obstacles=self._address("obstacles"), start=self.start),
        }
        self._processes[name] = start_device(made[name], self._log, takes_orders=True)

    def _start_view(self) -> None:
        self._view = launch(self._address("view"))

    def _find(self, part: str) -> int:
        """The process that stands for a part."""
        if part == "view":
            assert self._view is not None
            return self._view.pid
        if part != "recorder":
            return self._processes[part].pid
        monitor = self._processes["monitor"].pid
        for pid in Path(f"/proc/{monitor}/task/{monitor}/children").read_text().split():
            if b"armguard.recording" in Path(f"/proc/{pid}/cmdline").read_bytes():
                return int(pid)
        raise ArmguardError("the recorder's process", "is not there")

    def _revive(self, part: str) -> None:
        """Start anew what was killed; a recording ends with its writer."""
        if part == "view":
            assert self._view is not None
            self._view.close()
            self._start_view()
        elif part == "monitor":
            _dispose(self._processes.pop("monitor"))
            self._start_monitor()
        elif part != "recorder":
            _dispose(self._processes.pop(part))
            self._start_node(part)

    def _hang_browser(self) -> Callable[[], object]:
        """Open the page's stream as a browser does, and never read from it."""
        assert self._view is not None
        page = urlsplit(self._view.url)
        assert page.hostname is not None
        browser = socket.create_connection((page.hostname, page.port or 80))
        browser.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        browser.sendall(
            f"GET {STREAM} HTTP/1.1\r\nHost: {page.netloc}\r\nUpgrade: websocket\r\n"
            "Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
            "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n".encode()
        )
        answer = browser.recv(len(TAKEN_IN))
        if answer != TAKEN_IN:
            browser.close()
            raise ArmguardError(
                f"the page's {STREAM}", f"answers {answer!r}", expected=repr(TAKEN_IN)
            )
        return browser.close

    def _end(self) -> None:
        """End all processes, the monitor first, so that its recording is whole."""
        if self._view is not None:
            self._view.close()
        monitor = self._processes.pop("monitor", None)
        if monitor is not None:
            with contextlib.suppress(ProcessLookupError):
                os.kill(monitor.pid, signal.SIGCONT)
            monitor.terminate()
            with contextlib.suppress(subprocess.TimeoutExpired):
                monitor.wait(END_TIMEOUT)
            _dispose(monitor)
        for process in self._processes.values():
            _dispose(process)
        for log in self._logs:
            log.close()


def _dispose(process: subprocess.Popen[bytes]) -> None:
    """End a process if it has not ended, and give back what leads to it."""
    process.kill()
    process.wait()
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            pipe.close()


def _slow_down(pid: int, end: float) -> Callable[[], object]:
    """Let a process go on for a small share of its time, as one does that waits for a disk."""
    while (now := time.monotonic()) < end:
        goes_on = now % SLOW_CYCLE < SLOW_SHARE * SLOW_CYCLE
        os.kill(pid, signal.SIGCONT if goes_on else signal.SIGSTOP)
        time.sleep(0.005)
    return lambda: os.kill(pid, signal.SIGCONT)


def _fill_disk(pid: int) -> Callable[[], object]:
    """Let no file of a process grow, as on a disk that is full."""
    limits = resource.prlimit(pid, resource.RLIMIT_FSIZE)
    resource.prlimit(pid, resource.RLIMIT_FSIZE, (0, limits[1]))
    return lambda: resource.prlimit(pid, resource.RLIMIT_FSIZE, limits)
