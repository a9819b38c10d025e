"""What goes over the wire: one schema for every message, in msgpack or JSON.

The two encodings carry the same fields and are told apart by their first byte: no msgpack map
begins with a brace or white space. msgspec holds types and names; what a type cannot say (lengths,
packed arrays, finiteness) is checked by `to_points` and `to_values`, once, at the edge.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from armguard.contact.earliest import Certificate
from armguard.verdict import Level, PlanVerdict, Reason, ReasonKind, Verdict

_CLOSER_LOOK = 65536
"""Longest message, in bytes, that is read a second time to say what was wrong with it."""

POINT_LIMIT = 8
"""Most points of one obstacle."""

Points = bytes | list[list[float | list[float]]]
"""Rows of points: (n, 3) or (n, k, 3) nested lists, or packed little-endian float64."""

Rows = bytes | list[list[float]]
"""One row a sample: (k, n) nested lists, or packed little-endian float64."""

Number = Annotated[int, msgspec.Meta(ge=0, le=2**63 - 1)]
"""What a sender counts its plans by; answers carry it in msgpack, which has none beyond."""

Values = float | bytes | list[float]
"""One value for all, or one a row: a list, or packed little-endian float64."""


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
    """What every message is: a map whose `type` names one of the children below."""


class ObstaclesMessage(Message, tag="obstacles"):
    """States of obstacles as one source saw them at one time; without ids, a heartbeat."""

    ids: list[str]
    stamp: float
    source: str = "default"
    seq: int | None = None
    frame: str = "world"
    snapshot: bool = False
    position: Points = []
    velocity: Points | None = None
    radius: Values | None = None
    accel: Values | None = None
    speed: Values | None = None
    position_error: Values = 0.0
    velocity_error: Values = 0.0


class JointsMessage(Message, tag="joints"):
    """The arm's joint state; any order of names, more of them than needed is no fault."""

    stamp: float
    names: list[str]
    q: bytes | list[float]
    v: bytes | list[float]
    seq: int | None = None
    path_time: float | None = None


class PlanMessage(Message, tag="plan"):
    """What the controller is about to do, and what it asks: may the arm?

    `ask` is "commit" for a piece that carries its own stop, "follow" for a whole trajectory.
    """

    ask: Literal["commit", "follow"]
    number: Number
    stamp: float
    names: list[str]
    times: bytes | list[float]
    q: Rows
    v: Rows
    tracking_error: Values
    velocity_tracking_error: Values | None = None
    stop_tracking_error: Values | None = None


class RemoveMessage(Message, tag="remove"):
    """Obstacles that left the cell, said by the source that saw them go."""

    ids: list[str]
    stamp: float
    source: str = "default"
    seq: int | None = None


class ResetMessage(Message, tag="reset"):
    """Asks to release a latched STOP; only with the token that the run was started with."""

    token: str


class Header(msgspec.Struct):
    """What is read of a message before the rest: little work, however long the message is."""

    type: str = ""
    source: str = "default"
    seq: int | None = None


AnyMessage = ObstaclesMessage | JointsMessage | PlanMessage | RemoveMessage | ResetMessage


class ReasonMessage(msgspec.Struct):
    """One reason of a verdict; `kind` is the lower-case name of a `ReasonKind`."""

    kind: str
    subject: str
    detail: str


class CertificateMessage(msgspec.Struct):
    """A `Certificate`, its arrays as lists."""

    contact_time: float
    times: list[float]
    witnesses: list[tuple[float, float, float]]


class VerdictMessage(msgspec.Struct, tag_field="type", tag="verdict"):
    """A `Verdict` on the wire: times on the machine's monotonic clock, the level by name."""

    stamp: float
    sequence: int
    level: str
    contact_time: float
    stop_time: float
    speed_scale: float
    link: str | None
    obstacle: str | None
    complete: bool
    evaluated: int
    reasons: list[ReasonMessage]
    valid_until: float
    separation: float | None = None
    certificate: CertificateMessage | None = None
    stop: Literal["finish", "brake"] | None = None


class PlanVerdictMessage(msgspec.Struct, tag_field="type", tag="plan_verdict"):
    """A `PlanVerdict` on the wire, with the number of the plan that it answers."""

    number: int
    safe: bool
    contact_time: float
    link: str | None
    obstacle: str | None
    reasons: list[ReasonMessage]


_encoder = msgspec.msgpack.Encoder()
_json_decoder: msgspec.json.Decoder[AnyMessage] = msgspec.json.Decoder(AnyMessage)
_msgpack_decoder: msgspec.msgpack.Decoder[AnyMessage] = msgspec.msgpack.Decoder(AnyMessage)
_json_header_decoder: msgspec.json.Decoder[Header] = msgspec.json.Decoder(Header)
_msgpack_header_decoder: msgspec.msgpack.Decoder[Header] = msgspec.msgpack.Decoder(Header)
_answer_decoder: msgspec.msgpack.Decoder[VerdictMessage | PlanVerdictMessage] = (
    msgspec.msgpack.Decoder(VerdictMessage | PlanVerdictMessage)
)


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
    return MessageError(field or "message", found, expected, source, sequence)


