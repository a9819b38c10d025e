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
        "Nothing is wrong: the level rests on this pair. `monitor.explain()` and `armguard replay "
        "--explain` say what would buy time.",
    )
    CONTACT_ALLOWED = (
        "contact allowed",
        Effect.NOTE,
        "If this contact is permitted, nothing; else remove the contact limit "
        "(docs/contact_limits.md).",
    )
    CONTACT_FORBIDDEN = (
        "contact not permitted",
        Effect.NOTE,
        "Nothing is wrong: the detail says which contact limit would be exceeded. Keep the arm "
        "slower there. Where a part can be clamped, give more room, or a limit with `force` and "
        "`stiffness`. State a region that is not stated (docs/contact_limits.md).",
    )
    LATE_DATA = (
        "late data",
        Effect.NOTE,
        "Find out what delayed the source or the joint states: a busy processor, a network, a "
        "camera that pauses. Nothing came near: the detail names the level with data of their "
        "usual age.",
    )
    LATE_DATA_UNKNOWN = (
        "late data, effect unknown",
        Effect.NOTE,
        "Find out what delayed the source or the joint states. Too much was near to compute the "
        "level with data of their usual age.",
    )
    WIDENED_BOUNDS = (
        "bounds widened",
        Effect.NOTE,
        "Nothing came near: with the stated bounds the level would be higher. State bounds that "
        "the body keeps, or correct what makes its samples jump.",
    )
    REFUSED_ALTERNATIVE = (
        "refused sample counts",
        Effect.NOTE,
        "Nothing came near: without the refused sample, which may be true, the level would be "
        "higher. Look for swapped ids and jumps in perception.",
    )
    HIDDEN = (
        "body hidden",
        Effect.NOTE,
        "Nothing came near: a body that is not seen may come nearer. Find out why its source does "
        "not see it.",
    )
    HOLD = (
        "waiting for evidence before the level rises",
        Effect.NOTE,
        "Wait: a level rises `rise_delay` seconds after the last cause of the lower one.",
    )
    NO_SOURCES_EXPECTED = (
        "no sources, as stated",
        Effect.NOTE,
        "If no obstacle is to be watched, nothing; else name the cell's sources.",
    )
    NOT_YET_COMPLETE = (
        "not everything evaluated yet",
        Effect.NOTE,
        "Wait for the first joint state and tick. If it stays, check that the controller "
        "publishes to the address that `armguard run` printed.",
    )
    REMOVAL_IGNORED = (
        "removal ignored",
        Effect.NOTE,
        "Check what the source removes: an id that it never reported, or a state newer than the "
        "removal.",
    )
    FORGOTTEN = (
        "forgotten by a reset",
        Effect.NOTE,
        "Find out who sent it: an obstacle without a believable state, or a source that was not "
        "named. If it is real, correct its stamps, or name the source.",
    )
    ID_SHARED = (
        "id used twice",
        Effect.NOTE,
        "Give bodies of different sources different ids. Both are watched until then.",
    )
    PLAN_REFUSED = (
        "plan refused",
        Effect.NOTE,
        "Correct what the detail names, and send the plan again. The one before still counts.",
    )
    PLAN_UNSAFE = (
        "plan unsafe",
        Effect.NOTE,
        "Finish the piece before; send a shorter or slower one, or another path.",
    )
    PLAN_VOID = (
        "plan not followed any more",
        Effect.NOTE,
        "The arm is not where its plan has it, or a premise of the plan is gone. Send one that "
        "begins where the arm is; state tracking errors that it keeps.",
    )
    PIECE_UNSAFE = (
        "committed piece not safe any more",
        Effect.STANDING,
        "Brake. Then send a piece that is safe by what is seen now.",
    )
    BUDGET_SPENT = (
        "budget spent before the stop decision was made",
        Effect.NOTE,
        "Raise `budget`, or watch fewer obstacles. `monitor.headroom()` says how much is missing.",
    )
    CROWD = (
        "more is near than was evaluated",
        Effect.NOTE,
        "Nothing: a STOP is certain anyway, and the rest is evaluated after it.",
    )
    OBSTACLE_REFUSED = (
        "obstacle refused",
        Effect.NOTE,
        "The sample cannot be of that body by its bounds. Look for swapped ids and jumps in "
        "perception; if the body is that fast, state larger bounds (docs/people.md).",
    )
    POINTS_DROPPED = (
        "points of a cloud dropped",
        Effect.NOTE,
        "Do not send rays that hit nothing. If they did hit something, check the camera: what "
        "they hit is not known.",
    )
    BOUND_BROKEN = (
        "obstacle broke its bounds",
        Effect.NOTE,
        "State bounds that the body keeps: `accel` and `speed` of the message, a pattern in "
        "`[bounds.of]`, or `armguard.people` by body part.",
    )
    TETHER_BROKEN = (
        "tether broken",
        Effect.NOTE,
        "State a length that both obstacles keep, or look for swapped ids and jumps in "
        "perception. The tether is not used until both agree for `rise_delay` "
        "(docs/obstacles.md).",
    )
    ERRORS_EXCEEDED = (
        "errors larger than stated",
        Effect.NOTE,
        "State the errors that the detail names, `position_error` and `velocity_error`: every "
        "proof rests on them.",
    )
    NO_SOURCES = (
        "no sources",
        Effect.STANDING,
        "Name the sources, or state that there are none: `Obstacles(sources=[])`.",
    )
    SOURCE_SILENT = (
        "source silent",
        Effect.STANDING,
        "Start the source. One that sees nothing must send empty messages as heartbeat. `required "
        "= false` is for one that may never start: what has once sent is missed afterwards. A "
        "reset forgets one that was not named.",
    )
    STAMP_AHEAD = (
        "stamp ahead of the clock",
        Effect.STANDING,
        "Let the source stamp by the clock that the cell file names for it, and synchronise that "
        "clock.",
    )
    OBSTACLE_NOT_BELIEVED = (
        "obstacle not believed",
        Effect.STANDING,
        "See the detail: a sample was refused and its source asks for STOP, or it came too late "
        "for the table to hold it.",
    )
    SOURCE_NOT_BELIEVED = (
        "source not believed",
        Effect.STANDING,
        "Most of its samples contradict its own bounds: check units, frame, stamps and ids.",
    )
    CALL_REFUSED = (
        "malformed obstacle call",
        Effect.STANDING,
        "Correct the message that the detail names; nothing of it was used.",
    )
    OTHER_ARM_BROKE = (
        "other arm broke its limits",
        Effect.STANDING,
        "Let that arm's controller keep its operating limits and plans, or state what it keeps. "
        "Its hardware's limits count until 2 s after the last violation. Nothing needs a reset.",
    )
    OVERDUE = (
        "pair overdue",
        Effect.STANDING,
        "The tick had no time for all pairs: raise `budget` or `max_staleness`, or watch fewer "
        "obstacles.",
    )
    IGNORE_UNMATCHED = (
        "ignored pair matches nothing",
        Effect.STANDING,
        "Correct the pattern. If the obstacle comes later, name its source: (link, pattern, "
        "source).",
    )
    PAIR_IGNORED = (
        "pair not watched for the time being",
        Effect.NOTE,
        "If this contact is wanted, nothing; `monitor.watch(number)` ends it (docs/contact.md).",
    )
    PAIR_WATCHED = (
        "exempt pair watched again",
        Effect.NOTE,
        "If the exemption is over, nothing. Else give it more time, or a zone that holds all that "
        "the obstacle may do until the arm is at rest.",
    )
    IN_CONTACT = (
        "in contact",
        Effect.STANDING,
        "Wait until the person has drawn back; then the arm goes on. Or commit a piece on which "
        "the arm recedes from the person.",
    )
    MOVED_BY_CONTACT = (
        "contact moved a joint",
        Effect.STANDING,
        "The contact was harder than brakes or tracking allow for. Check what the arm touched, "
        "and the stated tracking errors. It ends once joints keep their limits.",
    )
    JOINT_STOP_AHEAD = (
        "joint runs into its stop",
        Effect.STANDING,
        "The joint cannot stop before its limit. Keep the arm slower there, or correct the limit "
        "in robot.toml.",
    )
    BRAKES_NOT_COVERED = (
        "brakes not stated for such speeds",
        Effect.STANDING,
        "Keep the joint slower, state operating limits (`operating=`), or state brakes for that "
        "speed and load in robot.toml.",
    )
    OPERATING_LIMITS_BROKEN = (
        "operating limits broken",
        Effect.STANDING,
        "Let the controller keep the stated limits, or state what it keeps.",
    )
    ENDED = (
        "monitor has ended",
        Effect.STANDING,
        "Start it again. If nobody ended it, see its last lines on standard error or its "
        "service's journal.",
    )
    JOINT_STATE_MALFORMED = (
        "joint state malformed",
        Effect.LATCHED,
        "Send one finite position and velocity for each watched joint. Then reset.",
    )
    JOINT_STATE_BEYOND_LIMITS = (
        "joint state beyond its limits",
        Effect.LATCHED,
        "Check units and signs of the joint states, and the limits in robot.toml. Then reset.",
    )
    JOINT_STATE_JUMPED = (
        "joint state jumped",
        Effect.LATCHED,
        "No arm moves like that: check for lost or swapped states, units, and stamps of the "
        "measurement. A simulated driver with fixed steps must stamp by its nominal time. Then "
        "reset.",
    )
    TIME_INVALID = (
        "time not finite",
        Effect.LATCHED,
        "Give finite seconds as stamp and time. Then reset.",
    )
    TIME_BACKWARDS = (
        "time ran backwards",
        Effect.LATCHED,
        "Use a clock that never goes back (the monotonic one). Then reset.",
    )
    JOINT_STATE_GAP = (
        "gap in joint states",
        Effect.LATCHED,
        "Find out why joint states stayed away, or one stamp did not change. A slow driver needs "
        "a longer `joint_timeout`. Then reset.",
    )
    INTERNAL_ERROR = (
        "error inside armguard",
        Effect.LATCHED,
        "This is a fault of armguard: keep the recording, report it with the detail. Then reset.",
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
