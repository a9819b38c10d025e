"""Watches the demo's processes: shows their output, and reports ended ones.

A monitor must go on without its observers, and does. A demo without its robot or its perception
shows nothing but STOP, so it ends, and says why.
"""

from __future__ import annotations

import contextlib
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import msgspec
import zmq
from rich.console import Console
from rich.status import Status

from armguard.app.processes import describe_end, noted_interrupts
from armguard.jit.progress import COMPILING
from armguard.view.messages import FrameMessage, decode_message
from armguard.view.process import ViewProcess

REFRESH = 0.1
"""Between two looks at the processes, in [s]."""

END_TIMEOUT = 10.0
"""How long the monitor may take to end each time it is asked to, in [s]."""

WAITING = "starting"


class Watcher:
    """Follows a demo until it ends.

    Args:
        monitor: `armguard run --json`, its standard output a pipe.
        parts: The other processes that the demo cannot do without, by name.
        log: File that all of them write to when something is wrong.
        console: Where to show it.
    """

    def __init__(
        self,
        monitor: subprocess.Popen[bytes],
        parts: Mapping[str, subprocess.Popen[bytes]],
        log: Path,
        console: Console,
    ) -> None:
        self._monitor = monitor
        self._parts = parts
        self._page: ViewProcess | None = None
        self._log = log
        self._told = 0
        self._console = console
        self._waiting: Status | None = None
        """What is shown on a terminal until the first frame comes."""

    def run(
        self, frames: str, open_page: Callable[[], ViewProcess] | None = None
    ) -> tuple[dict[str, Any] | None, str]:
        """Wait for the end, or Ctrl-C.

        Args:
            frames: Address of the feed of frames, the first of which ends the start.
            open_page: Starts the view, while a Ctrl-C is already answered by a summary. The demo
                goes on without a view that ends.

        Returns:
            The monitor's summary, if it came to one, and what went wrong, empty if nothing did.

        Raises:
            KeyboardInterrupt: Ctrl-C came before there was a summary.
        """
        interrupted, problem = False, ""
        try:
            if open_page is not None:
                self._page = open_page()
            problem = self._wait(frames)
        except KeyboardInterrupt:
            interrupted = True
        output = self._end_monitor()
        code = self._monitor.returncode
        if code == 0 and output:
            self._tell_log()
            summary: dict[str, Any] = msgspec.json.decode(output)
            return summary, problem
        if interrupted:
            raise KeyboardInterrupt
        words = self._read_log()
        if "\n" in words:
            sys.stderr.write(f"{words}\n")
            words = ""
        end = f"the monitor ended {describe_end(code)}"
        return None, problem or (f"{end}: {words}" if words else end)

    def _wait(self, frames: str) -> str:
        """Wait until the monitor or another process ends; the reason, if it is a problem.

        An interrupt is noted, and raised when the socket is closed: one that is raised while ZeroMQ
        makes a socket leaves that open, and then the context never ends.
        """
        with noted_interrupts() as was_interrupted:
            context = zmq.Context()
            try:
                reader = context.socket(zmq.SUB)
                reader.set(zmq.CONFLATE, 1)
                reader.subscribe(b"")
                reader.connect(frames)
                self._follow(reader, lambda: was_interrupted() or self._ended())
            finally:
                context.destroy(linger=0)
        if was_interrupted():
            raise KeyboardInterrupt
        return self._describe_death()

    def _follow(self, reader: zmq.Socket[bytes], ended: Callable[[], bool]) -> None:
        """Show that it starts until the first frame of a feed, and wait until it has ended."""
        if not self._console.is_terminal:
            self._console.print(WAITING)
        with self._console.status(WAITING) as waiting:
            self._waiting = waiting if self._console.is_terminal else None
            while not ended() and not _has_frame(reader):
                pass
            self._waiting = None
        self._console.print("the arm is watched; Ctrl-C ends the demo with a summary")
        while not ended():
            time.sleep(REFRESH)

    def _ended(self) -> bool:
        self._tell_log()
        if self._page is not None and not self._page.running:
            self._console.print("the browser page has ended; the demo continues without it")
            self._page = None
        return self._monitor.poll() is not None or bool(self._describe_death())

    def _describe_death(self) -> str:
        for name, process in self._parts.items():
            code = process.poll()
            if code is not None:
                return f"the demo's {name} process ended {describe_end(code)}, so the demo ends"
        return ""

    def _end_monitor(self) -> bytes:
        """Ask the monitor for its summary, twice at most, and end it if it does not answer.

        Twice, since Python loses an interrupt that meets it in a destructor or a callback.
        """
        for _ in range(2):
            if self._monitor.poll() is None:
                self._monitor.terminate()
            with contextlib.suppress(subprocess.TimeoutExpired):
                return self._monitor.communicate(timeout=END_TIMEOUT)[0]
        self._monitor.kill()
        return self._monitor.communicate()[0]

    def _tell_log(self) -> None:
        """Show what the processes wrote since it was last read."""
        words = self._read_log()
        if words:
            sys.stderr.write(f"{words}\n")

    def _read_log(self) -> str:
        """What was added since it was last read; a line that is still being written waits."""
        with self._log.open("rb") as log:
            log.seek(self._told)
            lines, newline, _ = log.read().rpartition(b"\n")
        self._told += len(lines) + len(newline)
        words = lines.decode(errors="replace").splitlines()
        # Progress stands in one place, whatever else is told, and only on a terminal.
        progress = [line.partition(COMPILING)[2] for line in words if COMPILING in line]
        if progress and self._waiting is not None:
            self._waiting.update(f"{WAITING}: {COMPILING}{progress[-1]}")
        return "\n".join(line for line in words if COMPILING not in line)


def _has_frame(reader: zmq.Socket[bytes]) -> bool:
    """Whether the loop runs: its first frame comes after the scene, which is published before."""
    if not reader.poll(round(1000 * REFRESH)):
        return False
    return isinstance(decode_message(reader.recv()), FrameMessage)
