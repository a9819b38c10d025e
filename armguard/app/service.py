"""What systemd is told of a run, where it asks: that it is ready, that ticks go on, that it stops.

The protocol is that of `sd_notify`: datagrams of a line each to the socket that is named by
`NOTIFY_SOCKET`. They are sent by a thread that looks at the number of ticks and nothing else, so
that a tick never sends; and a loop that hangs, or a process that is stopped, feeds no watchdog.
"""

from __future__ import annotations

import contextlib
import math
import os
import socket
import threading
from collections.abc import Callable, Mapping

READY_CHECK_INTERVAL = 0.05
"""Between two looks whether the first tick is done, in [s]."""


class ServiceNotifier:
    """Tells systemd of a loop from a thread of its own; a context. Without an address it is silent.

    Args:
        address: Of systemd's socket: a path, or a name after "@"; empty: there is none.
        timeout: After how long without a word systemd takes the service for dead, in [s]; half of
            it lies between two words. inf: it has no watchdog.
        count_ticks: How many ticks there were so far.
    """

    def __init__(self, address: str, timeout: float, count_ticks: Callable[[], int]) -> None:
        # A name after "@" stands in no folder: the kernel knows it by a leading zero.
        self._address = "\0" + address[1:] if address.startswith("@") else address
        self._interval = 0.5 * timeout
        self._count_ticks = count_ticks
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._serve, name="service", daemon=True)
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK)

    @classmethod
    def from_environment(
        cls, count_ticks: Callable[[], int], environment: Mapping[str, str] = os.environ
    ) -> ServiceNotifier:
        """The notifier that systemd asks for in its variables; a silent one where it asks nothing.

        Args:
            count_ticks: How many ticks there were so far.
            environment: Holds `NOTIFY_SOCKET`, `WATCHDOG_USEC` and `WATCHDOG_PID`, if anything.
        """
        timeout = math.inf
        # The watchdog may be meant for the process that started this one.
        if environment.get("WATCHDOG_PID", str(os.getpid())) == str(os.getpid()):
            with contextlib.suppress(ValueError):
                microseconds = int(environment.get("WATCHDOG_USEC", ""))
                timeout = 1e-6 * microseconds if microseconds > 0 else math.inf
        return cls(environment.get("NOTIFY_SOCKET", ""), timeout, count_ticks)

    def __enter__(self) -> ServiceNotifier:
        if self._address:
            self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ending.set()
        if self._address:
            self._thread.join()
            self._send("STOPPING=1")
        self._socket.close()

    def _serve(self) -> None:
        """Say once that ticks have begun, and from then on whether they go on."""
        while not (self._count_ticks() and self._send("READY=1")):
            if self._ending.wait(READY_CHECK_INTERVAL):
                return
        fed = 0
        while True:
            ticks = self._count_ticks()
            if ticks != fed and self._send("WATCHDOG=1"):
                fed = ticks
            # The longest wait that there is stands for "for ever".
            if self._ending.wait(min(self._interval, threading.TIMEOUT_MAX)):
                return

    def _send(self, state: str) -> bool:
        """Whether the words were taken; never waits for it."""
        try:
            self._socket.sendto(state.encode(), self._address)
        except (OSError, ValueError):  # no such socket, nothing reads it, or no name at all
            return False
        return True
