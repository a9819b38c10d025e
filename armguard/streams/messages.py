"""What goes over the wire: one schema for every message, in msgpack or JSON.

The two encodings carry the same fields and are told apart by their first byte: no msgpack map
begins with a brace or white space. msgspec holds types and names; what a type cannot say (lengths,
packed arrays, finiteness) is checked by `to_points` and `to_values`, once, at the edge.
"""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Iterable
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from armguard.contact.earliest import Certificate
from armguard.verdict import Held, Level, PlanVerdict, Reason, ReasonKind, ResetVerdict, Verdict

_CLOSER_LOOK = 65536
"""Longest message, in bytes, that is read a second time to say what was wrong with it."""

POINT_LIMIT = 8
"""Most points of one obstacle."""

GREATEST = sys.float_info.max
"""Stands in JSON for what is infinite."""

Points = bytes | list[list[float | list[float]]]
"""Rows of points: (n, 3) or (n, k, 3) nested lists, or packed little-endian float64."""

Cloud = bytes | list[list[float]]
"""Points of a cloud: (n, 3) nested lists, or packed little-endian float64."""

Rows = bytes | list[list[float]]
"""One row a sample: (k, n) nested lists, or packed little-endian float64."""

Number = Annotated[int, msgspec.Meta(ge=0, le=2**63 - 1)]
"""What a sender counts its plans by; answers carry it in msgpack, which has none beyond."""

Values = float | bytes | list[float]
"""One value for all, or one a row: a list, or packed little-endian float64."""


Figure = float | None
"""A number of an answer: nil stands in JSON for what is no number, as of a stamp that was none."""


class MessageError(Exception):
    """A message that cannot be used: where, what was found, what was expected, and from whom."""

    kind = "malformed"
    """What it is counted as."""

    def __init__(
        self,
        field: str,
        value: str,
        expected: str,
        source: str = "unknown",
        sequence: int | None = None,
    ) -> None:
        self.field = field
        self.value = value
        self.expected = expected
        self.source = source
        self.sequence = sequence
        super().__init__(f"{field} is {value}; expected {expected}")


class Message(msgspec.Struct, forbid_unknown_fields=True, tag_field="type"):
    """What every message is: a map whose `type` names one of the children below.

    docs/wire.md is made of these classes: a field's text is the one that stands below it.
    """


class ObstaclesMessage(Message, tag="obstacles"):
    """States of obstacles as one source saw them at one time; without ids, a heartbeat."""

    ids: list[str]
    """names of the obstacles, each once; n of them"""
    stamp: float
    """when they were there, [s] on the clock of the source"""
    source: str = "default"
    """name of the sender; one sender a source"""
    seq: int | None = None
    """counts the messages of the source, `remove` among them, so that lost ones are told"""
    frame: str = "world"
    """of positions and velocities: `world`, `base`, or one of `[frames]` in the cell file"""
    snapshot: bool = False
    """whether this is all that the source sees and it sees the whole cell: absent ids are gone"""
    position: Points = []
    """centres, or points whose hull, rounded by `radius`, is the body, [m]"""
    velocity: Points | None = None
    """of the same points, [m/s]; left out: any within the bound on speed"""
    radius: Values | None = None
    """by which hulls are rounded, [m], at least 0; needed wherever there are ids"""
    accel: Values | None = None
    """bound on acceleration, [m/s²]; left out: the cell's"""
    speed: Values | None = None
    """bound on speed, [m/s]; left out: the cell's"""
    position_error: Values = 0.0
    """what positions may be off by, [m]"""
    velocity_error: Values = 0.0
    """what velocities may be off by, [m/s]"""


