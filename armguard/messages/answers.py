"""What a monitor answers: verdicts, commands, and answers to plans and resets, in msgpack or JSON.

Times on the wire are of the machine's monotonic clock, and levels stand by name.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Literal

import msgspec
import numpy as np

from armguard.messages.command import CommandMessage, move_clock, unpack
from armguard.messages.incoming import MessageError, is_json, to_plain
from armguard.messages.reasons import ReasonMessage, read_reasons, write_reasons
from armguard.verdict import Held, Level, PlanVerdict, ResetVerdict, Verdict

if TYPE_CHECKING:
    from armguard.contact.earliest import Certificate

GREATEST = sys.float_info.max
"""Stands in JSON for what is infinite."""

Figure = float | None
"""A number of an answer: nil stands in JSON for what is no number, as of a stamp that was none."""


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
    """of that tick, [s]; of contact that no limit permits, where contact limits are stated"""
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
    separation: float | None
    """margin of the separation distance, [m], where the cell file asks for it and it is known"""
    certificate: CertificateMessage | None
    """proof of the deciding pair; `armguard run` sends none"""
    stop: Literal["finish", "brake"] | None
    """how to obey a STOP: run the committed piece to rest, or leave it and brake; nil where the
    level is another"""
    proved_until: float | None
    """when the arm rests at the latest, if it follows its committed piece, which is proved safe to
    its end, [s] of the machine's monotonic clock; nil where it is on no such piece"""
    held: HeldMessage | None
    """why the level is held, though this tick alone would earn a higher one; nil: it is not"""
    harm_time: Figure
    """earliest possible contact that no contact limit permits, [s] from the tick; the contact time
    where no limits are stated, 0 where it is unknown"""
    contact_speed: float | None
    """greatest speed at which an obstacle could be touched before the arm rests, [m/s]; 0 where no
    contact is possible by then, infinite where nothing is proved, nil where no contact limits are
    stated"""
    configuration: str | None
    """digest of what the monitor was made with, as `armguard run` tells it at its start; nil where
    nobody tells it"""


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


_AnyAnswer = VerdictMessage | CommandMessage | PlanVerdictMessage | ResetVerdictMessage
_encoder = msgspec.msgpack.Encoder(enc_hook=to_plain)
_json_encoder = msgspec.json.Encoder(enc_hook=to_plain)
_decoder: msgspec.msgpack.Decoder[_AnyAnswer] = msgspec.msgpack.Decoder(_AnyAnswer)
_json_decoder: msgspec.json.Decoder[_AnyAnswer] = msgspec.json.Decoder(_AnyAnswer)


_LEVELS = tuple(level.name for level in Level)


def _to_json_figure(value: float) -> float:
    """A number for JSON, which has no infinite ones: the greatest that there is stands for those.

    Readers can compare it as it is. What is no number becomes null.
    """
    return math.copysign(GREATEST, value) if math.isinf(value) else float(value)


def _read_figure(value: Figure) -> float:
    return math.nan if value is None else value


def _read_json_figure(value: Figure) -> float:
    if value is None:
        return math.nan
    return math.copysign(math.inf, value) if abs(value) >= GREATEST else value


def to_verdict_message(verdict: Verdict) -> VerdictMessage:
    """A verdict as a message, in the monitor's own time; its numbers are as they are."""
    # Its fields are those of the message, in their order.
    message = VerdictMessage(*verdict)  # type: ignore[arg-type]
    message.level = _LEVELS[verdict.level]
    message.reasons = write_reasons(verdict.reasons) if verdict.reasons else []
    if verdict.certificate is not None:
        message.certificate = _to_certificate_message(verdict.certificate)
    if verdict.held is not None:
        message.held = _to_held_message(verdict.held)
    return message


def _to_certificate_message(certificate: Certificate) -> CertificateMessage:
    contact_time, times, witnesses = certificate
    return CertificateMessage(
        contact_time, times.tolist(), [tuple(one) for one in witnesses.tolist()]
    )


def _to_held_message(held: Held) -> HeldMessage:
    cause, *times = held
    return HeldMessage(None if cause is None else write_reasons((cause,))[0], *times)


def read_verdict(
    message: VerdictMessage, read: Callable[[Figure], float] = _read_figure
) -> Verdict:
    """The verdict that a message holds.

    Args:
        message: The message.
        read: Makes numbers of those of the message.

    Raises:
        ValueError: A level or a kind of reason is unknown.
    """
    fields = {name: getattr(message, name) for name in message.__struct_fields__}
    for name in ("stamp", "contact_time", "stop_time", "speed_scale", "valid_until", "harm_time"):
        fields[name] = read(fields[name])
    if message.level not in Level.__members__:
        raise ValueError(f"level {message.level!r}")
    fields["level"] = Level[message.level]
    fields["reasons"] = read_reasons(message.reasons)
    for name in ("separation", "proved_until", "contact_speed"):
        if fields[name] is not None:
            fields[name] = read(fields[name])
    if message.certificate is not None:
        # For readers of a monitor that certifies, which few do.
        from armguard.contact.earliest import Certificate

        contact_time, times, witnesses = msgspec.structs.astuple(message.certificate)
        fields["certificate"] = Certificate(
            read(contact_time),
            np.array([read(time) for time in times], float),
            np.array(witnesses, float).reshape(-1, 3),
        )
    if message.held is not None:
        cause, *numbers = msgspec.structs.astuple(message.held)
        reason = None if cause is None else read_reasons([cause])[0]
        fields["held"] = Held(reason, *map(read, numbers))
    return Verdict(**fields)


