"""What stands in a recording: one kind of message for each call, as JSON that needs no armguard.

Every number is written so that it is read back to the bit. JSON has no word for some; they stand as
the strings "Infinity", "-Infinity" and "NaN". Fields that do not apply are left out. The schemas
keep to what viewers of recordings understand: no unions, no lists of lists, so rows of numbers
stand one after another in one list.
"""

from __future__ import annotations

import math
import types
from typing import Annotated, Any, Literal, TypeAlias, Union, get_args, get_origin

import msgspec
import numpy as np
from msgspec import UNSET, UnsetType
from numpy.typing import NDArray

from armguard.contact.earliest import Certificate
from armguard.pairs.exemptions import Exemption
from armguard.robot.portable import read_numbers, write_number, write_numbers
from armguard.verdict import Held, Level, PlanVerdict, Reason, ReasonKind, Verdict

FORMAT = 2
"""Of recordings; a reader refuses those of a later one."""

Number: TypeAlias = float | str
"""A number, or the word for one that JSON has none for."""

Numbers: TypeAlias = list[float | str]


class Event(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A message of a recording."""


class OddArray(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What stood in place of an array of numbers, as far as it matters: it was refused."""

    kind: str
    """NumPy's name of the type of its elements; empty: it was no array at all."""
    shape: list[int]


class JointState(Event, frozen=True, kw_only=False):
    """Arguments of a step: a joint state, and when it was judged."""

    stamp: Number
    """[s]."""
    now: Number
    """[s]."""
    q: Numbers | UnsetType = UNSET
    """[rad] or [m]."""
    v: Numbers | UnsetType = UNSET
    """[rad/s] or [m/s]."""
    odd_q: OddArray | UnsetType = UNSET
    odd_v: OddArray | UnsetType = UNSET


class ObstacleUpdate(Event, frozen=True, kw_only=True):
    """A message of a source; units as in `Obstacles.update`."""

    ids: list[str]
    stamp: Number
    source: str
    frame: str
    snapshot: bool
    points: int
    """How many each obstacle has."""
    position: Numbers
    """x, y, z of each point, one after another."""
    velocity: Numbers | UnsetType = UNSET
    radius: Numbers
    """One for each id; one alone holds for all. So do those that follow."""
    accel: Numbers | UnsetType = UNSET
    speed: Numbers | UnsetType = UNSET
    position_error: Numbers
    velocity_error: Numbers


class StaticObstacle(Event, frozen=True, kw_only=True):
    """An obstacle that stands still for ever, or an entrance, in [m]."""

    id: str
    position: Numbers
    """x, y, z of each point, one after another."""
    radius: Number
    """Of an entrance, with what it was widened by."""
    speed: Number | UnsetType = UNSET
    """Of what comes out of an entrance, in [m/s]; nothing else has one."""
    accel: Number | UnsetType = UNSET
    """Alike, in [m/s²]."""


class Removal(Event, frozen=True, kw_only=True):
    """Obstacles that are gone; who says so, and since when in [s], where that was told."""

    ids: list[str]
    stamp: Number | UnsetType = UNSET
    source: str | UnsetType = UNSET


class MalformedCall(Event, frozen=True, kw_only=True):
    """A call on the table of obstacles of which nothing could be taken."""

    source: str
    offender: str
    problem: str
    stamp: Number


class PromiseBroken(Event, frozen=True, kw_only=True):
    """Another arm broke what was promised of it."""

    source: str
    joint: str
    problem: str
    stamp: Number


class DroppedPoints(Event, frozen=True, kw_only=True):
    """How many points of a cloud could not be used, or none; its voxels stand in an update."""

    source: str
    stamp: Number
    points: int
    dropped: int


class FaultsTaken(Event, frozen=True, kw_only=True):
    """The application asked for the faults of obstacles, so the monitor is not told them."""


class Payload(Event, frozen=True, kw_only=True):
    """What the arm carries at most from now on, in [kg]."""

    payload: Number


class PairIgnored(Event, frozen=True, kw_only=True):
    """Contact of a link and some obstacles is wanted for the time being, from the next step on."""

    number: int
    """By which it is ended; they count from 1."""
    link: str
    ids: str
    """Pattern of obstacle ids."""
    source: str | UnsetType = UNSET
    """Whose obstacles alone are meant."""
    until: Number | UnsetType = UNSET
    """[s]."""
    zone: Numbers | UnsetType = UNSET
    """x, y, z of each corner, one after another, in [m]."""


class PairWatched(Event, frozen=True, kw_only=True):
    """Contact is not wanted any more, from the next step on; by the number of what began it."""

    number: int


class Reset(Event, frozen=True, kw_only=True):
    """Past joint states and latched faults are forgotten."""


class PlanField(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One field of a plan: an array, or what stood in its place."""

    name: str
    values: Numbers = []
    shape: list[int] = []
    kind: str = "<f8"
    """NumPy's name of the type of its elements; empty: it was no array."""


class PlanAsked(Event, frozen=True, kw_only=True):
    """A piece that was to be committed."""

    ask: Literal["commit"] = "commit"
    """In recordings of format 1 some ask to "follow", which no monitor does any more."""
    fields: list[PlanField] = []
    type: str = "Plan"
    """What it was, if it was no plan."""


class ReasonTold(msgspec.Struct, frozen=True):
    """One reason; `kind` is the lower-case name of a `ReasonKind`."""

    kind: str
    subject: str
    detail: str


class PlanAnswered(Event, frozen=True, kw_only=True):
    """The answer to the plan before it."""

    safe: bool
    contact_time: Number
    link: str | UnsetType = UNSET
    obstacle: str | UnsetType = UNSET
    reasons: list[ReasonTold]


class HeldTold(msgspec.Struct, frozen=True):
    """Why a level is held."""

    contact_time: Number
    stop_time: Number
    since: Number
    rises_at: Number
    reason: ReasonTold | UnsetType = UNSET


class VerdictTold(Event, frozen=True):
    """A verdict, all its fields; `sequence` 0: there was no joint state to judge."""

    stamp: Number
    sequence: int
    level: str
    contact_time: Number
    stop_time: Number
    speed_scale: Number
    complete: bool
    evaluated: int
    reasons: list[ReasonTold]
    valid_until: Number
    link: str | UnsetType = UNSET
    obstacle: str | UnsetType = UNSET
    stop: str | UnsetType = UNSET
    separation: Number | UnsetType = UNSET
    certificate_time: Number | UnsetType = UNSET
    certificate_times: Numbers | UnsetType = UNSET
    certificate_witnesses: Numbers | UnsetType = UNSET
    held: HeldTold | UnsetType = UNSET


class LinkTold(msgspec.Struct, frozen=True, omit_defaults=True):
    """A link of the arm; of one that was told before, its name alone."""

    name: str
    data: str = ""
    """As JSON: what `armguard.robot.portable.describe_bodies` says of it."""


class BodiesChanged(Event, frozen=True, kw_only=True):
    """Something was attached to the arm, or taken off."""

    revision: int
    links: list[LinkTold]


class Gap(Event, frozen=True, kw_only=True):
    """Events that were lost here, since what writes the file did not keep up."""

    events: int
    seconds: Number


class Time(msgspec.Struct, frozen=True):
    """A time as viewers of recordings have it."""

    sec: int
    nsec: int


class Log(Event, frozen=True, kw_only=True):
    """A line for people, such as one about a message that could not be used."""

    timestamp: Time
    level: int
    message: str
    name: str = "armguard"
    file: str = ""
    line: int = 0


TOPICS: dict[type[Event], str] = {
    JointState: "joint_state",
    ObstacleUpdate: "obstacles",
    StaticObstacle: "statics",
    Removal: "removals",
    MalformedCall: "malformed_calls",
    PromiseBroken: "broken_promises",
    DroppedPoints: "dropped_points",
    FaultsTaken: "faults_taken",
    Payload: "payload",
    PairIgnored: "ignored_pairs",
    PairWatched: "watched_pairs",
    Reset: "resets",
    PlanAsked: "plans",
    PlanAnswered: "plan_verdicts",
    VerdictTold: "verdict",
    BodiesChanged: "bodies",
    Gap: "gaps",
    Log: "log",
}
"""Where each kind stands, below `PREFIX`."""

PREFIX = "/armguard/"

SCHEMA_NAMES: dict[type[Event], str] = {Log: "foxglove.Log"}
"""Of schemas that are not armguard's own."""

KINDS = tuple(TOPICS)

_encoder = msgspec.json.Encoder()

_LEVELS = {level: level.name for level in Level}

REASON_NAMES = {kind: kind.name.lower() for kind in ReasonKind}


def encode(event: msgspec.Struct) -> bytes:
    """An event as it stands in a recording."""
    return _encoder.encode(event)


def schema_name(kind: type[Event]) -> str:
    """What the schema of a kind of event is called."""
    return SCHEMA_NAMES.get(kind, f"armguard.{kind.__name__}")


def make_schema(kind: type[msgspec.Struct]) -> dict[str, Any]:
    """The JSON schema of a kind of event, in the part of the language that viewers understand."""
    fields = msgspec.structs.fields(kind)
    return {
        "title": kind.__name__,
        "description": (kind.__doc__ or "").partition("\n")[0],
        "type": "object",
        "properties": {field.encode_name: _describe_type(field.type) for field in fields},
        "required": [field.encode_name for field in fields if field.required],
    }


def _describe_type(kind: Any) -> dict[str, Any]:
    if get_origin(kind) is Annotated:
        kind = get_args(kind)[0]
    if get_origin(kind) in (Union, types.UnionType):
        options = [one for one in get_args(kind) if one is not UnsetType]
        # A number may stand as a word, which no simple schema can say.
        kind = float if float in options else options[0]
    if get_origin(kind) is Literal:
        return {"type": "string", "enum": list(get_args(kind))}
    if get_origin(kind) is list:
        return {"type": "array", "items": _describe_type(get_args(kind)[0])}
    if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
        return make_schema(kind)
    names = {float: "number", int: "integer", str: "string", bool: "boolean"}
    return {"type": names[kind]}


def tell_verdict(verdict: Verdict) -> VerdictTold:
    """A verdict as it stands in a recording."""
    certificate, separation = verdict.certificate, verdict.separation
    # By place, since this is part of every tick.
    return VerdictTold(
        spell(verdict.stamp),
        int(verdict.sequence),
        _LEVELS[verdict.level],
        spell(verdict.contact_time),
        spell(verdict.stop_time),
        spell(verdict.speed_scale),
        bool(verdict.complete),
        int(verdict.evaluated),
        _tell_reasons(verdict.reasons),
        spell(verdict.valid_until),
        UNSET if verdict.link is None else verdict.link,
        UNSET if verdict.obstacle is None else verdict.obstacle,
        UNSET if verdict.stop is None else verdict.stop,
        UNSET if separation is None else spell(separation),
        UNSET if certificate is None else spell(certificate.contact_time),
        UNSET if certificate is None else write_numbers(certificate.times),
        UNSET if certificate is None else write_numbers(np.ravel(certificate.witnesses)),
        UNSET if verdict.held is None else _tell_held(verdict.held),
    )


def _tell_held(held: Held) -> HeldTold:
    return HeldTold(
        spell(held.contact_time),
        spell(held.stop_time),
        spell(held.since),
        spell(held.rises_at),
        UNSET if held.reason is None else _tell_reasons((held.reason,))[0],
    )


def _read_held(told: HeldTold) -> Held:
    reason = None if told.reason is UNSET else _read_reason(told.reason)
    return Held(
        reason,
        float(told.contact_time),
        float(told.stop_time),
        float(told.since),
        float(told.rises_at),
    )


def read_verdict(told: VerdictTold) -> Verdict:
    """A verdict from what stands in a recording.

    Raises:
        ValueError: It is of no version that this one knows.
    """
    certificate = None
    if told.certificate_times is not UNSET and told.certificate_witnesses is not UNSET:
        assert not isinstance(told.certificate_time, UnsetType)
        certificate = Certificate(
            float(told.certificate_time),
            read_numbers(told.certificate_times),
            read_numbers(told.certificate_witnesses).reshape(-1, 3),
        )
    if told.level not in Level.__members__:
        raise ValueError(f"level {told.level!r}")
    return Verdict(
        stamp=float(told.stamp),
        sequence=told.sequence,
        level=Level[told.level],
        contact_time=float(told.contact_time),
        stop_time=float(told.stop_time),
        speed_scale=float(told.speed_scale),
        link=None if told.link is UNSET else told.link,
        obstacle=None if told.obstacle is UNSET else told.obstacle,
        complete=told.complete,
        evaluated=told.evaluated,
        reasons=tuple(map(_read_reason, told.reasons)),
        valid_until=float(told.valid_until),
        separation=None if told.separation is UNSET else float(told.separation),
        certificate=certificate,
        stop=None if told.stop is UNSET else ("finish" if told.stop == "finish" else "brake"),
        held=None if told.held is UNSET else _read_held(told.held),
    )


def tell_exemption(exemption: Exemption) -> PairIgnored:
    """An exemption as it stands in a recording."""
    link, ids, source = exemption.pair
    zone = exemption.zone
    return PairIgnored(
        number=exemption.number,
        link=link,
        ids=ids,
        source=UNSET if source is None else source,
        until=UNSET if exemption.until == math.inf else spell(exemption.until),
        zone=UNSET if zone is None else write_numbers(np.ravel(zone.points)),
    )


def tell_answer(answer: PlanVerdict) -> PlanAnswered:
    """The answer to a plan as it stands in a recording."""
    return PlanAnswered(
        safe=bool(answer.safe),
        contact_time=write_number(float(answer.contact_time)),
        link=UNSET if answer.link is None else answer.link,
        obstacle=UNSET if answer.obstacle is None else answer.obstacle,
        reasons=_tell_reasons(answer.reasons),
    )


def spell(value: float) -> Number:
    """A number as a plain float, or the word for one that JSON has none for."""
    return float(value) if -math.inf < value < math.inf else write_number(float(value))


def write_field(values: NDArray[np.float64]) -> Numbers:
    """One number a row, or one alone where all are the same to the bit. Shape (n,)."""
    if len(values) > 1 and (values.view(np.int64) == values.view(np.int64)[0]).all():
        values = values[:1]
    listed: Numbers = write_numbers(values)
    return listed


def read_field(values: Numbers, count: int) -> NDArray[np.float64]:
    """What `write_field` wrote of so many rows. Shape (count,)."""
    array = read_numbers(values)
    return np.full(count, array[0]) if len(array) == 1 != count else array


def _tell_reasons(reasons: tuple[Reason, ...]) -> list[ReasonTold]:
    return [ReasonTold(REASON_NAMES[one.kind], one.subject, one.detail) for one in reasons]


def _read_reason(told: ReasonTold) -> Reason:
    if told.kind.upper() not in ReasonKind.__members__:
        raise ValueError(f"reason {told.kind!r}")
    return Reason(ReasonKind[told.kind.upper()], told.subject, told.detail)