class CloudMessage(Message, tag="cloud"):
    """Points that one source measured at one time, as a depth camera does; without, a heartbeat."""

    stamp: float
    """when they were measured, [s] on the clock of the source"""
    origin: tuple[float, float, float]
    """where the rays to the points begin, the camera's centre, [m]"""
    points: Cloud = []
    """where the rays end, [m]"""
    source: str = "default"
    """name of the sender; one sender a source"""
    seq: int | None = None
    """counts the messages of the source, so that lost ones are told"""
    frame: str = "world"
    """of points and origin: `world`, `base`, or one of `[frames]` in the cell file"""
    voxel: float = 0.05
    """edge of the voxels that points become, [m]; the same in all clouds of the source"""
    occupied: bytes | list[bool] | None = None
    """whether each point is to be an obstacle; one byte each, 0 or 1, in a `bin`; left out: each is
    that is not the arm's"""
    position_error: float = 0.0
    """what points may be off by, [m], half the distance between neighbouring rays included"""
    accel: float | None = None
    """bound on acceleration, [m/s²]; left out: the cell's for the id `voxel`"""
    speed: float | None = None
    """bound on speed, [m/s]; left out: the cell's for the id `voxel`"""
    snapshot: bool = False
    """whether the source sees the whole cell, so that all else of it is gone"""


class JointsMessage(Message, tag="joints"):
    """The arm's joint state; any order of names, more of them than needed is no fault."""

    stamp: float
    """when the state was measured, [s] on the clock of the joint states"""
    names: list[str]
    """of the joints, in any order; more than the watched ones are no fault, fewer are"""
    q: bytes | list[float]
    """positions, [rad] or [m], one a name"""
    v: bytes | list[float]
    """velocities, [rad/s] or [m/s], one a name"""
    seq: int | None = None
    """counts the messages, so that lost ones are told"""
    arm: str = ""
    """whose state it is, by its name in a cell with several arms; left out where there is one"""


class PlanMessage(Message, tag="plan"):
    """What the controller is about to do, and what it asks: may the arm?"""

    ask: Literal["commit", "share"]
    """whether a piece that carries its own stop may be done; or nothing: a promise to the monitors
    of other arms"""
    number: Number
    """of the plan; the answer carries it, and all readers see all answers: use none twice, and none
    of another sender's"""
    stamp: float
    """when the arm is at the first sample, [s] on the clock of the joint states"""
    names: list[str]
    """of the joints, in any order"""
    times: bytes | list[float]
    """of the samples, [s] from `stamp`; rising from 0"""
    q: Rows
    """positions at the samples, [rad] or [m]: one row a time, one value a name"""
    v: Rows
    """velocities at the samples, [rad/s] or [m/s]; the curve between samples is cubic"""
    tracking_error: Values
    """how far joints may be off the curve, [rad] or [m], above 0"""
    velocity_tracking_error: Values | None = None
    """how far velocities may be off the curve's, [rad/s] or [m/s]; left out: what follows from the
    tracking error and the limits on acceleration"""
    arm: str = ""
    """whose plan it is, by its name in a cell with several arms; left out where there is one"""
    until: float | None = None
    """of a promise: how long the arm keeps to the plan, [s] on the clock of the joint states"""


class RemoveMessage(Message, tag="remove"):
    """Obstacles that left the cell, said by the source that saw them go."""

    ids: list[str]
    """names of the obstacles"""
    stamp: float
    """when they had gone, [s] on the clock of the source; states from before do not revive them"""
    source: str = "default"
    """name of the sender, whose obstacles these are"""
    seq: int | None = None
    """counts the messages of the source, `obstacles` among them"""


class IgnoreMessage(Message, tag="ignore"):
    """Asks that contact be wanted for the time being; only with the token of the run."""

    number: Number
    """of the exemption, by which `watch` ends it, from whatever sender: numbers are one space for
    all; use none that has not ended"""
    token: str
    """what `armguard run --reset-token` was given"""
    link: str
    """name of a link of the arm; `*` is any"""
    ids: str
    """pattern of obstacle ids; one that fits no obstacle yet is a STOP, unless `source` is there"""
    source: str | None = None
    """whose obstacles alone are meant, and may come later"""
    until: float | None = None
    """contact is not wanted from then on, [s] on the clock of the joint states; left out: the zone
    decides"""
    zone: Rows | None = None
    """corners of a convex region of the world in which contact is wanted, x, y, z in [m], 4 to 8 of
    them; left out: anywhere"""
    arm: str = ""
    """whose link it is, by its name in a cell with several arms; left out where there is one"""


