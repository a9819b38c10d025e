"""What armguard says at every tick.

A `Verdict` is a small frozen record: how imminent contact is, whether the arm may go on, and why.
Whatever is unknown counts as the worst case, which is STOP.
"""

from __future__ import annotations

import enum
from typing import Literal, NamedTuple

from armguard.contact.earliest import Certificate


class Level(enum.IntEnum):
    """What the controller should do; STOP < SLOW < AWARE < CLEAR."""

    STOP = 0
    """Brake now, unless `Verdict.stop` says that the committed piece may be finished: contact could
    come before the arm can stand still, or something is unknown."""
    SLOW = 1
    """Contact is less than `slow_margin` beyond the stopping time."""
    AWARE = 2
    """Contact is less than `aware_margin` beyond the stopping time."""
    CLEAR = 3
    """Nothing near in time."""


FINISH: Literal["finish"] = "finish"
"""`Verdict.stop` of an arm that is to run its committed piece to rest."""

BRAKE: Literal["brake"] = "brake"
"""`Verdict.stop` of an arm that is to leave whatever it does, and to brake."""


class Effect(enum.Enum):
    """What a reason does to the level."""

    NOTE = "note"
    """Explains the verdict, forces nothing."""
    STANDING = "standing"
    """STOP while it lasts, and `rise_delay` seconds beyond."""
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
    PIECE_UNSAFE = ("committed piece not safe any more", Effect.STANDING)
    BUDGET_SPENT = ("budget spent before the stop decision was made", Effect.NOTE)
    CROWD = ("more is near than was evaluated", Effect.NOTE)
    OBSTACLE_REFUSED = ("obstacle refused", Effect.NOTE)
    BOUND_BROKEN = ("obstacle broke its bounds", Effect.NOTE)
    ERRORS_EXCEEDED = ("errors larger than stated", Effect.NOTE)
    NO_SOURCES = ("no sources", Effect.STANDING)
    SOURCE_SILENT = ("source silent", Effect.STANDING)
    STAMP_AHEAD = ("stamp ahead of the clock", Effect.STANDING)
    OBSTACLE_NOT_BELIEVED = ("obstacle not believed", Effect.STANDING)
    SOURCE_NOT_BELIEVED = ("source not believed", Effect.STANDING)
    CALL_REFUSED = ("malformed obstacle call", Effect.STANDING)
    OVERDUE = ("pair overdue", Effect.STANDING)
    IGNORE_UNMATCHED = ("ignored pair matches nothing", Effect.STANDING)
    JOINT_STOP_AHEAD = ("joint runs into its stop", Effect.STANDING)
    BRAKES_NOT_COVERED = ("brakes not stated for such speeds", Effect.STANDING)
    OPERATING_LIMITS_BROKEN = ("operating limits broken", Effect.STANDING)
    ENDED = ("monitor has ended", Effect.STANDING)
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
    """What it is about: a source, an obstacle, a joint, a link and an obstacle."""
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
    """Safe to go on while every joint keeps below this fraction of its operating velocity, or of
    its velocity limit where none is stated; of an arm that follows a trajectory, while its clock,
    `path_time`, runs no faster than this. 1 on a committed piece that is proved safe to its end."""
    link: str | None
    """Link of the deciding pair; None without pairs or where not all that is there is known."""
    obstacle: str | None
    """Obstacle of the deciding pair; None where `link` is."""
    complete: bool
    """Whether a certificate in force stands behind every pair, or the stop decision was made about
    it in this tick. Where a STOP is certain anyway, what is near may wait; a reason says so."""
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
    stop: Literal["finish", "brake"] | None = None
    """How to obey a STOP; None where the level is another. FINISH: run the committed piece to rest,
    which is proved safe. BRAKE: leave it and brake, for there is no such proof."""


class PlanVerdict(NamedTuple):
    """Whether the arm may follow a plan; frozen."""

    safe: bool
    """Whether it may: then it is what the monitor takes the arm to follow from now on."""
    contact_time: float
    """Earliest possible contact on the way, in [s] from now; inf if there is none before the arm
    rests, 0 where that is unknown. Of a trajectory, on the way until it could be stopped."""
    link: str | None
    """Link of the pair that could touch first; None if none can."""
    obstacle: str | None
    """Its obstacle, alike."""
    reasons: tuple[Reason, ...]
    """Why not."""