def to_values(field: str, values: bytes | list[float], count: int) -> NDArray[np.float64]:
    """One number a row as an array, of shape (count,).

    Raises:
        MessageError: If there are more or fewer than `count`.
    """
    if isinstance(values, bytes):
        if len(values) != 8 * count:
            raise MessageError(field, f"{len(values)} bytes", f"{count} packed float64")
        return np.frombuffer(values, "<f8")
    if len(values) != count:
        raise MessageError(field, f"{len(values)} values", f"{count}, one for each name or id")
    return np.array(values, float)


def to_points(field: str, points: Points, count: int) -> NDArray[np.float64]:
    """Points as an array, of shape (count, 3) or (count, k, 3), k at most 8.

    Raises:
        MessageError: If the number of rows, points or coordinates is not that.
    """
    expected = (
        f"{count} rows of 3 coordinates, or of 1 to {POINT_LIMIT} such points, as many in each row"
    )
    if isinstance(points, bytes):
        per_row, rest = divmod(len(points), 24 * count) if count else (0, len(points))
        if rest or not (count == 0 or 1 <= per_row <= POINT_LIMIT):
            raise MessageError(field, f"{len(points)} bytes", f"packed float64: {expected}")
        shape = (count, 3) if per_row <= 1 else (count, per_row, 3)
        return np.frombuffer(points, "<f8").reshape(shape)
    try:
        array = np.array(points, float)
    except ValueError:
        raise MessageError(field, "rows of unequal length", expected) from None
    if len(points) != count:
        raise MessageError(field, f"{len(points)} rows", expected)
    if count == 0:
        return np.zeros((0, 3))
    if not (
        (array.ndim == 2 or (array.ndim == 3 and 1 <= array.shape[1] <= POINT_LIMIT))
        and array.shape[-1] == 3
    ):
        raise MessageError(field, f"an array of shape {array.shape}", expected)
    return array


def to_rows(field: str, rows: Rows, count: int, width: int) -> NDArray[np.float64]:
    """One row a sample as an array, of shape (count, width).

    Raises:
        MessageError: If the number of rows, or of values in one of them, is not that.
    """
    expected = f"{count} rows of {width} values, one for each time and name"
    if isinstance(rows, bytes):
        if len(rows) != 8 * count * width:
            raise MessageError(field, f"{len(rows)} bytes", f"packed float64: {expected}")
        return np.frombuffer(rows, "<f8").reshape(count, width)
    if len(rows) != count or any(len(row) != width for row in rows):
        raise MessageError(field, f"{len(rows)} rows", expected)
    return np.array(rows, float).reshape(count, width)


def encode_verdict(verdict: Verdict, offset: float) -> bytes:
    """A verdict as a msgpack map.

    Args:
        verdict: In the monitor's own time.
        offset: Machine's monotonic clock minus the monitor's, in [s].
    """
    certificate = None
    if verdict.certificate is not None:
        contact_time, times, witnesses = verdict.certificate
        certificate = CertificateMessage(contact_time, times.tolist(), witnesses.tolist())
    return _encoder.encode(
        VerdictMessage(
            float(verdict.stamp) + offset,
            verdict.sequence,
            verdict.level.name,
            float(verdict.contact_time),
            float(verdict.stop_time),
            float(verdict.speed_scale),
            verdict.link,
            verdict.obstacle,
            bool(verdict.complete),
            int(verdict.evaluated),
            _tell_reasons(verdict.reasons),
            math.nextafter(verdict.valid_until + offset, -math.inf),  # never too long
            verdict.separation,
            certificate,
            verdict.stop,
        )
    )


def encode_plan_verdict(number: int, verdict: PlanVerdict) -> bytes:
    """The answer to a plan as a msgpack map.

    Args:
        number: Of the plan, as its sender counts.
        verdict: The answer; its contact time is counted from when it was judged.
    """
    safe, contact_time, link, obstacle, reasons = verdict
    return _encoder.encode(
        PlanVerdictMessage(
            number, safe, float(contact_time), link, obstacle, _tell_reasons(reasons)
        )
    )


def decode_answer(data: bytes) -> Verdict | tuple[int, PlanVerdict]:
    """What a monitor publishes: a verdict, or the number of a plan and the answer to it.

    Times of a verdict are on the machine's monotonic clock.

    Raises:
        MessageError: If it is neither.
    """
    try:
        message = _answer_decoder.decode(data)
        if isinstance(message, PlanVerdictMessage):
            return message.number, PlanVerdict(
                message.safe,
                message.contact_time,
                message.link,
                message.obstacle,
                _read_reasons(message.reasons),
            )
        fields = {name: getattr(message, name) for name in message.__struct_fields__}
        fields["level"] = Level[message.level]
        fields["reasons"] = _read_reasons(message.reasons)
        proof = message.certificate
        if proof is not None:
            times, witnesses = np.array(proof.times), np.array(proof.witnesses).reshape(-1, 3)
            fields["certificate"] = Certificate(proof.contact_time, times, witnesses)
        return Verdict(**fields)
    except (ValueError, KeyError, RecursionError) as error:
        raise MessageError("verdict", f"unusable ({error})", "a verdict of this version") from None


def _tell_reasons(reasons: Iterable[Reason]) -> list[ReasonMessage]:
    return [ReasonMessage(one.kind.name.lower(), one.subject, one.detail) for one in reasons]


def _read_reasons(reasons: Iterable[ReasonMessage]) -> tuple[Reason, ...]:
    return tuple(Reason(ReasonKind[one.kind.upper()], one.subject, one.detail) for one in reasons)
