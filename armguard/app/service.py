"""Notifies systemd of the state of a run: ready, watchdog alive, stopping.

The protocol is that of `sd_notify`: datagrams of one line each to the socket in `NOTIFY_SOCKET`. A
thread sends them, so that no tick has to. The thread notifies the watchdog only while the number of
ticks grows. So the watchdog fires if the loop hangs or the process is stopped.
"""

from __future__ import annotations

import contextlib
import math
import os
import socket
import threading
from collections.abc import Callable, Mapping

READY_CHECK_INTERVAL = 0.05
"""Time between two checks that the first tick is done, in [s]."""


class ServiceNotifier:
    """Notifies systemd of a loop, from its own thread; a context manager. Silent without address.

    Args:
        address: Address of systemd's socket: a path, or a name after "@"; empty: none.
        timeout: Timeout of systemd's watchdog in [s]; messages are sent at half of it. inf: no
            watchdog.
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
        """The notifier that systemd's variables request; a silent one if they are not set.

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
        """Send READY after the first tick, and then a watchdog message whenever ticks went on."""
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
        """Send a message without waiting; returns whether it was sent."""
        try:
            self._socket.sendto(state.encode(), self._address)
        except (OSError, ValueError):  # no such socket, nothing reads it, or no name at all
            return False
        return True
