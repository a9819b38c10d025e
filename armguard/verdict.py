"""Verdicts: the answer of a monitor in every tick.

A `Verdict` is a small frozen record: how imminent contact is, whether the arm may move on, and why.
Everything unknown counts as the worst case, which is STOP.
"""

from __future__ import annotations

import enum
import operator
from collections.abc import Iterable
from typing import TYPE_CHECKING, Literal, NamedTuple

if TYPE_CHECKING:
    from armguard.contact.earliest import Certificate


class Level(enum.IntEnum):
    """Level of a verdict: what the controller must do; STOP < SLOW < AWARE < CLEAR."""

    STOP = 0
    """Brake now, unless `Verdict.stop` says that the committed piece may be finished: contact could
    come before the arm is at rest, or something is unknown."""
    SLOW = 1
    """The contact time is less than `slow_margin` beyond the stop time. Never on a committed piece
    that is proved safe to its end."""
    AWARE = 2
    """The contact time is less than `aware_margin` beyond the stop time."""
    CLEAR = 3
    """The contact time is far beyond the stop time."""


FINISH: Literal["finish"] = "finish"
"""`Verdict.stop` if the arm must follow its committed piece to rest."""

BRAKE: Literal["brake"] = "brake"
"""`Verdict.stop` if the arm must leave its motion and brake."""


class Effect(enum.Enum):
    """Effect of a reason on the level."""

    NOTE = "note"
    """Explains the verdict, without effect on the level."""
    STANDING = "standing"
    """STOP while it lasts, and `rise_delay` seconds beyond."""
    LATCHED = "latched"
    """STOP until `Monitor.reset()`."""


