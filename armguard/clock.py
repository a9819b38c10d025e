"""Clocks: the machine's monotonic clock, or one that is injected.

Time is injected: all decisions take `now` as an argument, and only the outermost loop reads a
clock.
"""

from __future__ import annotations

import time
from typing import Protocol


class Clock(Protocol):
    """A source of time in [s] that never runs backwards."""

    def now(self) -> float:
        """Seconds since the clock's own epoch."""
        ...

    def sleep_until(self, deadline: float) -> None:
        """Return at `deadline`, in [s] of this clock, or at once if it has passed."""
        ...


class MonotonicClock:
    """The machine's monotonic clock, counted from the moment of construction.

    A near epoch keeps nanoseconds within float64.
    """

    def __init__(self) -> None:
        self._epoch_ns = time.monotonic_ns()

    def now(self) -> float:
        """Seconds since construction."""
        return (time.monotonic_ns() - self._epoch_ns) * 1e-9

    def sleep_until(self, deadline: float) -> None:
        """Sleep until the absolute `deadline`, so that loops do not drift."""
        remaining = deadline - self.now()
        if remaining > 0.0:
            time.sleep(remaining)
