"""Computes a level from contact time and faults.

The level falls at once and rises only after `rise_delay` seconds of evidence, so that a verdict
never flutters upwards. Whatever is unknown counts as the worst case, which is STOP.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from armguard.settings.settings import Settings
from armguard.verdict import Held, Level, Reason, ReasonKind

LEVELS = STOP, SLOW, AWARE, CLEAR = tuple(Level)
"""From the lowest to the highest. To read a name here takes a tenth of reading it from `Level`, and
every tick reads a dozen of them."""


NO_CAUSE = Held(None, math.inf, math.inf, -math.inf, -math.inf)
"""Cause of a level that no tick began."""


class VerdictRule:
    """Computes levels, with memory for `rise_delay` and latched faults.

    The published level is the lowest raw level of the last `rise_delay` seconds: it falls at once,
    and rises after the whole of that time supports it. The first complete verdict after
    construction is published at once. The cause of a level is kept as long as the level can be
    held.

    Args:
        settings: Margins of levels, and how long evidence must last before one rises.
    """

    def __init__(self, settings: Settings) -> None:
        self.slow_margin = settings.slow_margin
        self.aware_margin = settings.aware_margin
        self.rise_delay = settings.rise_delay
        self.latched: dict[ReasonKind, Reason] = {}
        self._settled = False
        self._was_reset = False
        self._last_at: list[float] = [-math.inf] * len(Level)
        self._low_at = -math.inf
        self._causes = [NO_CAUSE] * len(Level)
        self._raw: Level = CLEAR
        self.begins = False
        """Whether the level of the last tick begins with it, so that its cause must be kept;
        rare."""

    def reset(self) -> None:
        """Drop latched faults and held levels; the next tick counts as evidence for STOP.

        Latched faults are serious, so levels rise only after evidence for `rise_delay` seconds. The
        clock may start anew.
        """
        self.latched.clear()
        self._settled = self._was_reset = True
        self._last_at = [-math.inf] * len(Level)
        self._causes = [NO_CAUSE] * len(Level)

    def latch(self, reason: Reason, since: str) -> None:
        """Hold STOP for a reason until `reset()`; the first reason of a kind is kept.

        Args:
            reason: Why.
            since: When, in words; becomes part of its detail.
        """
        if reason.kind not in self.latched:
            detail = f"{reason.detail}; latched since {since}".removeprefix("; ")
            self.latched[reason.kind] = reason._replace(detail=detail)

    def grade(
        self, contact_time: float, stop_time: float, *, rests: bool = False, whole: bool = False
    ) -> Level:
        """The level of one contact time by itself.

        Args:
            contact_time: In [s] from now.
            stop_time: Time to come to rest, in [s] from now.
            rests: Whether the arm is proved to be at rest before any contact if it brakes after the
                next tick. Then it need not stop now, however short the contact time.
            whole: Whether an arm at any speed is proved to be at rest before contact if it brakes
                at the end of a speed scale. Then it need not slow down.
        """
        if not contact_time > stop_time and not (rests and contact_time >= 0.0):
            return STOP
        if not contact_time > stop_time + self.slow_margin:
            return AWARE if whole else SLOW
        if not contact_time > stop_time + self.aware_margin:
            return AWARE
        return CLEAR

    def decide(
        self,
        now: float,
        earned: Level,
        *,
        complete: bool,
        standing: bool,
    ) -> tuple[Level, bool]:
        """The level to publish at `now`, and whether earlier evidence holds it down.

        Args:
            now: Time of this tick, in [s], never less than at the call before.
            earned: The level of this tick's contact time by itself; see `grade`.
            complete: Whether a certificate in force stands behind every pair.
            standing: Whether a standing fault is present in this tick.
        """
        raw = earned
        if standing or self.latched or not complete:
            raw = STOP
        if not self._settled:
            if self.latched or not complete:
                return STOP, False
            self._settled = True
            self._last_at = [-math.inf] * len(Level)
            self._low_at = -math.inf
        if self._was_reset:
            self._was_reset = False
            self._last_at[STOP] = self._low_at = now
            self._causes[STOP] = NO_CAUSE._replace(since=now)
        self._raw = raw
        # Anew as well where a lower level was earned since: then that was what held.
        last = self._last_at[raw]
        self.begins = raw is not CLEAR and (
            not now - last < self.rise_delay or max(self._last_at[: raw + 1]) > last
        )
        self._last_at[raw] = now
        if raw is not CLEAR:
            self._low_at = now
        elif not now - self._low_at < self.rise_delay:
            # The usual case: nothing lower for long.
            return raw, False
        for level in LEVELS[:raw]:
            if now - self._last_at[level] < self.rise_delay:
                return level, True
        return raw, False

    def holds_stop(self, now: float) -> bool:
        """Whether an earlier STOP lasts at least until `now`, in [s]."""
        return now - self._last_at[STOP] < self.rise_delay

    def keep_cause(
        self, now: float, contact_time: float, stop_time: float, reasons: Sequence[Reason]
    ) -> None:
        """Store the cause of this tick's own level, if the level `begins` with it.

        Args:
            now: As in `decide`, which must be called before for this tick.
            contact_time: Of the tick, in [s] from now.
            stop_time: Of the tick, in [s] from now.
            reasons: Reasons of the tick without latched ones, the weightiest first.
        """
        if self.begins:
            latched = next(iter(self.latched.values()), None)
            reason = latched or (reasons[0] if reasons else None)
            self._causes[self._raw] = Held(reason, contact_time, stop_time, now, now)

    def find_cause(self, level: Level) -> Held:
        """The cause of a held level, and the time at which it may rise."""
        return self._causes[level]._replace(rises_at=self._last_at[level] + self.rise_delay)
