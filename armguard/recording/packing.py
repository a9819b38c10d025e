"""The bytes in which the loop tells the process that writes what happened.

The loop copies: numbers as they stand in memory, behind a header of fixed layout. What takes longer
than a copy is done by the other process: texts, lists, JSON. What a source says again in each of
its messages, its name and the ids of its obstacles, crosses once, as a `Heading`.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from typing import Any, NamedTuple

import msgspec
import numpy as np
from msgspec import UNSET
from numpy.typing import NDArray

from armguard.contact.earliest import Certificate
from armguard.obstacles.message import ToldSamples
from armguard.recording.events import (
    KINDS,
    REASON_NAMES,
    JointState,
    ObstacleUpdate,
    VerdictTold,
    spell,
    write_field,
)
from armguard.robot.portable import write_numbers
from armguard.verdict import Held, Level, Reason, Verdict

FRAME = struct.Struct("<Bq")
"""Before each event: its kind, by its place in `KINDS`, and when it came, in [ns] since 1970."""

ATTACHED, NOTED, HEADED, STATE, UPDATE = range(len(KINDS), len(KINDS) + 5)
"""Instead of a kind: what stands in the file once, as an attachment or as metadata; a `Heading`;
and joint states and updates as they usually are."""

NUMBERS = {kind: number for number, kind in enumerate(KINDS)}
"""Places in `KINDS`."""

_STATE = struct.Struct("<Bqdd")
"""`FRAME`; stamp, time of the tick. Then q and v."""

_UPDATE = struct.Struct("<BqH")
"""`FRAME`; number of the heading. Then the body."""

_BODY = struct.Struct("<BBHd5d")
"""Flags, which fields follow as arrays, points of each obstacle, stamp; each field where one number
holds for all. Then positions, velocities, those arrays."""

_SNAPSHOT, _VELOCITY, _ACCEL, _SPEED = 1, 2, 4, 8
"""Flags of an update: what the message said, or gave."""

_FLOAT = np.dtype(np.float64)

_REASONS = {name: kind for kind, name in REASON_NAMES.items()}


class Heading(NamedTuple):
    """What messages of a source have in common."""

    ids: list[str]
    source: str
    frame: str


class ToldState(NamedTuple):
    """Arguments of a step, and when they came, in [ns] since 1970."""

    came: int
    stamp: Any
    q: Any
    v: Any
    now: Any


class ToldVerdict(NamedTuple):
    """A verdict, and when it came, in [ns] since 1970."""

    came: int
    verdict: Verdict


class ToldUpdate(NamedTuple):
    """A message of a source, and when it came, in [ns] since 1970."""

    came: int
    heading: Heading
    body: bytes
    """As `pack_body` makes it."""


def pack_state(told: ToldState, shape: tuple[int]) -> bytes | None:
    """A joint state as it usually is, with its `FRAME`; None: it is another one.

    Args:
        told: Arguments of a step.
        shape: Of positions and velocities.
    """
    came, stamp, q, v, now = told
    if not (
        type(stamp) is float is type(now)
        and type(q) is np.ndarray is type(v)
        # NumPy has one object for the type of almost all arrays of float64.
        and q.dtype is _FLOAT is v.dtype
        and q.shape == shape == v.shape
    ):
        return None
    return _STATE.pack(STATE, came, stamp, now) + q.tobytes() + v.tobytes()


def read_state(data: bytes) -> JointState:
    """The joint state that `pack_state` made bytes of."""
    _, _, stamp, now = _STATE.unpack_from(data)
    values = np.frombuffer(data, np.float64, offset=_STATE.size).tolist()
    joints = len(values) // 2
    if not math.isfinite(sum(values)):
        values = write_numbers(values)
    return JointState(
        spell(stamp),
        spell(now),
        values[:joints],
        values[joints:],
    )


def pack_body(
    stamp: float,
    samples: ToldSamples,
    *,
    has_velocity: bool,
    has_accel: bool,
    has_speed: bool,
    snapshot: bool,
) -> bytes:
    """A message of a source, all but its heading.

    Args:
        stamp: In [s].
        samples: Its rows, which are copied.
        has_velocity: Whether it gave velocities, as in `ObstacleJournal.note_update`.
        has_accel: Whether it gave bounds on accelerations.
        has_speed: Whether it gave bounds on speeds.
        snapshot: Whether it shows the whole cell.
    """
    point_count, points, velocities, *fields = samples
    flags = _SNAPSHOT * snapshot + _VELOCITY * has_velocity + _ACCEL * has_accel
    parts, each = [b"", points.tobytes()], 0
    if has_velocity:
        parts.append(velocities.tobytes())
    given = True, has_accel, has_speed, True, has_velocity
    for i, field in enumerate(fields):
        if not isinstance(field, float):
            fields[i] = math.nan
            if given[i]:
                parts.append(field.tobytes())
                each += 1 << i
    parts[0] = _BODY.pack(flags + _SPEED * has_speed, each, point_count, stamp, *fields)
    return b"".join(parts)


def pack_update(told: ToldUpdate, heading: int) -> bytes:
    """A message of a source, with its `FRAME` and the number of its heading."""
    return _UPDATE.pack(UPDATE, told.came, heading) + told.body


def read_update(data: bytes, headings: Mapping[int, Heading]) -> ObstacleUpdate:
    """The message that `pack_update` made bytes of."""
    _, _, number = _UPDATE.unpack_from(data)
    flags, each, point_count, stamp, *fields = _BODY.unpack_from(data, _UPDATE.size)
    ids, source, frame = headings[number]
    count, place = len(ids), _UPDATE.size + _BODY.size

    def take(length: int) -> NDArray[np.float64]:
        nonlocal place
        start, place = place, place + 8 * length
        return np.frombuffer(data, np.float64, length, start)

    position = write_numbers(take(3 * count * point_count))
    velocity = write_numbers(take(3 * count * point_count)) if flags & _VELOCITY else UNSET
    radius, accel, speed, position_error, velocity_error = (
        write_field(take(count)) if each >> i & 1 else [spell(field)] * (count > 0)
        for i, field in enumerate(fields)
    )
    return ObstacleUpdate(
        ids=ids,
        stamp=spell(stamp),
        source=source,
        frame=frame,
        snapshot=bool(flags & _SNAPSHOT),
        points=point_count,
        position=position,
        velocity=velocity,
        radius=radius,
        accel=accel if flags & _ACCEL else UNSET,
        speed=speed if flags & _SPEED else UNSET,
        position_error=position_error,
        # Without velocities, what they are off by was made up by the table.
        velocity_error=velocity_error if flags & _VELOCITY else [],
    )


def pack_verdict(told: ToldVerdict) -> bytes:
    """A verdict, with its `FRAME`."""
    verdict = told.verdict
    reasons = [(REASON_NAMES[kind], subject, detail) for kind, subject, detail in verdict.reasons]
    certificate: Any = verdict.certificate
    if certificate is not None:
        times, witnesses = certificate.times, certificate.witnesses
        certificate = certificate.contact_time, times.tolist(), np.ravel(witnesses).tolist()
    held: Any = verdict.held
    if held is not None and held.reason is not None:
        kind, subject, detail = held.reason
        held = (REASON_NAMES[kind], subject, detail), *held[1:]
    fields = (*verdict[:10], reasons, *verdict[11:13], certificate, verdict[14], held)
    return FRAME.pack(NUMBERS[VerdictTold], told.came) + pack_plain(fields)


def unpack_verdict(data: bytes) -> Verdict:
    """The verdict that `pack_verdict` made bytes of."""
    fields = msgspec.msgpack.decode(data[FRAME.size :])
    fields[2] = Level(fields[2])
    fields[10] = tuple(
        Reason(_REASONS[name], subject, detail) for name, subject, detail in fields[10]
    )
    if fields[13] is not None:
        contact_time, times, witnesses = fields[13]
        fields[13] = Certificate(
            contact_time, np.array(times, dtype=float), np.array(witnesses).reshape(-1, 3)
        )
    if fields[15] is not None:
        reason, *times = fields[15]
        if reason is not None:
            reason = Reason(_REASONS[reason[0]], *reason[1:])
        fields[15] = Held(reason, *times)
    return Verdict(*fields)


def _to_plain(value: object) -> object:
    """Numbers of NumPy as Python's."""
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{value!r} cannot be recorded")


_packer = msgspec.msgpack.Encoder(enc_hook=_to_plain)

pack_plain = _packer.encode
"""Plain data as bytes."""