class WatchMessage(Message, tag="watch"):
    """Ends what an `ignore` began."""

    number: Number
    """of the exemption, whoever sent its `ignore`"""
    arm: str = ""
    """whose exemption it is, by its name in a cell with several arms; left out where there is
    one"""


class ResetMessage(Message, tag="reset"):
    """Asks to release a latched STOP; only with the token that the run was started with."""

    token: str
    """what `armguard run --reset-token` was given"""
    arm: str = ""
    """whose monitor is meant, by the arm's name in a cell with several; left out where there is
    one"""
    number: Number | None = None
    """of the reset; the answer carries it, and all readers see all answers; left out: no answer is
    wanted"""


class Header(msgspec.Struct):
    """What is read of a message before the rest: little work, however long the message is."""

    type: str = ""
    source: str = "default"
    seq: int | None = None


AnyMessage = (
    ObstaclesMessage
    | CloudMessage
    | JointsMessage
    | PlanMessage
    | RemoveMessage
    | IgnoreMessage
    | WatchMessage
    | ResetMessage
)


class ReasonMessage(msgspec.Struct):
    """One reason of a verdict, or of the answer to a plan."""

    kind: str
    """lower-case name of a `ReasonKind`"""
    subject: str
    """what it is about: a joint, an obstacle, a source"""
    detail: str
    """what was found, and what was expected"""


class CertificateMessage(msgspec.Struct):
    """A `Certificate`, its arrays as lists."""

    contact_time: Figure
    """no contact before this time, [s] from the tick"""
    times: list[Figure]
    """at which the separating directions follow each other, [s] from the tick"""
    witnesses: list[tuple[Figure, Figure, Figure]]
    """the separating directions, unit vectors from the arm to the obstacle, one a time"""


class HeldMessage(msgspec.Struct):
    """Why a level is held, though its tick alone would earn a higher one."""

    reason: ReasonMessage | None
    """the weightiest reason of the tick that began it; nil: a reset began it"""
    contact_time: Figure
    """of that tick, [s]"""
    stop_time: Figure
    """of that tick, [s]"""
    since: Figure
    """when that was, [s] of the machine's monotonic clock"""
    rises_at: Figure
    """the earliest time at which the level may rise, [s] of the machine's monotonic clock"""


class VerdictMessage(msgspec.Struct, tag_field="type", tag="verdict"):
    """A `Verdict` on the wire: times on the machine's monotonic clock, the level by name."""

    stamp: Figure
    """of the joint state that was judged, [s] of the machine's monotonic clock"""
    sequence: int
    """number of the tick, from 1; 0 while no joint state could be judged, and at the end"""
    level: str
    """`STOP`, `SLOW`, `AWARE` or `CLEAR`"""
    contact_time: Figure
    """earliest possible contact, [s] from the tick; infinite where there is none, 0 where that is
    unknown"""
    stop_time: Figure
    """within which the arm surely rests if it is told to stop now, [s] from the tick; infinite
    where that is unknown"""
    speed_scale: Figure
    """how fast the arm may go on, from 0 to 1, as a share of the joints' operating velocities, or
    of their velocity limits where none are stated"""
    link: str | None
    """link of the deciding pair; nil without pairs, or where not all that is there is known"""
    obstacle: str | None
    """obstacle of the deciding pair; nil where `link` is"""
    complete: bool
    """whether a certificate in force, or the stop decision, stands behind every pair"""
    evaluated: int
    """contact times that were computed in the tick, sphere against obstacle"""
    reasons: list[ReasonMessage]
    """what the verdict rests on, the weightiest first"""
    valid_until: Figure
    """silence beyond this means: brake; [s] of the machine's monotonic clock"""
    separation: float | None = None
    """margin of the separation distance, [m], where the cell file asks for it and it is known"""
    certificate: CertificateMessage | None = None
    """proof of the deciding pair; `armguard run` sends none"""
    stop: Literal["finish", "brake"] | None = None
    """how to obey a STOP: run the committed piece to rest, or leave it and brake; nil where the
    level is another"""
    held: HeldMessage | None = None
    """why the level is held, though this tick alone would earn a higher one; nil: it is not"""