class ReasonKind(enum.Enum):
    """Kinds of reasons of a verdict.

    Attributes:
        text: The kind in a few words.
        effect: Its effect on the level.
        remedy: What to do about it.
        weight: Its rank among the kinds; the weightiest has the least weight.
    """

    CONTACT = (
        "contact possible",
        Effect.NOTE,
        "Do nothing: this pair decides the level.",
    )
    CONTACT_ALLOWED = (
        "contact allowed",
        Effect.NOTE,
        "Remove the contact limit if contact is not intended.",
    )
    CONTACT_FORBIDDEN = (
        "contact not permitted",
        Effect.NOTE,
        "Keep the arm slower there, or state a limit (docs/contact_limits.md).",
    )
    LATE_DATA = (
        "late data",
        Effect.NOTE,
        "Find what delayed the source or the joint states.",
    )
    LATE_DATA_UNKNOWN = (
        "late data, effect unknown",
        Effect.NOTE,
        "Find what delayed the source or the joint states.",
    )
    WIDENED_BOUNDS = (
        "bounds widened",
        Effect.NOTE,
        "State bounds that the body keeps.",
    )
    REFUSED_ALTERNATIVE = (
        "refused sample counts",
        Effect.NOTE,
        "Look for swapped ids and jumps in perception.",
    )
    HIDDEN = (
        "body hidden",
        Effect.NOTE,
        "Find why its source does not see it.",
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
        "Wait for a joint state, or check the controller's address.",
    )
    REMOVAL_IGNORED = (
        "removal ignored",
        Effect.NOTE,
        "Check the removal: its id is unknown, or its state newer.",
    )
    FORGOTTEN = (
        "forgotten by a reset",
        Effect.NOTE,
        "Find its sender, and correct its stamps.",
    )
    ID_SHARED = (
        "id used twice",
        Effect.NOTE,
        "Give bodies of different sources different ids.",
    )
    PLAN_REFUSED = (
        "plan refused",
        Effect.NOTE,
        "Correct what the detail names. The previous plan still counts.",
    )
    PLAN_UNSAFE = (
        "plan unsafe",
        Effect.NOTE,
        "Finish the previous piece, and send a different one.",
    )
    PLAN_VOID = (
        "plan not followed any more",
        Effect.NOTE,
        "Send a plan that begins where the arm is.",
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
        "Do nothing: the rest is evaluated later.",
    )
    OBSTACLE_REFUSED = (
        "obstacle refused",
        Effect.NOTE,
        "Look for swapped ids and jumps in perception, or state larger bounds (docs/people.md).",
    )
    POINTS_DROPPED = (
        "points of a cloud dropped",
        Effect.NOTE,
        "Do not send rays that hit nothing, or check the camera.",
    )
    BOUND_BROKEN = (
        "obstacle broke its bounds",
        Effect.NOTE,
        "State bounds that the body keeps: in the message, or in `[bounds.of]`.",
    )
    TETHER_BROKEN = (
        "tether broken",
        Effect.NOTE,
        "State a length that both keep, or look for swapped ids (docs/obstacles.md).",
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
        "Start the source; it must send empty messages too.",
    )
    STAMP_AHEAD = (
        "stamp ahead of the clock",
        Effect.STANDING,
        "Check the source's clock and its `clock` key.",
    )
    OBSTACLE_NOT_BELIEVED = (
        "obstacle not believed",
        Effect.STANDING,
        "See the detail: the sample was refused, or came too late.",
    )
    SOURCE_NOT_BELIEVED = (
        "source not believed",
        Effect.STANDING,
        "Check units, frame, stamps, ids and bounds of its samples.",
    )
    CALL_REFUSED = (
        "malformed obstacle call",
        Effect.STANDING,
        "Correct the message that the detail names.",
    )
    OTHER_ARM_BROKE = (
        "other arm broke its limits",
        Effect.STANDING,
        "Let its controller keep its limits and plans.",
    )
    OVERDUE = (
        "pair overdue",
        Effect.STANDING,
        "Raise `budget` or `max_staleness`, or watch fewer obstacles.",
    )
    IGNORE_UNMATCHED = (
        "ignored pair matches nothing",
        Effect.STANDING,
        "Correct the pattern, or name the source.",
    )
    PAIR_IGNORED = (
        "pair not watched for the time being",
        Effect.NOTE,
        "Call `monitor.watch(number)` if it is not intended.",
    )
    PAIR_WATCHED = (
        "exempt pair watched again",
        Effect.NOTE,
        "Give more time or a larger zone.",
    )
    IN_CONTACT = (
        "in contact",
        Effect.STANDING,
        "Wait until the person draws back.",
    )
    MOVED_BY_CONTACT = (
        "contact moved a joint",
        Effect.STANDING,
        "Check what the arm touched, and the tracking errors.",
    )
    JOINT_STOP_AHEAD = (
        "joint runs into its stop",
        Effect.STANDING,
        "Keep the joint slower near its limit.",
    )
    BRAKES_NOT_COVERED = (
        "brakes not stated for such speeds",
        Effect.STANDING,
        "Keep the joint slower, or state brakes for its speed in robot.toml.",
    )
    OPERATING_LIMITS_BROKEN = (
        "operating limits broken",
        Effect.STANDING,
        "Let the controller keep the stated limits.",
    )
    ENDED = (
        "monitor has ended",
        Effect.STANDING,
        "Start it again. Standard error or the journal has the cause.",
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
        "Check for lost or swapped states, units and stamps. Then reset.",
    )
    TIME_INVALID = (
        "time not finite",
        Effect.LATCHED,
        "Give finite seconds as stamp and time. Then reset.",
    )
    TIME_BACKWARDS = (
        "time ran backwards",
        Effect.LATCHED,
        "Use a clock that never goes back. Then reset.",
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
    """One reason of a verdict."""

    kind: ReasonKind
    subject: str = ""
    """Subject: a source, an obstacle, a joint, or a link and an obstacle."""
    detail: str = ""
    """Value found and value expected, in words."""

    def __str__(self) -> str:
        text = f"{self.kind.text}: {self.subject}" if self.subject else self.kind.text
        return f"{text} ({self.detail})" if self.detail else text


def _weigh(kind: ReasonKind) -> int:
    """The weight of a kind: latching kinds first, notes last."""
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
    """The weightiest reason, in any order of the list; None if it is empty.

    HOLD does not count: it only says that an earlier reason was weightier.
    """
    causes = (reason for reason in reasons if reason.kind is not ReasonKind.HOLD)
    return min(causes, key=_find_weight, default=None)


class Held(NamedTuple):
    """Why a level is held, although this tick alone would give a higher one; times in [s]."""

    reason: Reason | None
    """The weightiest reason of the tick in which it began; None: it began with a reset."""
    contact_time: float
    """Contact time of that tick; the harm time, if contact limits are stated."""
    stop_time: float
    """Stop time of that tick."""
    since: float
    """Time of that tick, on the monitor's clock."""
    rises_at: float
    """The earliest time at which the level may rise, on the monitor's clock."""

    def describe(self, level: Level, now: float) -> str:
        """Describe in words what is held and why, at a time of the monitor's clock in [s]."""
        return (
            f"{level.name} for {now - self.since:.3g} s: {self.describe_cause()}; may rise in "
            f"{max(self.rises_at - now, 0.0):.2g} s"
        )

    def describe_cause(self) -> str:
        """Describe in words why it began."""
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
    """Stamp of the judged joint state."""
    sequence: int
    """Number of this tick, from 1; a reset does not restart it."""
    level: Level
    """What the controller must do."""
    contact_time: float
    """Contact time from `now`: no contact is possible before; inf without pairs, 0 if unknown."""
    stop_time: float
    """Stop time from `now`: the arm is at rest by then, if the next verdict is a STOP."""
    speed_scale: float
    """Speed scale: fraction of the operating velocities (else of the velocity limits) below which
    every joint must stay. 1 on a committed piece that is proved safe to its end."""
    link: str | None
    """Link of the deciding pair; None without pairs, or if not all obstacles are known."""
    obstacle: str | None
    """Obstacle of the deciding pair; None if `link` is None."""
    complete: bool
    """Whether every pair has a certificate in force, or had a stop decision in this tick. If a STOP
    is certain anyway, near pairs may wait; a reason says so."""
    evaluated: int
    """Number of contact-time evaluations in this tick, sphere against obstacle."""
    reasons: tuple[Reason, ...]
    """Reasons of the verdict, the weightiest first."""
    valid_until: float
    """Time at which the verdict expires; without a newer one the controller must brake then."""
    separation: float | None = None
    """Margin to the separation distance in [m], if a rule is set."""
    certificate: Certificate | None = None
    """Certificate of the deciding pair, if requested in the settings."""
    stop: Literal["finish", "brake"] | None = None
    """How to obey a STOP; None at other levels. FINISH: follow the committed piece to rest, which
    is proved safe. BRAKE: leave it and brake, since no such proof holds."""
    proved_until: float | None = None
    """Latest time at which the arm is at rest if it follows its committed piece, in [s] of the
    joint states' stamps. The piece is proved safe to its end; of several pieces the latest counts.
    None: the arm is on no such piece."""
    held: Held | None = None
    """Why the level is held, although this tick alone would give a higher one; None: it is not."""
    harm_time: float = 0.0
    """Harm time from `now`, in [s]: no contact that the limits forbid is possible before. Without
    contact limits it is the contact time; 0 if unknown."""
    contact_speed: float | None = None
    """Contact speed in [m/s]: greatest speed of any contact before the arm is at rest, if the next
    verdict is a STOP. 0 if no contact is possible by then, inf if nothing is proved; None without
    contact limits."""
    configuration: str | None = None
    """Digest of the monitor's configuration, in verdicts that `armguard run` publishes; None in
    others."""
    run: str = ""
    """Random text that each start of `armguard run` makes anew: another one means that the monitor
    was restarted, and its latched STOPs were lost. Empty in verdicts that nobody published."""
    arm: str = ""
    """Name of the arm, in verdicts that `armguard run` publishes for one of several arms: no other
    arm may obey them. Otherwise empty."""

    def __str__(self) -> str:
        pair = f"{self.link} and {self.obstacle}" if self.link else "no pair"
        proved = "" if self.proved_until is None else f", proved until {self.proved_until:.3f} s"
        return (
            f"{self.level.name} at {self.stamp:.3f} s: {pair}, {self.describe_times()}, allowed "
            f"speed {100.0 * self.speed_scale:.0f} %{proved}"
        )

    def describe_times(self) -> str:
        """Describe its times in words; the harm time only if contact limits are stated."""
        harm = "" if self.contact_speed is None else f"harm time {self.harm_time:.3f} s, "
        return f"contact time {self.contact_time:.3f} s, {harm}stop time {self.stop_time:.3f} s"


class ResetVerdict(NamedTuple):
    """Answer to a reset; frozen."""

    obeyed: bool
    """Whether the reset was obeyed; a cause that persists latches again at once."""
    problem: str
    """Why it was refused; empty if it was obeyed."""


class PlanVerdict(NamedTuple):
    """Answer to a plan; frozen."""

    safe: bool
    """Whether the arm may follow the plan; if so, the monitor assumes from now on that it does."""
    contact_time: float
    """Earliest possible contact on the plan, in [s] from now; inf if none is possible before the
    arm is at rest, 0 if unknown."""
    link: str | None
    """Link of the first possible contact; None if none is possible."""
    obstacle: str | None
    """Obstacle of the first possible contact; None if none is possible."""
    reasons: tuple[Reason, ...]
    """Why not."""


class PlanChoice(NamedTuple):
    """Answer to several plans; frozen."""

    number: int | None
    """Number of the committed plan, from 0, in the offered order; None: none was safe."""
    verdicts: tuple[PlanVerdict, ...]
    """Answers to the judged plans, in order."""
