"""Counts faults of messages, and reports each kind of fault at most once a second.

A hostile or broken sender may cause 100,000 faults per second, each with a new name; neither log
nor memory may grow with them.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable
from typing import NamedTuple

_KEYS = 512
"""Kinds of faults kept apart; what comes beyond is counted under one name."""

_WIDTH = 240
"""Longest quotation of a message, in characters."""

logger = logging.getLogger("armguard.streams")


class FaultKey(NamedTuple):
    """Key of a fault: the same fault of the same source is one."""

    kind: str
    source: str


class FaultLog:
    """Counts faults, and reports each at most once a second.

    Args:
        now: Reads the time in [s], for the pace of the lines.
        emit: Takes one line of text; by default a warning of the log `armguard.streams`.
        interval: Between two lines about one fault, in [s].
    """

    def __init__(
        self,
        now: Callable[[], float],
        emit: Callable[[str], None] = logger.warning,
        interval: float = 1.0,
    ) -> None:
        self.counts: Counter[FaultKey] = Counter()
        """How often each fault was met."""
        self._now = now
        self._emit = [emit]
        self._interval = interval
        self._told: dict[FaultKey, tuple[float, int]] = {}

    @property
    def total(self) -> int:
        """All faults together."""
        return self.counts.total()

    def count(self, kind: str) -> int:
        """Faults of one kind, of all sources together."""
        return sum(number for key, number in self.counts.items() if key.kind == kind)

    def add(
        self,
        kind: str,
        source: str,
        sequence: int | None,
        problem: str,
        times: int = 1,
    ) -> None:
        """Count a fault, and report it if it was not reported in the last second.

        Args:
            kind: What sort of fault it is, in one word or two.
            source: Name of the source that sent it.
            sequence: Number of the message, where it has one.
            problem: Field, value found, and what was expected.
            times: How many faults of the kind this is.
        """
        key = FaultKey(kind, quote(source))
        if key not in self.counts and len(self.counts) >= _KEYS:
            key = FaultKey("other", "other sources")
        self.counts[key] += times
        now = self._now()
        last, told = self._told.get(key, (-float("inf"), 0))
        if now - last < self._interval:
            return
        number = "" if sequence is None else f" message {sequence}"
        unsaid = self.counts[key] - told - times
        more = f" ({unsaid} more since the last such line)" if unsaid else ""
        self._told[key] = (now, self.counts[key])
        line = f"{key.kind}: {quote(source)}{number}: {quote(problem)}{more}"
        for emit in self._emit:
            emit(line)

    def also_emit(self, emit: Callable[[str], None]) -> None:
        """Also send each line to another receiver."""
        self._emit.append(emit)


def quote(text: str, width: int = _WIDTH) -> str:
    """Printable and at most `width` characters long, whatever it was."""
    start = text[:width]
    printable = start if start.isprintable() else start.encode("unicode_escape").decode("ascii")
    return printable if len(printable) <= width else printable[:width] + "…"