class PlanVerdictMessage(msgspec.Struct, tag_field="type", tag="plan_verdict"):
    """A `PlanVerdict` on the wire, with the number of the plan that it answers."""

    number: int
    """of the plan that is answered"""
    safe: bool
    """whether the arm may do it: then that is what the monitor takes it to do from now on"""
    contact_time: Figure
    """earliest possible contact on the way, [s] from the tick; infinite where there is none, 0
    where that is unknown"""
    link: str | None
    """link of the pair that could touch first; nil if none can"""
    obstacle: str | None
    """obstacle of that pair; nil if none can"""
    reasons: list[ReasonMessage]
    """why not"""


class ResetVerdictMessage(msgspec.Struct, tag_field="type", tag="reset_verdict"):
    """A `ResetVerdict` on the wire, with the number of the reset that it answers."""

    number: int
    """of the reset that is answered"""
    obeyed: bool
    """whether nothing that was latched before is latched any more; a cause that persists latches
    again at once"""
    problem: str
    """why not; empty where it was obeyed"""


_KIND_NAMES = {kind: kind.name.lower() for kind in ReasonKind}
_LEVEL_NAMES = tuple(level.name for level in sorted(Level))
"""Looked up here, a name of a member costs a third of what it costs there."""

PACKED = np.dtype("<f8")
"""Of packed numbers."""

_AnyAnswer = VerdictMessage | PlanVerdictMessage | ResetVerdictMessage
_encoder = msgspec.msgpack.Encoder()
_json_encoder = msgspec.json.Encoder()
_json_decoder: msgspec.json.Decoder[AnyMessage] = msgspec.json.Decoder(AnyMessage)
_msgpack_decoder: msgspec.msgpack.Decoder[AnyMessage] = msgspec.msgpack.Decoder(AnyMessage)
_json_header_decoder: msgspec.json.Decoder[Header] = msgspec.json.Decoder(Header)
_msgpack_header_decoder: msgspec.msgpack.Decoder[Header] = msgspec.msgpack.Decoder(Header)
_answer_decoder: msgspec.msgpack.Decoder[_AnyAnswer] = msgspec.msgpack.Decoder(_AnyAnswer)
_json_answer_decoder: msgspec.json.Decoder[_AnyAnswer] = msgspec.json.Decoder(_AnyAnswer)


def encode(message: AnyMessage) -> bytes:
    """One message as a msgpack map."""
    return _encoder.encode(message)


def decode(data: bytes) -> AnyMessage:
    """One message from msgpack or JSON.

    Raises:
        MessageError: If it is malformed, truncated, of unknown type, or has a field too many,
            too few or of the wrong type.
    """
    is_json = _is_json(data)
    try:
        return _json_decoder.decode(data) if is_json else _msgpack_decoder.decode(data)
    except msgspec.ValidationError as error:
        raise _name_mistake(data, is_json, str(error)) from None
    except (ValueError, RecursionError, MemoryError) as error:
        beginning = bytes(data[:40])
        raise MessageError(
            "message", f"{beginning!r}… ({error})", "a msgpack map or a JSON object"
        ) from None


def read_header(data: bytes) -> Header | None:
    """What a message says of itself; None if it is malformed, which `decode` tells in words.

    Of a message that `decode` takes, type, source and number are those that it finds.
    """
    decoder = _json_header_decoder if _is_json(data) else _msgpack_header_decoder
    try:
        return decoder.decode(data)
    except (ValueError, RecursionError, MemoryError):
        return None


