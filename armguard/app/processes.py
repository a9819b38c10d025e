"""How a process of armguard ends: as Ctrl-C ends it, and with the process that started it.

Nothing here needs a thread: a timer's signal looks after the parent, even while kernels compile.
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
"""Exit code of a process that did what it was asked, until something else failed it."""

INTERRUPTED = 130
"""Exit code of a process that was ended before it had anything to show: 128 + SIGINT."""


@contextlib.contextmanager
def termination_as_interrupt() -> Iterator[None]:
    """Inside, SIGTERM raises KeyboardInterrupt: one way of ending is enough to get right."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


@contextlib.contextmanager
def noted_interrupts() -> Iterator[Callable[[], bool]]:
    """Inside, the first signal that would raise KeyboardInterrupt is noted; the next one raises it.

    What is raised may be lost: Python ignores it in a destructor, and so does compiled code (that
    of ZeroMQ's frames, for one). A loop that asks at every turn loses nothing, and ends between two
    turns. Only the main thread may do this; in another one nothing is ever noted.

    Yields:
        Whether there was such a signal.
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
    """From now on, send this process SIGTERM when process `parent` is no longer its parent."""

    def check_parent(number: int, frame: FrameType | None) -> None:
        if os.getppid() != parent:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            os.kill(os.getpid(), signal.SIGTERM)

    signal.signal(signal.SIGALRM, check_parent)
    # While Python shuts down its handlers are gone already, and an alarm would kill.
    atexit.register(signal.setitimer, signal.ITIMER_REAL, 0.0)
    signal.setitimer(signal.ITIMER_REAL, PARENT_CHECK_INTERVAL, PARENT_CHECK_INTERVAL)


def describe_end(code: int) -> str:
    """How a process has ended, for people: its exit code as `subprocess` tells it, in words."""
    if code >= 0:
        return f"with exit code {code}"
    try:
        return f"by {signal.Signals(-code).name}"
    except ValueError:
        return f"by signal {-code}"


def complain(text: str) -> None:
    """Write one line on standard error."""
    sys.stderr.write(f"armguard: {text}\n")
