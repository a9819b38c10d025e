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
    region: str | list[str] | None = None
    """which region of a body each is, for [contact limits](contact_limits.md): one for all, or one
    a row, `""` for none; left out: the cell's, by patterns of ids"""


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


class GoalPath(msgspec.Struct, forbid_unknown_fields=True):
    """A path that a goal offers, from rest to rest."""

    q: Rows
    """positions, [rad] or [m], in rows of one value a name: waypoints of a smooth curve, or samples
    of a trajectory"""
    times: bytes | list[float] | None = None
    """of the samples, [s], rising; left out: the fastest within limits"""


class GoalMessage(Message, tag="goal"):
    """What a shield is to do from now on, in place of what it was asked before."""

    number: Number
    """of the goal; commands carry that of the newest one that was taken: use none twice, and none
    of another sender's"""
    until: float
    """a goal that comes later is refused, and a velocity ends then; [s] on the clock of the joint
    states"""
    names: list[str]
    """of the joints, in any order"""
    paths: list[GoalPath] | None = None
    """the first one on which the most progress is provable is followed; or"""
    velocity: bytes | list[float] | None = None
    """velocities to keep, [rad/s] or [m/s], one a name; or"""
    chunk: Rows | None = None
    """the next positions of a policy, [rad] or [m]: one row a point, one value a name"""
    arm: str = ""
    """whose goal it is, by its name in a cell with several arms; left out where there is one"""


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