def _is_json(data: bytes) -> bool:
    return data[:1] in (b"{", b" ", b"\t", b"\r", b"\n")


def _name_mistake(data: bytes, is_json: bool, problem: str) -> MessageError:
    """What a message of good form but wrong content says about itself."""
    problem, _, place = problem.replace("`", "").partition(" - at $")
    expected, _, found = problem.removeprefix("Expected ").partition(", got ")
    field = place.strip(".")
    source, sequence = "unknown", None
    if len(data) <= _CLOSER_LOOK:
        try:
            value: Any = msgspec.json.decode(data) if is_json else msgspec.msgpack.decode(data)
            source = str(value.get("source", value["type"]))
            sequence = value["seq"] if isinstance(value.get("seq"), int) else None
            for name, index in re.findall(r"\.(\w+)|\[(\d+)\]", place):
                value = value[name] if name else value[int(index)]
            found = repr(value) if place else found
        except (ValueError, TypeError, AttributeError, LookupError, RecursionError):
            pass  # then less is said about it
    mistake = re.fullmatch(r"Object (missing required|contains unknown) field (.*)", problem)
    if mistake is not None:
        missing = mistake[1] == "missing required"
        field = f"{field}.{mistake[2]}".strip(".")
        found, expected = ("missing", "a value") if missing else ("there", "no such field")
    elif not found:
        found, expected = problem, "another value"
    expected = _REMOVED.get(field, expected)
    return MessageError(field or "message", found, expected, source, sequence)


_COMMIT = 'pieces of trajectory that carry their own stop, in plans that ask "commit"'
_REMOVED = {
    "ask": f'"commit" or "share"; instead of "follow": {_COMMIT}',
    "path_time": f"no such field; instead: {_COMMIT}",
    "stop_tracking_error": f"no such field; instead: {_COMMIT}",
}
"""What is expected where messages of earlier versions have something else."""


def to_values(field: str, values: bytes | list[float], count: int) -> NDArray[np.float64]:
    """One number a row as an array, of shape (count,).

    Raises:
        MessageError: If there are more or fewer than `count`.
    """
    if isinstance(values, bytes):
        if len(values) != 8 * count:
            raise MessageError(field, f"{len(values)} bytes", f"{count} packed float64")
        return np.frombuffer(values, PACKED)
    if len(values) != count:
        raise MessageError(field, f"{len(values)} values", f"{count}, one for each name or id")
    return np.array(values, float)


def to_points(field: str, points: Points, count: int) -> NDArray[np.float64]:
    """Points as an array, of shape (count, 3) or (count, k, 3), k at most 8.

    Raises:
        MessageError: If the number of rows, points or coordinates is not that.
    """
    if isinstance(points, bytes):
        per_row, rest = divmod(len(points), 24 * count) if count else (0, len(points))
        if rest or not (count == 0 or 1 <= per_row <= POINT_LIMIT):
            expected = f"packed float64: {_expected_points(count)}"
            raise MessageError(field, f"{len(points)} bytes", expected)
        shape = (count, 3) if per_row <= 1 else (count, per_row, 3)
        return np.frombuffer(points, PACKED).reshape(shape)
    try:
        array = np.array(points, float)
    except ValueError:
        raise MessageError(field, "rows of unequal length", _expected_points(count)) from None
    if len(points) != count:
        raise MessageError(field, f"{len(points)} rows", _expected_points(count))
    if count == 0:
        return np.zeros((0, 3))
    if not (
        (array.ndim == 2 or (array.ndim == 3 and 1 <= array.shape[1] <= POINT_LIMIT))
        and array.shape[-1] == 3
    ):
        raise MessageError(field, f"an array of shape {array.shape}", _expected_points(count))
    return array


def _expected_points(count: int) -> str:
    return (
        f"{count} rows of 3 coordinates, or of 1 to {POINT_LIMIT} such points, as many in each row"
    )


