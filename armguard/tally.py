"""What a run's summary counts: levels, stops and why, incomplete ticks, the soonest contact."""

from __future__ import annotations

import math
from collections import Counter

from armguard.streams.faults import quote
from armguard.verdict import Effect, Level, ReasonKind, Verdict

REASON_LIMIT = 64
"""Reasons of stops that are told apart; further ones are counted as "other reasons"."""


class Tally:
    """Counts verdicts; its size does not grow.

    Attributes:
        waiting: Ticks without a joint state to judge, all of them told to STOP; they count nowhere
            else.
        levels: Ticks at each level.
        stops: How often the level fell to STOP; a run that begins with STOP begins with one.
        reasons: How often the weightiest reason of a stop was this one.
        incomplete: Ticks in which not every pair had a certificate in force.
        min_contact_time: Soonest contact of all ticks that knew where arm and obstacles were, in
            [s]; inf without any.
    """

    def __init__(self) -> None:
        self.waiting = 0
        self.levels = dict.fromkeys(Level, 0)
        self.stops = 0
        self.reasons: Counter[str] = Counter()
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
            self._count_reason(verdict)
        self._level = verdict.level
        self.levels[verdict.level] += 1
        self.incomplete += not verdict.complete
        if _is_known(verdict):
            self.min_contact_time = min(self.min_contact_time, verdict.contact_time)

    def _count_reason(self, verdict: Verdict) -> None:
        """Count the weightiest reason of a stop; figures would make each one of its own."""
        reason = "no reason"
        for one in verdict.reasons:
            if one.kind is not ReasonKind.HOLD:
                subject = quote(one.subject)
                reason = f"{one.kind.text}: {subject}" if subject else one.kind.text
                break
        if reason not in self.reasons and len(self.reasons) >= REASON_LIMIT:
            reason = "other reasons"
        self.reasons[reason] += 1


def _is_known(verdict: Verdict) -> bool:
    """Whether a contact time is that of a pair, and not said for want of knowledge.

    A refused state has no pair; and an obstacle that could be anywhere by now, since its source is
    silent or its states are refused, is at 0 s, whether or not it is near.
    """
    if verdict.link is None or not verdict.complete:
        return False
    return verdict.contact_time > 0.0 or not any(
        reason.kind.effect is Effect.STANDING for reason in verdict.reasons
    )
