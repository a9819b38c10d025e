"""Ends processes of armguard: on signals, and with the process that started them.

No thread is needed: a timer's signal checks the parent, even while kernels compile.
"""

from __future__ import annotations

import atexit
import contextlib
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from types import FrameType

PARENT_CHECK_INTERVAL = 0.25
"""Between two checks that the parent is still there, in [s]."""

COMPLAINT = 1
"""Exit code of a process that failed while it worked, or that found a problem."""

INTERRUPTED = 130
"""Exit code of a process that was interrupted before it had a result: 128 + SIGINT."""


@contextlib.contextmanager
def termination_as_interrupt() -> Iterator[None]:
    """Context in which SIGTERM raises KeyboardInterrupt, so that there is one way to end."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


@contextlib.contextmanager
def noted_interrupts() -> Iterator[Callable[[], bool]]:
    """Context in which the first interrupt is noted; the next one raises KeyboardInterrupt.

    An exception can be lost: Python ignores it in a destructor, and in some compiled code, such as
    ZeroMQ's frames. A loop that checks the note in every turn loses no interrupt, and ends between
    two turns. Only the main thread can note interrupts; in another thread nothing is noted.

    Yields:
        A function: whether there was such a signal.
    """
    noted: list[int] = []
    replaced: list[int] = []

    def restore() -> None:
        while replaced:
            signal.signal(replaced.pop(), signal.default_int_handler)

    def note(number: int, frame: FrameType | None) -> None:
        noted.append(number)
        restore()

    if threading.current_thread() is threading.main_thread():
        for number in (signal.SIGINT, signal.SIGTERM):
            if signal.getsignal(number) is signal.default_int_handler:
                replaced.append(number)
                signal.signal(number, note)
    try:
        yield lambda: bool(noted)
    finally:
        restore()


def end_with(parent: int) -> None:
    """Send this process SIGTERM as soon as process `parent` is no longer its parent."""

    def check_parent(number: int, frame: FrameType | None) -> None:
        if os.getppid() != parent:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            os.kill(os.getpid(), signal.SIGTERM)

    signal.signal(signal.SIGALRM, check_parent)
    # While Python shuts down its handlers are gone already, and an alarm would kill.
    atexit.register(signal.setitimer, signal.ITIMER_REAL, 0.0)
    signal.setitimer(signal.ITIMER_REAL, PARENT_CHECK_INTERVAL, PARENT_CHECK_INTERVAL)


def describe_end(code: int) -> str:
    """How a process ended, in words, from an exit code of `subprocess`."""
    if code >= 0:
        return f"with exit code {code}"
    try:
        return f"by {signal.Signals(-code).name}"
    except ValueError:
        return f"by signal {-code}"


def complain(text: str) -> None:
    """Write one line on standard error."""
    sys.stderr.write(f"armguard: {text}\n")
