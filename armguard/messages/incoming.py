"""What a monitor is sent: one schema for every message, in msgpack or JSON.

The two encodings carry the same fields and are told apart by their first byte: no msgpack map
begins with a brace or white space. msgspec holds types and names; what a type cannot say (lengths,
packed arrays, finiteness) is checked by `to_points` and `to_values`, once, at the edge.
"""

from __future__ import annotations

import math
import re
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

_CLOSER_LOOK = 65536
"""Longest message, in bytes, that is read a second time to say what was wrong with it."""

POINT_LIMIT = 8
"""Most points of one obstacle."""

Points = bytes | list[list[float | list[float]]]
"""Rows of points: (n, 3) or (n, k, 3) nested lists, or packed little-endian float64."""

Rows = bytes | list[list[float]]
"""One row a sample or a point: (k, n) nested lists, or packed little-endian float64."""

Cloud = Rows
"""Points of a cloud, (n, 3)."""

Number = Annotated[int, msgspec.Meta(ge=0, le=2**63 - 1)]
"""What a sender counts its plans by; answers carry it in msgpack, which has none beyond."""

Values = float | bytes | list[float]
"""One value for all, or one a row: a list, or packed little-endian float64."""


class MessageError(Exception):
    """A message that cannot be used: where, what was found, what was expected, and from whom."""

    kind = "malformed"
    """What it is counted as."""
    hides_obstacles = False
    """Whether it would have told of obstacles, so that the verdict must know of it."""

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
    """names of n obstacles"""
    stamp: float
    """time of measurement, [s]"""
    source: str = "default"
    """name of the source; each has one sender"""
    seq: int | None = None
    """number of the message, rising by 1"""
    frame: str = "world"
    """`world`, `base`, or one of `[frames]`"""
    snapshot: bool = False
    """the source sees the whole cell: its other obstacles have left"""
    position: Points = []
    """centres, or hulls of up to 8 points each, [m]"""
    velocity: Points | None = None
    """velocities, [m/s]; left out: any within the bounds"""
    radius: Values | None = None
    """radius around the points, [m]; needed with ids"""
    accel: Values | None = None
    """acceleration bound, [m/s²]; left out: the cell's"""
    speed: Values | None = None
    """speed bound, [m/s]; left out: the cell's"""
    position_error: Values = 0.0
    """greatest error of positions, [m]"""
    velocity_error: Values = 0.0
    """greatest error of velocities, [m/s]"""
    region: str | list[str] | None = None
    """[body region](contact_limits.md), `""`: none; left out: by id patterns"""


class CloudMessage(Message, tag="cloud"):
    """Points that one source measured at one time, as a depth camera does; without, a heartbeat."""

    stamp: float
    """time of measurement, [s]"""
    origin: tuple[float, float, float]
    """centre of the camera, where rays start, [m]"""
    points: Cloud = []
    """ends of rays, [m]"""
    source: str = "default"
    """name of the source; each has one sender"""
    seq: int | None = None
    """number of the message, rising by 1"""
    frame: str = "world"
    """`world`, `base`, or one of `[frames]`"""
    voxel: float = 0.05
    """edge length of the voxels, [m]"""
    occupied: bytes | list[bool] | None = None
    """whether each point is of an obstacle; left out: all but the arm's are"""
    position_error: float = 0.0
    """greatest error of points, half the distance of rays included, [m]"""
    accel: float | None = None
    """acceleration bound, [m/s²]; left out: the cell's for `voxel`"""
    speed: float | None = None
    """speed bound, [m/s]; left out: the cell's for `voxel`"""
    snapshot: bool = False
    """the source sees the whole cell: its other obstacles have left"""


class JointsMessage(Message, tag="joints"):
    """The arm's joint state; any order of names, more of them than needed is no fault."""

    stamp: float
    """time of measurement, [s]"""
    names: list[str]
    """names of joints, all watched ones included"""
    q: bytes | list[float]
    """positions, [rad] or [m]"""
    v: bytes | list[float]
    """velocities, [rad/s] or [m/s]"""
    seq: int | None = None
    """number of the message, rising by 1"""
    arm: str = ""
    """name of the arm"""


