"""The past that a page can show: moments and events.

Ten moments a second are kept. Each has the worst values of the frames since the moment before, so
that a STOP between two moments is visible. Of a live monitor, the last minutes are kept. A
recording is kept whole; if there are too many moments, every other one is dropped. Memory is
bounded in both cases.
"""

from __future__ import annotations

import bisect
import math
from collections import deque
from typing import NamedTuple

from armguard.view.colours import LEVELS
from armguard.view.messages import FrameMessage

INTERVAL = 0.1
"""Time between two moments, in [s]."""

SPAN = 180.0
"""How much of a live monitor's past is kept, in [s]."""

MOST_BYTES = 64_000_000
MOST_MOMENTS = 6000
MOST_EVENTS = 500

QUIET = 1.0
"""How long a fault must be absent before it is reported as an event again, in [s]."""

STOP = LEVELS[0]


class Moment(NamedTuple):
    """One moment of the strip."""

    number: int
    """Number of the moment; increases."""
    now: float
    """Time of the monitor, in [s]."""
    wall: float
    """Time of day, in [s] since 1970; 0: unknown."""
    level: str
    """The lowest level since the moment before."""
    contact_time: float
    """The least contact time since the moment before, in [s]."""
    stop_time: float
    """In [s]."""
    speed_scale: float
    """The least speed scale since the moment before."""
    harm_time: float | None
    """The least harm time since the moment before, in [s]; None: no contact limits."""
    pace: float | None
    """The shield's least pace since the moment before; None: no shield."""
    payload: bytes
    """The received frame."""


class Event(NamedTuple):
    """An event in the past of a monitor."""

    number: int
    """Number of its moment."""
    now: float
    """Time of the monitor, in [s]."""
    kind: str
    """"stop", "go", "fault", "latch", "reset" or "refused"."""
    text: str
    """In words."""


class Film:
    """Keeps moments and events.

    Attributes:
        moments: The earliest first.
        events: The earliest first.
        edition: Increases whenever moments before the last one were dropped or changed.
        interval: Time between two moments, in [s].
    """

    def __init__(self) -> None:
        self.edition = self._number = 0
        self.clear()

    def clear(self, *, is_recording: bool = False) -> None:
        """Drop all moments and events.

        Args:
            is_recording: Whether the next frames are those of a recording, to be kept whole.
        """
        self._is_recording = is_recording
        self.interval = INTERVAL
        self.moments: deque[Moment] = deque()
        self.events: deque[Event] = deque(maxlen=MOST_EVENTS)
        self._bytes = 0
        self._open: Moment | None = None
        self._last: FrameMessage | None = None
        self._told: dict[str, float] = {}
        self.edition += 1

    def add(self, frame: FrameMessage, payload: bytes) -> None:
        """Add the next frame.

        Args:
            frame: The frame.
            payload: The same frame in its packed form.
        """
        if self._last is not None and frame.now < self._last.now:
            # Another life of the monitor: its clock began anew.
            self.clear(is_recording=self._is_recording)
        events = self._find_events(frame)
        verdict = frame.verdict
        fresh = Moment(
            self._number + 1,
            frame.now,
            frame.wall,
            verdict.level,
            verdict.contact_time,
            verdict.stop_time,
            verdict.speed_scale,
            verdict.harm_time,
            None if frame.command is None else frame.command.scale,
            payload,
        )
        before = self._open
        last = self.moments[-1] if self.moments else None
        if before is not None:
            fresh = _merge(before, fresh)
        if events or last is None or frame.now - last.now >= self.interval * (1.0 - 1e-6):
            self._keep(fresh)
        else:
            self._open = fresh
        self.events.extend(
            Event(fresh.number, frame.now, kind, text) for kind, text in events.items()
        )
        self._last = frame

    def settle(self) -> None:
        """Keep the last frame as a moment, even if the moment before is recent."""
        if self._open is not None:
            self._keep(self._open)

    def find(self, number: int) -> Moment | None:
        """The moment with this number, or the last one before it; None if there is none."""
        after = bisect.bisect_right(self.moments, number, key=lambda moment: moment.number)
        return self.moments[max(after - 1, 0)] if self.moments else None

    def _keep(self, moment: Moment) -> None:
        self._number, self._open = moment.number, None
        self.moments.append(moment)
        self._bytes += len(moment.payload)
        if self._is_recording:
            while len(self.moments) > MOST_MOMENTS or self._bytes > MOST_BYTES:
                if len(self.moments) < 4:
                    return
                self._thin_out()
            return
        while len(self.moments) > 2 and (
            moment.now - self.moments[0].now > SPAN or self._bytes > MOST_BYTES
        ):
            gone = self.moments.popleft()
            self._bytes -= len(gone.payload)
            while self.events and self.events[0].number <= gone.number:
                self.events.popleft()

    def _thin_out(self) -> None:
        """Drop every other moment without events; its worst values are merged into the next."""
        told = {event.number for event in self.events}
        kept: deque[Moment] = deque()
        pending: Moment | None = None
        for place, moment in enumerate(self.moments):
            merged = moment if pending is None else _merge(pending, moment)
            pending = None
            if place % 2 and moment.number not in told and place + 1 < len(self.moments):
                pending = merged
            else:
                kept.append(merged)
        if len(kept) == len(self.moments):
            self.events.popleft()
        self.moments = kept
        self._bytes = sum(len(moment.payload) for moment in kept)
        self.interval *= 2.0
        self.edition += 1

    def _find_events(self, frame: FrameMessage) -> dict[str, str]:
        """The events since the frame before, in words, by kind."""
        events: dict[str, str] = {}
        verdict, last = frame.verdict, self._last
        first = verdict.reasons[0] if verdict.reasons else ""
        if last is None:
            if verdict.level == STOP:
                events["stop"] = first or STOP
        elif verdict.level != last.verdict.level and STOP in (verdict.level, last.verdict.level):
            is_stop = verdict.level == STOP
            events["stop" if is_stop else "go"] = (first or STOP) if is_stop else verdict.level
        for text, effect in zip(verdict.reasons, verdict.effects, strict=False):
            key = text.partition(" (")[0]
            if effect == "standing":
                is_news = not frame.now - self._told.get(key, -math.inf) <= QUIET
                self._told[key] = frame.now
                if is_news:
                    events["fault"] = text
        if len(self._told) > MOST_EVENTS:
            self._told.clear()
        before = last.latches if last is not None else ()
        known = {latch.reason.partition(" (")[0] for latch in before}
        fresh = [one for one in frame.latches if one.reason.partition(" (")[0] not in known]
        if fresh:
            events["latch"] = fresh[0].reason
        if before and not frame.latches:
            events["reset"] = "reset: nothing is latched any more"
        if last is not None and frame.refused_resets > last.refused_resets:
            events["refused"] = "a reset was refused: its token is not that of this run"
        return events


def _merge(before: Moment, after: Moment) -> Moment:
    """The later moment, with the worst values of both."""
    worst = before if _rank(before.level) < _rank(after.level) else after
    harm_times = [one.harm_time for one in (before, after) if one.harm_time is not None]
    paces = [one.pace for one in (before, after) if one.pace is not None]
    return after._replace(
        level=worst.level,
        contact_time=min(before.contact_time, after.contact_time),
        speed_scale=min(before.speed_scale, after.speed_scale),
        harm_time=min(harm_times) if harm_times else None,
        pace=min(paces) if paces else None,
    )


def _rank(level: str) -> int:
    return LEVELS.index(level) if level in LEVELS else 0
