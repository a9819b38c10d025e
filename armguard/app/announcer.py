"""Prints the events of a run on the terminal: changes of level, latched and message faults.

A terminal may be slow, or stopped by Ctrl-S; the loop must not wait for it. So the loop only
appends to a bounded queue without a lock, and a thread writes its lines. The thread starts before
real-time scheduling is requested and does not inherit it. Lines that did not fit into the queue are
counted, and their number is printed.
"""

from __future__ import annotations

import contextlib
import os
import sys
import threading
import time
from collections import deque
from collections.abc import Callable

from armguard.streams.faults import quote
from armguard.verdict import Effect, Level, Reason, ReasonKind, Verdict

INTERVAL = 0.25
"""Between two lines about levels, in [s]: flutter must not flood a terminal."""

QUEUE_LIMIT = 256
"""Greatest number of lines that wait for a slow terminal; further lines are dropped and counted."""

_WAKE = 0.05
"""Between two readings of the queue by the thread, in [s]."""

_GOODBYE = 1.0
"""How long the end of a run waits until the last lines are written, in [s]."""

_WIDTH = 1000
"""Longest line, in characters, without its time."""

_REASONS = 3
"""Most reasons that a line names."""


def write_error(text: str) -> None:
    """Write on standard error; if it is closed, do nothing.

    Writes to the file descriptor: a thread that blocks in Python's file object would hold its lock.
    """
    encoding = getattr(sys.stderr, "encoding", None) or "utf-8"
    data = text.encode(encoding, "backslashreplace")
    with contextlib.suppress(OSError):
        while data:
            data = data[os.write(2, data) :]


class Announcer:
    """Writes lines from its own thread; a context manager that writes the rest at its end.

    Args:
        quiet: Whether to print only the lines of `tell`, without levels and latched faults.
        write: Takes text of one or more lines; may block.
        wall_clock: Reads the time of day, in [s] since 1970.

    Attributes:
        dropped: Lines so far that found no room.
        remedy: What to do about a latched fault, in words.
    """

    def __init__(
        self,
        *,
        quiet: bool = False,
        write: Callable[[str], None] = write_error,
        wall_clock: Callable[[], float] = time.time,
    ) -> None:
        self.dropped = 0
        self.remedy = ""
        self._quiet = quiet
        self._write = write
        self._wall_clock = wall_clock
        self._lines: deque[tuple[float, str]] = deque()
        self._dropped_before = 0
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._serve, name="announcer", daemon=True)
        self._key: tuple[Level, ReasonKind | None] | None = None
        self._changes = 0
        self._worst: Verdict | None = None
        self._next_line = self._next_latch = -float("inf")
        self._latched: dict[ReasonKind, Reason] = {}
        self._untold: dict[ReasonKind, Reason] = {}
        self._was_reset = False

    def __enter__(self) -> Announcer:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ending.set()
        self._thread.join(_GOODBYE)

    def tell(self, text: str) -> None:
        """Append a line to the queue if there is room; never blocks."""
        if len(self._lines) >= QUEUE_LIMIT:
            self.dropped += 1
        else:
            self._lines.append((self._wall_clock(), text))

    def observe(self, now: float, verdict: Verdict) -> None:
        """Append a line if the level changed or a fault was latched. Never blocks.

        Args:
            now: Time of the verdict, in [s] of any clock that does not run backwards.
            verdict: The verdict.
        """
        if self._quiet:
            return
        reasons = verdict.reasons
        if self._latched or (reasons and reasons[0].kind.effect is Effect.LATCHED):
            self._follow_latches(reasons)
        if (self._untold or self._was_reset) and now >= self._next_latch:
            self._next_latch = now + INTERVAL
            self._tell_latches()
        key = verdict.level, _find_cause(verdict)
        if key != self._key:
            self._key = key
            self._changes += 1
            if self._worst is None or verdict.level < self._worst.level:
                self._worst = verdict
        if self._changes and now >= self._next_line:
            self._next_line = now + INTERVAL
            self._tell_level(verdict)

    def _follow_latches(self, reasons: tuple[Reason, ...]) -> None:
        latched = {one.kind: one for one in reasons if one.kind.effect is Effect.LATCHED}
        for kind, reason in latched.items():
            if kind not in self._latched:
                self._untold[kind] = reason
        self._was_reset = self._was_reset or not latched
        self._latched = latched

    def _tell_latches(self) -> None:
        lines = [f"latched: {reason}; {self.remedy}" for reason in self._untold.values()]
        if self._was_reset:
            # What is so now comes last.
            lines.insert(0 if self._latched else len(lines), "reset: nothing is latched any more")
        for line in lines:
            self.tell(line)
        self._untold.clear()
        self._was_reset = False

    def _tell_level(self, verdict: Verdict) -> None:
        text = f"{verdict.level.name:5} {_describe(verdict)}"
        worst = self._worst
        if self._changes > 1:
            more = self._changes - 1
            text += f" ({more} more {'change' if more == 1 else 'changes'} since the last line"
            if worst is not None and worst.level < verdict.level:
                text += f", down to {worst.level.name}: {_describe(worst)}"
            text += ")"
        self._changes, self._worst = 0, None
        self.tell(text)

    def _serve(self) -> None:
        """Write the lines of the queue until the end; runs in the thread."""
        while not self._ending.wait(_WAKE):
            self._flush()
        self._flush()

    def _flush(self) -> None:
        while self._lines:
            when, text = self._lines.popleft()
            hour = time.strftime("%H:%M:%S", time.localtime(when))
            self._write(f"armguard: {hour}.{int(1000 * (when % 1.0)):03} {quote(text, _WIDTH)}\n")
        dropped = self.dropped
        if dropped > self._dropped_before:
            number = dropped - self._dropped_before
            self._dropped_before = dropped
            self._write(f"armguard: {number} lines were dropped: the terminal was too slow\n")


def _find_cause(verdict: Verdict) -> ReasonKind | None:
    """The weightiest reason of a STOP, which distinguishes STOPs; None for a contact alone."""
    if verdict.level is not Level.STOP or not verdict.reasons:
        return None
    kind = verdict.reasons[0].kind
    is_told = kind.effect is not Effect.NOTE or kind is ReasonKind.NOT_YET_COMPLETE
    return kind if is_told else None


def _describe(verdict: Verdict) -> str:
    """The reasons of a verdict in words, the weightiest first."""
    if not verdict.reasons:
        if verdict.link is None:
            return "no contact possible"
        return f"contact time {verdict.contact_time:.3g} s"
    told = "; ".join(map(str, verdict.reasons[:_REASONS]))
    more = len(verdict.reasons) - _REASONS
    return f"{told}; {more} more reasons" if more > 0 else told