class PlanMessage(Message, tag="plan"):
    """What the controller is about to do, and what it asks: may the arm?"""

    ask: Literal["commit", "share"]
    """what the plan is for"""
    number: Number
    """unique among all senders"""
    stamp: float
    """time of the first sample, [s]"""
    names: list[str]
    """joints"""
    times: bytes | list[float]
    """sample times after `stamp`, [s], rising from 0"""
    q: Rows
    """positions, a row per time, [rad] or [m]"""
    v: Rows
    """velocities, [rad/s] or [m/s]; motion is cubic between samples"""
    tracking_error: Values
    """greatest distance of the arm from the curve, [rad] or [m], above 0"""
    velocity_tracking_error: Values | None = None
    """greatest velocity error, [rad/s] or [m/s]"""
    arm: str = ""
    """name of the arm"""
    until: float | None = None
    """time at which a promise ends, [s]"""


class GoalPath(msgspec.Struct, forbid_unknown_fields=True):
    """A path that a goal offers, from rest to rest."""

    q: Rows
    """waypoints of a smooth curve, or samples, [rad] or [m]"""
    times: bytes | list[float] | None = None
    """rising sample times, [s]; left out: as fast as possible"""


class GoalMessage(Message, tag="goal"):
    """What a shield is to do from now on, in place of what it was asked before."""

    number: Number
    """unique among all senders"""
    until: float
    """time until which the goal can be accepted, and a velocity counts, [s]"""
    names: list[str]
    """joints"""
    paths: list[GoalPath] | None = None
    """paths to choose from, by progress that can be proved"""
    velocity: bytes | list[float] | None = None
    """velocities to keep, [rad/s] or [m/s]"""
    chunk: Rows | None = None
    """next positions of a policy, [rad] or [m]"""
    arm: str = ""
    """name of the arm"""


class RemoveMessage(Message, tag="remove"):
    """Obstacles that left the cell, said by the source that saw them go."""

    ids: list[str]
    """names of obstacles"""
    stamp: float
    """time of leaving, [s]"""
    source: str = "default"
    """name of the source; each has one sender"""
    seq: int | None = None
    """number of the message, rising by 1"""


class IgnoreMessage(Message, tag="ignore"):
    """Asks that contact be wanted for the time being; only with the token of the run."""

    number: Number
    """unique among all senders"""
    token: str
    """token of `armguard run --reset-token`"""
    link: str
    """link, or `*`"""
    ids: str
    """pattern of obstacle ids; without `source`, no match is a STOP"""
    source: str | None = None
    """source of the ids, which can appear later"""
    until: float | None = None
    """time at which the exemption ends, [s]"""
    zone: Rows | None = None
    """4 to 8 corners of a convex zone, [m]"""
    arm: str = ""
    """name of the arm"""


class WatchMessage(Message, tag="watch"):
    """Ends what an `ignore` began."""

    number: Number
    """number of the exemption that ends"""
    arm: str = ""
    """name of the arm"""


class ResetMessage(Message, tag="reset"):
    """Asks to release a latched STOP; only with the token that the run was started with."""

    token: str
    """token of `armguard run --reset-token`"""
    arm: str = ""
    """name of the arm"""
    number: Number | None = None
    """unique among all senders; left out: no answer"""


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
    | GoalMessage
    | RemoveMessage
    | IgnoreMessage
    | WatchMessage
    | ResetMessage
)


PACKED = np.dtype("<f8")
"""Of packed numbers."""

_JSON_BEGINS = frozenset((b"{", b" ", b"\t", b"\r", b"\n"))
_encoder = msgspec.msgpack.Encoder()
_json_decoder: msgspec.json.Decoder[AnyMessage] = msgspec.json.Decoder(AnyMessage)
_msgpack_decoder: msgspec.msgpack.Decoder[AnyMessage] = msgspec.msgpack.Decoder(AnyMessage)
_json_header_decoder: msgspec.json.Decoder[Header] = msgspec.json.Decoder(Header)
_msgpack_header_decoder: msgspec.msgpack.Decoder[Header] = msgspec.msgpack.Decoder(Header)


def encode(message: AnyMessage) -> bytes:
    """One message as a msgpack map."""
    return _encoder.encode(message)


def to_plain(value: object) -> object:
    """Numbers of NumPy as Python's, for encoders.

    Raises:
        TypeError: It is something else.
    """
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{value!r} cannot be encoded")


def decode(data: bytes) -> AnyMessage:
    """One message from msgpack or JSON.

    Raises:
        MessageError: If it is malformed, truncated, of unknown type, or has a field too many,
            too few or of the wrong type.
    """
    as_json = data[:1] in _JSON_BEGINS
    try:
        return _json_decoder.decode(data) if as_json else _msgpack_decoder.decode(data)
    except msgspec.ValidationError as error:
        raise _name_mistake(data, as_json, str(error)) from None
    except (ValueError, RecursionError, MemoryError) as error:
        beginning = bytes(data[:40])
        raise MessageError(
            "message", f"{beginning!r}… ({error})", "a msgpack map or a JSON object"
        ) from None