def count_points(points: Cloud) -> int:
    """How many points a cloud has, whatever else is wrong with it."""
    return len(points) // 24 if isinstance(points, bytes) else len(points)


def to_cloud(field: str, points: Cloud) -> NDArray[np.float64]:
    """Points as an array, of shape (n, 3).

    Raises:
        MessageError: They are no rows of three coordinates.
    """
    expected = "rows of 3 coordinates"
    if isinstance(points, bytes):
        if len(points) % 24:
            raise MessageError(field, f"{len(points)} bytes", f"packed float64: {expected}")
        return np.frombuffer(points, PACKED).reshape(-1, 3)
    if any(len(point) != 3 for point in points):
        raise MessageError(field, "with a point of other than 3 coordinates", expected)
    return np.array(points, float).reshape(-1, 3)


def to_mask(field: str, values: bytes | list[bool], count: int) -> NDArray[np.bool_]:
    """One truth a point as an array, of shape (count,).

    Raises:
        MessageError: If there are more or fewer than `count`, or others than 0 and 1.
    """
    if len(values) != count:
        raise MessageError(field, f"{len(values)} values", f"{count}, one for each point")
    if not isinstance(values, bytes):
        return np.array(values, np.bool_).reshape(count)
    mask = np.frombuffer(values, np.uint8)
    if count and mask.max() > 1:
        raise MessageError(field, f"with a byte of {mask.max()}", "0 or 1 for each point")
    return mask.astype(np.bool_)


def to_rows(field: str, rows: Rows, count: int, width: int) -> NDArray[np.float64]:
    """One row a sample as an array, of shape (count, width).

    Raises:
        MessageError: If the number of rows, or of values in one of them, is not that.
    """
    expected = f"{count} rows of {width} values, one for each time and name"
    if isinstance(rows, bytes):
        if len(rows) != 8 * count * width:
            raise MessageError(field, f"{len(rows)} bytes", f"packed float64: {expected}")
        return np.frombuffer(rows, PACKED).reshape(count, width)
    if len(rows) != count or any(len(row) != width for row in rows):
        raise MessageError(field, f"{len(rows)} rows", expected)
    return np.array(rows, float).reshape(count, width)


def encode_verdict(verdict: Verdict, offset: float, *, as_json: bool = False) -> bytes:
    """A verdict as a msgpack map, or as a JSON object.

    Args:
        verdict: In the monitor's own time.
        offset: Machine's monotonic clock minus the monitor's, in [s].
        as_json: Whether it is JSON.
    """
    tell = _to_json_number if as_json else float
    certificate = None
    if verdict.certificate is not None:
        contact_time, times, witnesses = verdict.certificate
        instants: list[Figure] = [tell(time) for time in times.tolist()]
        certificate = CertificateMessage(tell(contact_time), instants, witnesses.tolist())
    held = None
    if verdict.held is not None:
        cause, contact_time, stop_time, since, rises_at = verdict.held
        held = HeldMessage(
            None if cause is None else _tell_reasons((cause,))[0],
            tell(contact_time),
            tell(stop_time),
            tell(since + offset),
            tell(rises_at + offset),
        )
    separation = verdict.separation
    message = VerdictMessage(
        tell(verdict.stamp + offset),
        verdict.sequence,
        _LEVEL_NAMES[verdict.level],
        tell(verdict.contact_time),
        tell(verdict.stop_time),
        tell(verdict.speed_scale),
        verdict.link,
        verdict.obstacle,
        bool(verdict.complete),
        int(verdict.evaluated),
        _tell_reasons(verdict.reasons),
        tell(math.nextafter(verdict.valid_until + offset, -math.inf)),  # never too long
        None if separation is None else tell(separation),
        certificate,
        verdict.stop,
        held,
    )
    return _json_encoder.encode(message) if as_json else _encoder.encode(message)


