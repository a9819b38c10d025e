"""What armguard says at every tick, and the rule that makes it.

A `Verdict` is a small frozen record: how imminent contact is, whether the arm may go on, and why.
`VerdictRule` turns contact time, stopping time and standing faults into a `Level`. It falls at
once and rises only after `hold` seconds of evidence, so that a verdict never flutters upwards.
Whatever is unknown counts as the worst case, which is STOP.
"""

from __future__ import annotations

import enum
import math
from typing import NamedTuple

from armguard.contact.earliest import Certificate


class Level(enum.IntEnum):
    """What the controller should do; STOP < SLOW < AWARE < CLEAR."""

    STOP = 0
    """Brake now: contact could come before the arm can stand still, or something is unknown."""
    SLOW = 1
    """Contact is less than `slow_margin` beyond the stopping time."""
    AWARE = 2
    """Contact is less than `aware_margin` beyond the stopping time."""
    CLEAR = 3
    """Nothing near in time."""


class Effect(enum.Enum):
    """What a reason does to the level."""

    NOTE = "note"
    """Explains the verdict, forces nothing."""
    STANDING = "standing"
    """STOP while it lasts, and `hold` seconds beyond."""
    LATCHED = "latched"
    """STOP until `Monitor.reset()`."""


class ReasonKind(enum.Enum):
    """Everything that a verdict can rest on, with its effect."""

    CONTACT = ("contact possible", Effect.NOTE)
    HOLD = ("waiting for evidence before the level rises", Effect.NOTE)
    NO_SOURCES_EXPECTED = ("no sources, as was said", Effect.NOTE)
    NOT_YET_COMPLETE = ("no complete look yet", Effect.NOTE)
    REMOVAL_IGNORED = ("removal ignored", Effect.NOTE)
    ID_SHARED = ("id used twice", Effect.NOTE)
    PLAN_REFUSED = ("plan refused", Effect.NOTE)
    PLAN_UNSAFE = ("plan unsafe", Effect.NOTE)
    PLAN_VOID = ("plan not followed any more", Effect.NOTE)
    BUDGET_SPENT = ("budget spent before the stop decision was made", Effect.NOTE)
    NO_SOURCES = ("no sources", Effect.STANDING)
    SOURCE_SILENT = ("source silent", Effect.STANDING)
    STAMP_AHEAD = ("stamp ahead of the clock", Effect.STANDING)
    OBSTACLE_REFUSED = ("obstacle refused", Effect.STANDING)
    CALL_REFUSED = ("malformed obstacle call", Effect.STANDING)
    BOUND_BROKEN = ("obstacle broke its bounds", Effect.STANDING)
    OVERDUE = ("pair overdue", Effect.STANDING)
    IGNORE_UNMATCHED = ("ignored pair matches nothing", Effect.STANDING)
    JOINT_STOP_AHEAD = ("joint runs into its stop", Effect.STANDING)
    JOINT_STATE_MALFORMED = ("joint state malformed", Effect.LATCHED)
    JOINT_STATE_BEYOND_LIMITS = ("joint state beyond its limits", Effect.LATCHED)
    JOINT_STATE_JUMPED = ("joint state jumped", Effect.LATCHED)
    TIME_INVALID = ("time not finite", Effect.LATCHED)
    TIME_BACKWARDS = ("time ran backwards", Effect.LATCHED)
    JOINT_STATE_GAP = ("gap in joint states", Effect.LATCHED)
    INTERNAL_ERROR = ("error inside armguard", Effect.LATCHED)

    def __init__(self, text: str, effect: Effect) -> None:
        self.text = text
        self.effect = effect


class Reason(NamedTuple):
    """One thing that a verdict rests on."""

    kind: ReasonKind
    subject: str = ""
    """Who or what: a source, an obstacle, a joint, a link and an obstacle."""
    detail: str = ""
    """Value found and value expected, in plain words."""

    def __str__(self) -> str:
        text = f"{self.kind.text}: {self.subject}" if self.subject else self.kind.text
        return f"{text} ({self.detail})" if self.detail else text


