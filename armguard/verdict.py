"""What armguard says at every tick.

A `Verdict` is a small frozen record: how imminent contact is, whether the arm may go on, and why.
Whatever is unknown counts as the worst case, which is STOP.
"""

from __future__ import annotations

import enum
import operator
from collections.abc import Iterable
from typing import TYPE_CHECKING, Literal, NamedTuple

if TYPE_CHECKING:
    from armguard.contact.earliest import Certificate


class Level(enum.IntEnum):
    """What the controller should do; STOP < SLOW < AWARE < CLEAR."""

    STOP = 0
    """Brake now, unless `Verdict.stop` says that the committed piece may be finished: contact could
    come before the arm can stand still, or something is unknown."""
    SLOW = 1
    """Contact is less than `slow_margin` beyond the stopping time. Never on a committed piece that
    is proved safe to its end."""
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
    """Everything that a verdict can rest on.

    Attributes:
        text: In a few words.
        effect: What it does to the level.
        remedy: What to do about it.
        weight: Its place among the others; the weightiest has the least.
    """

    CONTACT = (
        "contact possible",
        Effect.NOTE,
        "Do nothing: this pair decides the level. `monitor.explain()` and `armguard replay "
        "--explain` say more.",
    )
    CONTACT_ALLOWED = (
        "contact allowed",
        Effect.NOTE,
        "If it is not intended, remove the contact limit (docs/contact_limits.md).",
    )
    CONTACT_FORBIDDEN = (
        "contact not permitted",
        Effect.NOTE,
        "Keep the arm slower there, or state the region. Where a part can be clamped, give more "
        "room, or `force` and `stiffness` (docs/contact_limits.md).",
    )
    LATE_DATA = (
        "late data",
        Effect.NOTE,
        "Find what delayed the source or the joint states. The detail has the level without the "
        "delay.",
    )
    LATE_DATA_UNKNOWN = (
        "late data, effect unknown",
        Effect.NOTE,
        "Find what delayed the source or the joint states. Too much was near to compute the level "
        "without it.",
    )
    WIDENED_BOUNDS = (
        "bounds widened",
        Effect.NOTE,
        "Nothing came near. State bounds that the body keeps, or correct jumps of its samples.",
    )
    REFUSED_ALTERNATIVE = (
        "refused sample counts",
        Effect.NOTE,
        "Nothing came near; the refused sample can be true. Look for swapped ids and jumps in "
        "perception.",
    )
    HIDDEN = (
        "body hidden",
        Effect.NOTE,
        "Find why its source does not see it; it can come nearer unseen.",
    )
    HOLD = (
        "waiting for evidence before the level rises",
        Effect.NOTE,
        "Wait until `rise_delay` after the last cause of this level.",
    )
    NO_SOURCES_EXPECTED = (
        "no sources, as stated",
        Effect.NOTE,
        "Name the sources, unless no obstacle must be watched.",
    )
    NOT_YET_COMPLETE = (
        "not everything evaluated yet",
        Effect.NOTE,
        "Wait for a joint state, or check the address that the controller publishes to.",
    )
    REMOVAL_IGNORED = (
        "removal ignored",
        Effect.NOTE,
        "Check the removal: its id is unknown, or its state newer.",
    )
    FORGOTTEN = (
        "forgotten by a reset",
        Effect.NOTE,
        "Find its sender. If it is real, correct its stamps, or name the source.",
    )
    ID_SHARED = (
        "id used twice",
        Effect.NOTE,
        "Give bodies of different sources different ids. Both are watched.",
    )
    PLAN_REFUSED = (
        "plan refused",
        Effect.NOTE,
        "Correct what the detail names, and send it again. The previous plan still counts.",
    )
    PLAN_UNSAFE = (
        "plan unsafe",
        Effect.NOTE,
        "Finish the previous piece; send a shorter, slower or different one.",
    )
    PLAN_VOID = (
        "plan not followed any more",
        Effect.NOTE,
        "Send a plan that begins where the arm is, with true tracking errors, or restore the lost "
        "premise.",
    )
    PIECE_UNSAFE = (
        "committed piece not safe any more",
        Effect.STANDING,
        "Brake. Then send a piece that is safe now.",
    )
    BUDGET_SPENT = (
        "budget spent before the stop decision was made",
        Effect.NOTE,
        "Raise `budget` by `monitor.headroom()`, or watch fewer obstacles.",
    )
    CROWD = (
        "more is near than was evaluated",
        Effect.NOTE,
        "Do nothing: the level is STOP, and the rest is evaluated later.",
    )
    OBSTACLE_REFUSED = (
        "obstacle refused",
        Effect.NOTE,
        "Look for swapped ids and jumps in perception, or state larger bounds (docs/people.md).",
    )
    POINTS_DROPPED = (
        "points of a cloud dropped",
        Effect.NOTE,
        "Do not send rays that hit nothing; check the camera if they hit something.",
    )
    BOUND_BROKEN = (
        "obstacle broke its bounds",
        Effect.NOTE,
        "State bounds that the body keeps, in the message, in `[bounds.of]`, or by "
        "`armguard.people`.",
    )
    TETHER_BROKEN = (
        "tether broken",
        Effect.NOTE,
        "State a length that both keep, or look for swapped ids and jumps (docs/obstacles.md). It "
        "counts again later.",
    )
    ERRORS_EXCEEDED = (
        "errors larger than stated",
        Effect.NOTE,
        "State the `position_error` or `velocity_error` that the detail names.",
    )
    NO_SOURCES = (
        "no sources",
        Effect.STANDING,
        "Name the sources, or state that there are none: `Obstacles(sources=[])`.",
    )
    SOURCE_SILENT = (
        "source silent",
        Effect.STANDING,
        "Start the source; it must send empty messages too. `required = false` is for one that "
        "may never start.",
    )
    STAMP_AHEAD = (
        "stamp ahead of the clock",
        Effect.STANDING,
        "Let the source stamp by its clock of the cell file, and synchronise that.",
    )
    OBSTACLE_NOT_BELIEVED = (
        "obstacle not believed",
        Effect.STANDING,
        "See the detail: refused, with `on_refusal` for STOP, or too late.",
    )
    SOURCE_NOT_BELIEVED = (
        "source not believed",
        Effect.STANDING,
        "Check units, frame, stamps, ids and bounds of its samples.",
    )
    CALL_REFUSED = (
        "malformed obstacle call",
        Effect.STANDING,
        "Correct the message that the detail names; none of it was used.",
    )
    OTHER_ARM_BROKE = (
        "other arm broke its limits",
        Effect.STANDING,
        "Let its controller keep its limits and plans, or correct them. Its hardware limits count "
        "for 2 s.",
    )
    OVERDUE = (
        "pair overdue",
        Effect.STANDING,
        "Raise `budget` or `max_staleness`, or watch fewer obstacles.",
    )
    IGNORE_UNMATCHED = (
        "ignored pair matches nothing",
        Effect.STANDING,
        "Correct the pattern, or name the source if the obstacle comes later.",
    )
    PAIR_IGNORED = (
        "pair not watched for the time being",
        Effect.NOTE,
        "If it is not intended, `monitor.watch(number)` ends it (docs/contact.md).",
    )
    PAIR_WATCHED = (
        "exempt pair watched again",
        Effect.NOTE,
        "Unless the exemption is over, give more time, or a zone that holds the obstacle until "
        "rest.",
    )
    IN_CONTACT = (
        "in contact",
        Effect.STANDING,
        "Wait until the person draws back, or commit a piece that recedes from the person.",
    )
    MOVED_BY_CONTACT = (
        "contact moved a joint",
        Effect.STANDING,
        "Check what the arm touched, and the tracking errors. It ends once joints keep their "
        "limits.",
    )
    JOINT_STOP_AHEAD = (
        "joint runs into its stop",
        Effect.STANDING,
        "Keep the joint slower near its limit, or correct the limit in robot.toml.",
    )
    BRAKES_NOT_COVERED = (
        "brakes not stated for such speeds",
        Effect.STANDING,
        "Keep the joint slower, state operating limits, or state brakes for it in robot.toml.",
    )
    OPERATING_LIMITS_BROKEN = (
        "operating limits broken",
        Effect.STANDING,
        "Let the controller keep the stated limits, or correct them.",
    )
    ENDED = (
        "monitor has ended",
        Effect.STANDING,
        "Start it again. Standard error or the service's journal has the cause.",
    )
    JOINT_STATE_MALFORMED = (
        "joint state malformed",
        Effect.LATCHED,
        "Send one finite position and velocity per watched joint. Then reset.",
    )
    JOINT_STATE_BEYOND_LIMITS = (
        "joint state beyond its limits",
        Effect.LATCHED,
        "Check units and signs of joint states, and the limits in robot.toml. Then reset.",
    )
    JOINT_STATE_JUMPED = (
        "joint state jumped",
        Effect.LATCHED,
        "Check for lost or swapped states, units and stamps. A simulation with fixed steps must "
        "stamp its nominal time. Then reset.",
    )
    TIME_INVALID = (
        "time not finite",
        Effect.LATCHED,
        "Give finite seconds as stamp and time. Then reset.",
    )
    TIME_BACKWARDS = (
        "time ran backwards",
        Effect.LATCHED,
        "Use a clock that never goes back, such as the monotonic one. Then reset.",
    )
    JOINT_STATE_GAP = (
        "gap in joint states",
        Effect.LATCHED,
        "Find why joint states or their stamps stood still. A slow driver needs a longer "
        "`joint_timeout`. Then reset.",
    )
    INTERNAL_ERROR = (
        "error inside armguard",
        Effect.LATCHED,
        "Keep the recording, and report this fault of armguard. Then reset.",
    )

    def __init__(self, text: str, effect: Effect, remedy: str) -> None:
        self.text = text
        self.effect = effect
        self.remedy = remedy
        self.weight = 0


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