def encode_plan_verdict(number: int, verdict: PlanVerdict, *, as_json: bool = False) -> bytes:
    """The answer to a plan as a msgpack map, or as a JSON object.

    Args:
        number: Of the plan, as its sender counts.
        verdict: The answer; its contact time is counted from when it was judged.
        as_json: Whether it is JSON.
    """
    safe, contact_time, link, obstacle, reasons = verdict
    tell = _to_json_number if as_json else float
    message = PlanVerdictMessage(
        number, safe, tell(contact_time), link, obstacle, _tell_reasons(reasons)
    )
    return _json_encoder.encode(message) if as_json else _encoder.encode(message)


def encode_reset_verdict(number: int, verdict: ResetVerdict, *, as_json: bool = False) -> bytes:
    """The answer to a reset as a msgpack map, or as a JSON object.

    Args:
        number: Of the reset, as its sender counts.
        verdict: The answer.
        as_json: Whether it is JSON.
    """
    message = ResetVerdictMessage(number, *verdict)
    return _json_encoder.encode(message) if as_json else _encoder.encode(message)


def decode_answer(data: bytes) -> Verdict | tuple[int, PlanVerdict | ResetVerdict]:
    """What a monitor publishes: a verdict, or the number of a plan or reset and the answer to it.

    Both encodings are read. Times of a verdict are on the machine's monotonic clock. A verdict is
    read whatever its numbers are, since it may be a STOP; those that are none are NaN.

    Raises:
        MessageError: If it is neither.
    """
    is_json = _is_json(data)
    try:
        message = (_json_answer_decoder if is_json else _answer_decoder).decode(data)
        if isinstance(message, PlanVerdictMessage):
            return message.number, PlanVerdict(
                message.safe,
                _read_number(message.contact_time, is_json),
                message.link,
                message.obstacle,
                _read_reasons(message.reasons),
            )
        if isinstance(message, ResetVerdictMessage):
            return message.number, ResetVerdict(message.obeyed, message.problem)
        fields = {name: getattr(message, name) for name in message.__struct_fields__}
        fields["level"] = Level[message.level]
        fields["reasons"] = _read_reasons(message.reasons)
        for name in ("stamp", "contact_time", "stop_time", "speed_scale", "valid_until"):
            fields[name] = _read_number(fields[name], is_json)
        if message.separation is not None:
            fields["separation"] = _read_number(message.separation, is_json)
        proof = message.certificate
        if proof is not None:
            contact_time = _read_number(proof.contact_time, is_json)
            times = np.array([_read_number(time, is_json) for time in proof.times])
            witnesses = np.array(proof.witnesses, float).reshape(-1, 3)
            fields["certificate"] = Certificate(contact_time, times, witnesses)
        held = message.held
        if held is not None:
            names = ("contact_time", "stop_time", "since", "rises_at")
            read = (_read_number(getattr(held, name), is_json) for name in names)
            cause = None if held.reason is None else _read_reasons([held.reason])[0]
            fields["held"] = Held(cause, *read)
        return Verdict(**fields)
    except (ValueError, KeyError, RecursionError) as error:
        raise MessageError("verdict", f"unusable ({error})", "a verdict of this version") from None


def _to_json_number(value: float) -> float:
    """A number for JSON, which has no infinite ones: the greatest that there is stands for those.

    Readers can compare it as it is. What is no number becomes null.
    """
    return math.copysign(GREATEST, value) if math.isinf(value) else float(value)


def _read_number(value: Figure, is_json: bool) -> float:
    if value is None:
        return math.nan
    return math.copysign(math.inf, value) if is_json and abs(value) >= GREATEST else value


def _tell_reasons(reasons: Iterable[Reason]) -> list[ReasonMessage]:
    return [ReasonMessage(_KIND_NAMES[kind], subject, detail) for kind, subject, detail in reasons]


def _read_reasons(reasons: Iterable[ReasonMessage]) -> tuple[Reason, ...]:
    return tuple(Reason(ReasonKind[one.kind.upper()], one.subject, one.detail) for one in reasons)
