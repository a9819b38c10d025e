"""Garbage collection in the idle time before a deadline, never in the middle of a tick.

Python collects when enough objects have been made, which is when the loop is busy. Here it is kept
from that: what is there at the start is left out of all collections, and what comes later is
collected between ticks, as often as Python would and if there is time for it. A collection that
finds no time is made all the same once it is long overdue, so that memory stays bounded.
"""

from __future__ import annotations

import gc
from types import TracebackType

from armguard.clock import Clock

OVERDUE = 5
"""So many times one of Python's own thresholds: from there on collections may cost a late tick."""


class IdleCollector:
    """Collects when told that there is time; a context in which Python itself does not.

    Args:
        clock: Tells how long collections take.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._costs = [0.0, 0.0, 0.0]
        self._was_enabled = False

    def __enter__(self) -> IdleCollector:
        self._was_enabled = gc.isenabled()
        gc.disable()
        gc.collect()
        gc.freeze()
        self._costs = [self._collect(2)] * 3
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        gc.unfreeze()
        if self._was_enabled:
            gc.enable()

    def collect(self, idle: float) -> None:
        """Collect what is due, if that fits into `idle` [s] by what it cost the last time.

        Where collection was switched off before, it stays so.
        """
        if not self._was_enabled:
            return
        due = overdue = False
        counts, thresholds = gc.get_count(), gc.get_threshold()
        for count, threshold in zip(counts, thresholds, strict=True):
            due = due or 0 < threshold < count
            overdue = overdue or 0 < OVERDUE * threshold < count
        if not due:
            return
        for generation in (2, 1, 0):
            if 0 < thresholds[generation] < counts[generation] and (
                overdue or self._costs[generation] <= idle
            ):
                self._costs[generation] = self._collect(generation)
                return

    def _collect(self, generation: int) -> float:
        begin = self._clock.now()
        gc.collect(generation)
        return self._clock.now() - begin