def _weigh(kind: ReasonKind) -> int:
    """The place of a kind among the others: what latches first, mere notes last."""
    if kind.effect is Effect.LATCHED:
        return 0
    if kind is ReasonKind.HOLD:
        return 1
    if kind.effect is Effect.STANDING:
        return 2
    notes = (
        ReasonKind.LATE_DATA,
        ReasonKind.LATE_DATA_UNKNOWN,
        ReasonKind.WIDENED_BOUNDS,
        ReasonKind.REFUSED_ALTERNATIVE,
        ReasonKind.HIDDEN,
        ReasonKind.CONTACT_FORBIDDEN,
        ReasonKind.CONTACT,
        ReasonKind.CONTACT_ALLOWED,
    )
    return 3 + (notes.index(kind) if kind in notes else len(notes))


for _kind in ReasonKind:
    _kind.weight = _weigh(_kind)
_find_weight = operator.attrgetter("kind.weight")


def sort_reasons(reasons: list[Reason]) -> None:
    """Put the weightiest reasons first, in place; equal ones stay in their order."""
    reasons.sort(key=_find_weight)


def find_weightiest(reasons: Iterable[Reason]) -> Reason | None:
    """The weightiest reason, in whatever order they are; None where there is none.

    HOLD is left out: it says only that another one was weightier before.
    """
    causes = (reason for reason in reasons if reason.kind is not ReasonKind.HOLD)
    return min(causes, key=_find_weight, default=None)


