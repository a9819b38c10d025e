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
    """no contact before it, [s]"""
    times: list[Figure]
    """start of each direction after the tick, [s]"""
    witnesses: list[tuple[Figure, Figure, Figure]]
    """separating unit vectors from arm to obstacle"""


class HeldMessage(msgspec.Struct):
    """Why a level is held below the level of the tick alone."""

    reason: ReasonMessage | None
    """weightiest reason then; nil: a reset"""
    contact_time: Figure
    """contact time then, or harm time with contact limits, [s]"""
    stop_time: Figure
    """stop time then, [s]"""
    since: Figure
    """time of the tick that lowered the level, [s]"""
    rises_at: Figure
    """earliest time at which the level can rise, [s]"""


class VerdictMessage(msgspec.Struct, tag_field="type", tag="verdict"):
    """A `Verdict` on the wire: times on the machine's monotonic clock, the level by name."""

    stamp: Figure
    """time of the joint state, [s]"""
    sequence: int
    """tick; 0: no joint state, or end"""
    level: str
    """`STOP`, `SLOW`, `AWARE` or `CLEAR`"""
    contact_time: Figure
    """earliest possible contact, [s]; infinite: none; 0: unknown"""
    stop_time: Figure
    """time until rest, if the next verdict is a STOP, [s]; infinite: unknown"""
    speed_scale: Figure
    """allowed share of the operating velocities, 0 to 1"""
    link: str | None
    """link of the deciding pair"""
    obstacle: str | None
    """obstacle of the deciding pair"""
    complete: bool
    """whether every pair was judged"""
    evaluated: int
    """number of computed contact times"""
    reasons: list[ReasonMessage]
    """the weightiest first"""
    valid_until: Figure
    """time at which the verdict expires, [s]"""
    separation: float | None
    """margin of the [separation distance](separation.md), [m]"""
    certificate: CertificateMessage | None
    """proof; `armguard run` sends none"""
    stop: Literal["finish", "brake"] | None
    """how to stop: run the committed piece to its end, or brake"""
    proved_until: float | None
    """time of rest on the committed piece, if proved, [s]"""
    held: HeldMessage | None
    """why the level is below this tick's"""
    harm_time: Figure
    """earliest contact that no contact limit permits, [s]; 0: unknown"""
    contact_speed: float | None
    """bound on the speed of contacts before rest, [m/s]; only with contact limits"""
    configuration: str | None
    """digest that `armguard run` prints"""
    run: str = ""
    """random text, another one after each start of the monitor"""
    arm: str = ""
    """name of the arm"""


class PlanVerdictMessage(msgspec.Struct, tag_field="type", tag="plan_verdict"):
    """A `PlanVerdict` on the wire, with the number of the plan that it answers."""

    number: int
    """number of the plan"""
    safe: bool
    """whether the arm may do it"""
    contact_time: Figure
    """earliest possible contact, [s]; infinite: none; 0: unknown"""
    link: str | None
    """link of the deciding pair"""
    obstacle: str | None
    """obstacle of the deciding pair"""
    reasons: list[ReasonMessage]
    """why it may not"""


class ResetVerdictMessage(msgspec.Struct, tag_field="type", tag="reset_verdict"):
    """A `ResetVerdict` on the wire, with the number of the reset that it answers."""

    number: int
    """number of the reset"""
    obeyed: bool
    """whether latches were released; lasting causes latch again"""
    problem: str
    """why it was refused, or empty"""


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
    verdict: Verdict,
    offset: float,
    *,
    configuration: str | None = None,
    run: str = "",
    arm: str = "",
    as_json: bool = False,
) -> bytes:
    """A verdict as a msgpack map, or as a JSON object.

    Args:
        verdict: In the monitor's own time.
        offset: Machine's monotonic clock minus the monitor's, in [s].
        configuration: Digest of what the monitor was made with; None: it is not told.
        run: Text that each start of the monitor makes anew; empty: it is not told.
        arm: Name of the arm; empty in a cell with one.
        as_json: Whether it is JSON.
    """
    message = to_verdict_message(verdict)
    message.configuration, message.run, message.arm = configuration, run, arm
    message.stamp = verdict.stamp + offset
    # Never too long.
    message.valid_until = math.nextafter(verdict.valid_until + offset, -math.inf)
    if verdict.proved_until is not None:
        message.proved_until = verdict.proved_until + offset
    if message.held is not None and verdict.held is not None:
        message.held.since = verdict.held.since + offset
        message.held.rises_at = verdict.held.rises_at + offset
    return _encode(message, as_json)


def encode_command(
    command: CommandMessage, offset: float, *, run: str = "", arm: str = "", as_json: bool = False
) -> bytes:
    """A command as a msgpack map, or as a JSON object.

    Args:
        command: In the monitor's own time; not changed.
        offset: Machine's monotonic clock minus the monitor's, in [s].
        run: As for `encode_verdict`.
        arm: As for `encode_verdict`.
        as_json: Whether it is JSON.
    """
    moved = move_clock(command, offset, run, arm)
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
