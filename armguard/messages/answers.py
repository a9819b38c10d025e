"""What a monitor answers: verdicts, and answers to plans and resets, in msgpack or JSON.

Times on the wire are of the machine's monotonic clock, and levels stand by name.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable
from typing import Literal

import msgspec
import numpy as np

from armguard.contact.earliest import Certificate
from armguard.messages.incoming import MessageError, is_json
from armguard.verdict import Held, Level, PlanVerdict, Reason, ReasonKind, ResetVerdict, Verdict

GREATEST = sys.float_info.max
"""Stands in JSON for what is infinite."""

Figure = float | None
"""A number of an answer: nil stands in JSON for what is no number, as of a stamp that was none."""


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


_AnyAnswer = VerdictMessage | PlanVerdictMessage | ResetVerdictMessage
_encoder = msgspec.msgpack.Encoder()
_json_encoder = msgspec.json.Encoder()
_decoder: msgspec.msgpack.Decoder[_AnyAnswer] = msgspec.msgpack.Decoder(_AnyAnswer)
_json_decoder: msgspec.json.Decoder[_AnyAnswer] = msgspec.json.Decoder(_AnyAnswer)


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
        verdict.level.name,
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
    as_json = is_json(data)
    try:
        message = (_json_decoder if as_json else _decoder).decode(data)
        if isinstance(message, PlanVerdictMessage):
            return message.number, PlanVerdict(
                message.safe,
                _read_number(message.contact_time, as_json),
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
            fields[name] = _read_number(fields[name], as_json)
        if message.separation is not None:
            fields["separation"] = _read_number(message.separation, as_json)
        proof = message.certificate
        if proof is not None:
            contact_time = _read_number(proof.contact_time, as_json)
            times = np.array([_read_number(time, as_json) for time in proof.times])
            witnesses = np.array(proof.witnesses, float).reshape(-1, 3)
            fields["certificate"] = Certificate(contact_time, times, witnesses)
        held = message.held
        if held is not None:
            names = ("contact_time", "stop_time", "since", "rises_at")
            read = (_read_number(getattr(held, name), as_json) for name in names)
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


def _read_number(value: Figure, as_json: bool) -> float:
    if value is None:
        return math.nan
    return math.copysign(math.inf, value) if as_json and abs(value) >= GREATEST else value


def _tell_reasons(reasons: Iterable[Reason]) -> list[ReasonMessage]:
    return [ReasonMessage(one.kind.name.lower(), one.subject, one.detail) for one in reasons]


def _read_reasons(reasons: Iterable[ReasonMessage]) -> tuple[Reason, ...]:
    return tuple(Reason(ReasonKind[one.kind.upper()], one.subject, one.detail) for one in reasons)