def to_plan_message(number: int, verdict: PlanVerdict) -> PlanVerdictMessage:
    """The answer to a plan as a message.

    Args:
        number: Of the plan, as its sender counts.
        verdict: The answer; its contact time is counted from when it was judged.
    """
    safe, contact_time, link, obstacle, reasons = verdict
    return PlanVerdictMessage(number, safe, contact_time, link, obstacle, write_reasons(reasons))


def encode_verdict(
    verdict: Verdict, offset: float, *, configuration: str | None = None, as_json: bool = False
) -> bytes:
    """A verdict as a msgpack map, or as a JSON object.

    Args:
        verdict: In the monitor's own time.
        offset: Machine's monotonic clock minus the monitor's, in [s].
        configuration: Digest of what the monitor was made with; None: it is not told.
        as_json: Whether it is JSON.
    """
    message = to_verdict_message(verdict)
    message.configuration = configuration
    message.stamp = verdict.stamp + offset
    # Never too long.
    message.valid_until = math.nextafter(verdict.valid_until + offset, -math.inf)
    if verdict.proved_until is not None:
        message.proved_until = verdict.proved_until + offset
    if message.held is not None and verdict.held is not None:
        message.held.since = verdict.held.since + offset
        message.held.rises_at = verdict.held.rises_at + offset
    return _encode(message, as_json)


def encode_command(command: CommandMessage, offset: float, *, as_json: bool = False) -> bytes:
    """A command as a msgpack map, or as a JSON object.

    Args:
        command: In the monitor's own time; not changed.
        offset: Machine's monotonic clock minus the monitor's, in [s].
        as_json: Whether it is JSON.
    """
    moved = move_clock(command, offset)
    return _encode(unpack(moved) if as_json else moved, as_json)


def encode_plan_verdict(number: int, verdict: PlanVerdict, *, as_json: bool = False) -> bytes:
    """The answer to a plan as a msgpack map, or as a JSON object; see `to_plan_message`."""
    return _encode(to_plan_message(number, verdict), as_json)


def encode_reset_verdict(number: int, verdict: ResetVerdict, *, as_json: bool = False) -> bytes:
    """The answer to a reset as a msgpack map, or as a JSON object.

    Args:
        number: Of the reset, as its sender counts.
        verdict: The answer.
        as_json: Whether it is JSON.
    """
    return _encode(ResetVerdictMessage(number, *verdict), as_json)


def _encode(message: _AnyAnswer, as_json: bool) -> bytes:
    return _json_encoder.encode(_bound(message)) if as_json else _encoder.encode(message)


def _bound(value: Any) -> Any:
    """A message, or a part of one, with the numbers that JSON has in place of others."""
    if isinstance(value, float):
        return _to_json_figure(value)
    if isinstance(value, list):
        return [_bound(one) for one in value]
    if isinstance(value, msgspec.Struct):
        for name in value.__struct_fields__:
            setattr(value, name, _bound(getattr(value, name)))
    return value


def decode_answer(
    data: bytes,
) -> Verdict | CommandMessage | tuple[int, PlanVerdict | ResetVerdict]:
    """What a monitor publishes: a verdict, a command, or the answer to a plan or reset by number.

    Both encodings are read. Times of a verdict are on the machine's monotonic clock. A verdict is
    read whatever its numbers are, since it may be a STOP; those that are none are NaN.

    Raises:
        MessageError: If it is none of these.
    """
    as_json = is_json(data)
    read = _read_json_figure if as_json else _read_figure
    try:
        message = (_json_decoder if as_json else _decoder).decode(data)
        if isinstance(message, PlanVerdictMessage):
            return message.number, PlanVerdict(
                message.safe,
                read(message.contact_time),
                message.link,
                message.obstacle,
                read_reasons(message.reasons),
            )
        if isinstance(message, ResetVerdictMessage):
            return message.number, ResetVerdict(message.obeyed, message.problem)
        if isinstance(message, CommandMessage):
            message.read()
            if message.contact_speed is not None:
                message.contact_speed = read(message.contact_speed)
            return message
        return read_verdict(message, read)
    except (ValueError, RecursionError, MessageError) as error:
        raise MessageError("verdict", f"unusable ({error})", "a verdict of this version") from None
