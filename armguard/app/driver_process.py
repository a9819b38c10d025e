"""The process of `armguard drive` that a run starts and supervises, from a separate thread."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping
from pathlib import Path

from armguard.app.processes import describe_end

REFUSED = 2
"""Exit code of a driver that can never drive this robot."""

RESTART_DELAY = 1.0
"""Between the end of a driver and the start of the next, in [s]."""

CHECK_INTERVAL = 0.1
"""Time between two checks whether it must end, in [s]."""

END_TIMEOUT = 8.0
"""How long a driver may take to end, besides `stop_within`, in [s]; the driver reports what it
waits for."""


class DriverProcess:
    """Drives the robot of a cell as long as the context lasts; restarts a driver that ends.

    Without a driver no joint states arrive, which is a STOP. A driver without a monitor stops its
    arm. So neither relies on the other.

    Args:
        cell: Its file.
        arm: Which arm, in a cell with several; empty where there is one.
        tell: Takes lines for people.
        stop_within: How long the arm may move after an order to pause, in [s].
        is_attended: Whether a person starts the first driver. By default this may be a service's
            restart, which acknowledges nothing.
    """

    def __init__(
        self,
        cell: Path,
        arm: str,
        tell: Callable[[str], None],
        stop_within: float,
        *,
        is_attended: bool = False,
    ) -> None:
        self._words = [sys.executable, "-P", "-m", "armguard", "drive", str(cell)]
        self._words += ["--arm", arm] if arm else []
        self._words += ["--parent", str(os.getpid())]
        self._words += [] if is_attended else ["--again"]
        self._tell = tell
        self._longest_end = END_TIMEOUT + stop_within
        self._is_told, self._is_ending = threading.Event(), threading.Event()
        # All is done by this thread: what it starts inherits no real-time scheduling.
        self._thread = threading.Thread(target=self._look_after, name="driver", daemon=True)

    def __enter__(self) -> DriverProcess:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._is_ending.set()
        self._is_told.set()
        self._thread.join()

    def start(self, addresses: Mapping[str, str]) -> None:
        """Start it once the monitor listens. Never blocks.

        Args:
            addresses: Of "joints", "obstacles" and "verdicts", as they are bound; "-" is standard
                input, which the driver cannot reach.
        """
        for name in ("joints", "obstacles", "verdicts"):
            self._words += [f"--{name}", addresses[name]] if addresses[name] != "-" else []
        self._is_told.set()

    def _look_after(self) -> None:
        self._is_told.wait()
        while not self._is_ending.is_set():
            with subprocess.Popen(
                self._words,
                stdin=subprocess.DEVNULL,
                stdout=sys.stderr,  # the summary of the run alone goes to standard output
                start_new_session=True,  # Ctrl-C reaches it through us
            ) as process:
                code = self._wait(process)
            if self._is_ending.is_set():
                return
            end = f"the robot's driver has ended {describe_end(code)}"
            if code == REFUSED:
                self._tell(f"{end}, and is not restarted: no joint states arrive")
                return
            self._tell(f"{end}, and is restarted")
            if "--again" not in self._words:
                self._words.append("--again")
            self._is_ending.wait(RESTART_DELAY)

    def _wait(self, process: subprocess.Popen[bytes]) -> int:
        """The exit code of a process, which is signalled to end when the context ends."""
        while not self._is_ending.is_set():
            with contextlib.suppress(subprocess.TimeoutExpired):
                return process.wait(CHECK_INTERVAL)
        process.send_signal(signal.SIGINT)
        try:
            return process.wait(self._longest_end)
        except subprocess.TimeoutExpired:
            process.kill()
            self._tell(
                "the robot's driver did not end and was killed: check that the arm is at rest"
            )
            return process.wait()