def read_header(data: bytes) -> Header | None:
    """What a message says of itself; None if it is malformed, which `decode` tells in words.

    Of a message that `decode` takes, type, source and number are those that it finds.
    """
    decoder = _json_header_decoder if is_json(data) else _msgpack_header_decoder
    try:
        return decoder.decode(data)
    except (ValueError, RecursionError, MemoryError):
        return None


def is_json(data: bytes) -> bool:
    """Whether a message is JSON; else it is msgpack."""
    return data[:1] in _JSON_BEGINS


def _name_mistake(data: bytes, as_json: bool, problem: str) -> MessageError:
    """What a message of good form but wrong content says about itself."""
    problem, _, place = problem.replace("`", "").partition(" - at $")
    expected, _, found = problem.removeprefix("Expected ").partition(", got ")
    field = place.strip(".")
    source, sequence = "unknown", None
    if len(data) <= _CLOSER_LOOK:
        try:
            value: Any = msgspec.json.decode(data) if as_json else msgspec.msgpack.decode(data)
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
    return _to_array(field, values, (count,), f"{count} numbers, one for each name or id")


def to_rows(
    field: str, rows: Rows, width: int, count: int | None = None, of: str = "values"
) -> NDArray[np.float64]:
    """Rows of numbers as an array, of shape (count, width).

    Args:
        field: Name of the field.
        rows: What it holds.
        width: Numbers in a row.
        count: How many rows there must be; None: any number of them.
        of: What the numbers are, for people.

    Raises:
        MessageError: If the number of rows, or of values in one of them, is not that.
    """
    if count is None:
        count = count_rows(rows, width)
    return _to_array(field, rows, (count, width), f"{count} rows of {width} {of}")


def count_rows(rows: Rows, width: int) -> int:
    """How many rows of so many numbers a field has, whatever else is wrong with it."""
    return len(rows) // (8 * width) if isinstance(rows, bytes) else len(rows)


def to_points(field: str, points: Points, count: int) -> NDArray[np.float64]:
    """Points as an array, of shape (count, 3) or (count, k, 3), k at most 8.

    Raises:
        MessageError: If the number of rows, points or coordinates is not that.
    """
    each, is_hull = 1, False
    if isinstance(points, bytes):
        each = len(points) // (24 * count) if count else 1
        is_hull = each > 1
    elif points and points[0] and isinstance(points[0][0], list):
        each, is_hull = len(points[0]), True
    expected = (
        f"{count} rows of 3 coordinates, or of 1 to {POINT_LIMIT} such points, as many in each row"
    )
    if not each <= POINT_LIMIT:
        raise MessageError(field, f"of {each} points each", expected)
    return _to_array(field, points, (count, each, 3) if is_hull else (count, 3), expected)


def to_mask(field: str, values: bytes | list[bool], count: int) -> NDArray[np.bool_]:
    """One truth a point as an array, of shape (count,).

    Raises:
        MessageError: If there are more or fewer than `count`, or others than 0 and 1.
    """
    if len(values) != count:
        raise MessageError(field, f"{len(values)} values", f"{count}, one for each point")
    mask = np.array(bytearray(values), np.uint8)
    if count and mask.max() > 1:
        raise MessageError(field, f"with a byte of {mask.max()}", "0 or 1 for each point")
    return mask.astype(np.bool_)


def _to_array(
    field: str, values: bytes | list[Any], shape: tuple[int, ...], expected: str
) -> NDArray[np.float64]:
    """Packed numbers, or lists of them, as an array of a shape."""
    if isinstance(values, bytes):
        if len(values) != 8 * math.prod(shape):
            raise MessageError(field, f"{len(values)} bytes", f"packed float64: {expected}")
        return np.frombuffer(values, PACKED).reshape(shape)
    try:
        array = np.array(values, float)
    except ValueError:
        raise MessageError(field, "rows of unequal length", expected) from None
    if len(values) != shape[0]:
        unit = "rows" if len(shape) > 1 else "values"
        raise MessageError(field, f"{len(values)} {unit}", expected)
    if array.shape != shape and len(values):
        raise MessageError(field, f"an array of shape {array.shape}", expected)
    return array.reshape(shape)
