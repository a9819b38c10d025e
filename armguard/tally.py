"""What a run's summary counts: levels, stops, incomplete ticks, the soonest contact."""

from __future__ import annotations

import math

from armguard.verdict import Level, Verdict


class Tally:
    """Counts verdicts; its size does not grow.

    Attributes:
        waiting: Ticks before the first joint state; they count nowhere else.
        levels: Ticks at each level.
        stops: How often the level fell to STOP; a run that begins with STOP begins with one.
        incomplete: Ticks in which not every pair had a certificate in force.
        min_contact_time: Soonest contact of all ticks whose arm state was believed, in [s]; inf
            without any.
    """

    def __init__(self) -> None:
        self.waiting = 0
        self.levels = dict.fromkeys(Level, 0)
        self.stops = 0
        self.incomplete = 0
        self.min_contact_time = math.inf
        self._level: Level | None = None

    def count(self, verdict: Verdict) -> None:
        """Add one verdict."""
        if verdict.sequence == 0:
            self.waiting += 1
            return
        if verdict.level is Level.STOP and self._level is not Level.STOP:
            self.stops += 1
        self._level = verdict.level
        self.levels[verdict.level] += 1
        self.incomplete += not verdict.complete
        if verdict.link is not None:
            self.min_contact_time = min(self.min_contact_time, verdict.contact_time)