class Verdict(NamedTuple):
    """The answer of one tick. Frozen; all times in [s] of the monitor's clock."""

    stamp: float
    """Stamp of the joint state that was judged."""
    sequence: int
    """Number of this tick, from 1; it goes on over a reset."""
    level: Level
    """What the controller should do."""
    contact_time: float
    """Earliest possible contact, counted from `now`; inf without pairs, 0 where unknown."""
    stop_time: float
    """Time within which the arm surely stands still, counted from `now`."""
    speed_scale: float
    """Safe to go on while every joint keeps below this fraction of its velocity limit."""
    link: str | None
    """Link of the deciding pair; None without pairs or where not all that is there is known."""
    obstacle: str | None
    """Obstacle of the deciding pair; None alike."""
    complete: bool
    """Whether a certificate in force stands behind every pair."""
    evaluated: int
    """Contact-time evaluations in this tick, sphere against obstacle."""
    reasons: tuple[Reason, ...]
    """What the verdict rests on; the weightiest first."""
    valid_until: float
    """Silence beyond this means: brake."""
    separation: float | None = None
    """Margin of the speed-and-separation distance in [m], where asked for."""
    certificate: Certificate | None = None
    """Proof of the deciding pair, where asked for."""


class VerdictRule:
    """From contact time and faults to a level, with memory for `hold` and latched faults.

    The level given out is the lowest raw level of the last `hold` seconds: it falls at once, and
    rises when the whole of that time spoke for it. The first complete verdict after construction
    stands at once.

    Args:
        slow_margin: Below stop time plus this, in [s], the level is SLOW.
        aware_margin: Below stop time plus this, in [s], the level is AWARE.
        hold: How long, in [s], evidence must last before a level rises.
    """

    def __init__(self, slow_margin: float, aware_margin: float, hold: float) -> None:
        self.slow_margin = slow_margin
        self.aware_margin = aware_margin
        self.hold = hold
        self.latched: dict[ReasonKind, Reason] = {}
        self._settled = False
        self._was_reset = False
        self._last_at: list[float] = [-math.inf] * len(Level)
        self._low_at = -math.inf

    def reset(self) -> None:
        """Forget latched faults and held levels; the next tick counts as evidence for STOP.

        What latched was no passing thing, so levels rise only when there was evidence for `hold`
        seconds again. Time may start anew.
        """
        self.latched.clear()
        self._settled = self._was_reset = True
        self._last_at = [-math.inf] * len(Level)
        # Until then nothing is clear, whatever the time is.
        self._low_at = math.inf

    def latch(self, reason: Reason, since: str) -> None:
        """Hold STOP for a reason until `reset()`; the first of a kind is the one kept.

        Args:
            reason: Why.
            since: When, in words; becomes part of its detail.
        """
        if reason.kind not in self.latched:
            detail = f"{reason.detail}; latched since {since}".removeprefix("; ")
            self.latched[reason.kind] = reason._replace(detail=detail)

    def is_clear(self, now: float) -> bool:
        """Whether at `now`, in [s], nothing keeps the level below what the tick itself earns."""
        return self._settled and not self.latched and not now - self._low_at < self.hold

    def grade(self, contact_time: float, stop_time: float, *, rests: bool = False) -> Level:
        """The level that one contact time earns by itself.

        Args:
            contact_time: In [s] from now.
            stop_time: Time to come to rest, in [s] from now.
            rests: Whether the arm is known to rest before any contact, if it brakes after the next
                tick: then there is no need to stop now, however short the contact time.
        """
        if not contact_time > stop_time and not (rests and contact_time >= 0.0):
            return Level.STOP
        if not contact_time > stop_time + self.slow_margin:
            return Level.SLOW
        if not contact_time > stop_time + self.aware_margin:
            return Level.AWARE
        return Level.CLEAR

    def decide(
        self,
        now: float,
        contact_time: float,
        stop_time: float,
        *,
        complete: bool,
        standing: bool,
        rests: bool = False,
    ) -> tuple[Level, bool]:
        """The level to give out at `now`, and whether earlier evidence holds it down.

        Args:
            now: Time of this tick, in [s], never less than at the call before.
            contact_time: Earliest possible contact, in [s] from now.
            stop_time: Time to come to rest, in [s] from now.
            complete: Whether a certificate in force stands behind every pair.
            standing: Whether a standing fault is present in this tick.
            rests: As for `grade`.
        """
        raw = self.grade(contact_time, stop_time, rests=rests)
        if standing or self.latched or not complete:
            raw = Level.STOP
        if not self._settled:
            if self.latched or not complete:
                return Level.STOP, False
            self._settled = True
            self._last_at = [-math.inf] * len(Level)
            self._low_at = -math.inf
        if self._was_reset:
            self._was_reset = False
            self._last_at[Level.STOP] = self._low_at = now
        self._last_at[raw] = now
        if raw is not Level.CLEAR:
            self._low_at = now
        elif not now - self._low_at < self.hold:
            # The usual case: nothing lower for long.
            return raw, False
        for level in Level:
            if level >= raw:
                break
            if now - self._last_at[level] < self.hold:
                return level, True
        return raw, False
