"""Locks for compilation: one process compiles each kernel, and the others load the result.

Two processes that start at once find the same cache empty. Without locks both compile everything,
at twice the price; and of two that add to a kernel's index at once, one loses what it added.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

fcntl: Any
try:
    import fcntl
except ImportError:  # not on Windows, where each process compiles for itself
    fcntl = None

PATIENCE, INTERVAL = 120.0, 0.02
"""How long another process is waited for before a kernel is compiled all the same, several times
what the longest takes, and how often it is looked after, in [s]."""

_held: set[Path] = set()
"""Locks that this process has: it may need one again, for other kinds of arguments."""


@contextlib.contextmanager
def hold_compile_lock(path: Path) -> Iterator[None]:
    """Context in which no other process has the same lock, unless it keeps it far too long.

    The lock of a process that dies is free: the operating system releases it. Where there are no
    locks, or nothing can be written, no process is waited for. Threads of one process never ask at
    the same time, for their caller holds Numba's lock.

    Args:
        path: File that is locked; made if need be.
    """
    if fcntl is None or path in _held:
        yield
        return
    with contextlib.ExitStack() as stack:
        with contextlib.suppress(OSError):
            path.parent.mkdir(parents=True, exist_ok=True)
            file = stack.enter_context(path.open("wb"))
            _wait_for_lock(file)
        _held.add(path)
        stack.callback(_held.discard, path)
        yield


def _wait_for_lock(file: Any) -> None:
    """Lock a file, which its closing unlocks, unless another process keeps it for too long.

    Raises:
        OSError: Files cannot be locked here.
    """
    latest = time.monotonic() + PATIENCE
    while time.monotonic() < latest:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            time.sleep(INTERVAL)
        else:
            return