class Held(NamedTuple):
    """Why a level is held, though this tick alone would earn a higher one; times in [s]."""

    reason: Reason | None
    """The weightiest reason of the tick that began it; None: a reset began it."""
    contact_time: float
    """Of that tick; of contact that no limit permits, where contact limits are stated."""
    stop_time: float
    """Of that tick."""
    since: float
    """When that was, on the monitor's clock."""
    rises_at: float
    """The earliest time at which the level may rise, on the monitor's clock."""

    def describe(self, level: Level, now: float) -> str:
        """What is held and why, in words, at a time of the monitor's clock in [s]."""
        return (
            f"{level.name} for {now - self.since:.3g} s: {self.describe_cause()}; may rise in "
            f"{max(self.rises_at - now, 0.0):.2g} s"
        )

    def describe_cause(self) -> str:
        """What began it, in words."""
        if self.reason is None:
            return "reset"
        if self.reason.kind is not ReasonKind.CONTACT:
            return str(self.reason)
        return (
            f"{self.reason.subject}, contact time {1e3 * self.contact_time:.0f} ms, "
            f"stop time {1e3 * self.stop_time:.0f} ms"
        )


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
    its velocity limit where none is stated. 1 on a committed piece that is proved safe to its
    end."""
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
    proved_until: float | None = None
    """When the arm rests at the latest, in [s] of the joint states' stamps, if it follows its
    committed piece. The piece is proved safe to its end. Of several such pieces the latest counts.
    None: the arm is on no such piece."""
    held: Held | None = None
    """Why the level is held, though this tick alone would earn a higher one; None: it is not."""
    harm_time: float = 0.0
    """Earliest possible contact that no contact limit permits, counted from `now`, in [s]; the
    contact time where no limits are stated, 0 where unknown."""
    contact_speed: float | None = None
    """Greatest speed in [m/s] at which an obstacle could be touched before the arm rests, were the
    next verdict a STOP; 0 where no contact is possible by then, inf where nothing is proved. None
    where no contact limits are stated."""
    configuration: str | None = None
    """Digest of what the monitor was made with, in verdicts that `armguard run` publishes; None in
    others."""

    def __str__(self) -> str:
        pair = f"{self.link} and {self.obstacle}" if self.link else "no pair"
        proved = "" if self.proved_until is None else f", proved until {self.proved_until:.3f} s"
        return (
            f"{self.level.name} at {self.stamp:.3f} s: {pair}, {self.describe_times()}, allowed "
            f"speed {100.0 * self.speed_scale:.0f} %{proved}"
        )

    def describe_times(self) -> str:
        """Its times in words, that of harm only where contact limits are stated."""
        harm = "" if self.contact_speed is None else f"harm time {self.harm_time:.3f} s, "
        return f"contact time {self.contact_time:.3f} s, {harm}stop time {self.stop_time:.3f} s"


class ResetVerdict(NamedTuple):
    """Whether a monitor has obeyed a reset; frozen."""

    obeyed: bool
    """Whether it has; a cause that persists has latched again at once."""
    problem: str
    """Why not; empty where it has."""


class PlanVerdict(NamedTuple):
    """Whether the arm may follow a plan; frozen."""

    safe: bool
    """Whether it may: then it is what the monitor takes the arm to follow from now on."""
    contact_time: float
    """Earliest possible contact on the way, in [s] from now; inf if there is none before the arm
    rests, 0 where that is unknown."""
    link: str | None
    """Link of the pair that could touch first; None if none can."""
    obstacle: str | None
    """Its obstacle, alike."""
    reasons: tuple[Reason, ...]
    """Why not."""


class PlanChoice(NamedTuple):
    """Which of several plans the arm may follow; frozen."""

    number: int | None
    """Of the one that was committed, from 0, in the order in which they were offered; None: none
    was safe."""
    verdicts: tuple[PlanVerdict, ...]
    """The answers to those that were judged, in their order."""
