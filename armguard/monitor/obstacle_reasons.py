"""Reports faults of the obstacle table in a tick as reasons of a verdict."""

from __future__ import annotations

from armguard.monitor.joint_reasons import describe_lead
from armguard.obstacles.faults import Fault, FaultKind
from armguard.obstacles.obstacles import Obstacles
from armguard.verdict import Effect, Reason, ReasonKind

_IN_WORDS = FaultKind.MALFORMED, FaultKind.PROMISE_BROKEN, FaultKind.FORGOTTEN
"""Kinds of faults whose value is text, with their verb."""


def take_obstacle_reasons(
    obstacles: Obstacles, now: float, timeout: float, rise_delay: float
) -> list[Reason]:
    """Reasons for faults of obstacles' data in a tick; removes the reported faults.

    Refused samples that were possible for long enough are dropped. States with stamps too far ahead
    are discarded: their obstacles could be anywhere.

    Args:
        obstacles: The table.
        now: Time of the tick, in [s].
        timeout: Greatest silence of a source, and greatest lead of its stamps, in [s].
        rise_delay: How long a refused sample is possible, in [s].
    """
    reasons = [
        Reason(ReasonKind.SOURCE_SILENT, name, detail)
        for name, detail in obstacles.describe_silent_sources(now, timeout)
    ]
    for name, lead in obstacles.ahead_sources(now, timeout):
        reasons.append(Reason(ReasonKind.STAMP_AHEAD, name, describe_lead(lead, timeout)))
    for row in obstacles.rows_ahead(now, timeout):
        lead = float(obstacles.table.stamp[row]) - now
        detail = describe_lead(lead, timeout)
        reasons.append(Reason(ReasonKind.STAMP_AHEAD, obstacles.ids[row], detail))
        obstacles.distrust(row)
    obstacles.judge_newcomers(now)
    for name, detail in obstacles.disbelieved_sources():
        reasons.append(Reason(ReasonKind.SOURCE_NOT_BELIEVED, name, detail))
    named = set()
    for fault in obstacles.take_faults():
        named.add(fault.id)
        reasons.append(_as_reason(fault))
    dropped = obstacles.take_dropped_faults()
    if dropped:
        # Those that stop the arm are kept first: of such there are more only where some are told.
        stops = any(one.kind.effect is Effect.STANDING for one in reasons)
        kind = ReasonKind.CALL_REFUSED if stops else ReasonKind.OBSTACLE_REFUSED
        some = "1 fault" if dropped == 1 else f"{dropped} faults"
        reasons.append(Reason(kind, "", f"and {some} more since the last step than are kept"))
    for name in obstacles.unplaced():
        if name not in named:
            reasons.append(Reason(ReasonKind.OBSTACLE_REFUSED, name, str(FaultKind.TABLE_FULL)))
    obstacles.forget_refused(now, rise_delay)
    for row in obstacles.refused_rows():
        name = obstacles.ids[row]
        if name not in named:
            detail = "could be anywhere" if obstacles.table.unknown[row] else ""
            reasons.append(Reason(ReasonKind.OBSTACLE_REFUSED, name, detail))
        if obstacles.stops_on_refusal(row):
            detail = 'its source asks for STOP: on_refusal = "stop"'
            reasons.append(Reason(ReasonKind.OBSTACLE_NOT_BELIEVED, name, detail))
    return reasons


def describe_spreads(obstacles: Obstacles) -> list[Reason]:
    """Reasons for obstacles whose samples have larger errors than their source states."""
    return [Reason(ReasonKind.ERRORS_EXCEEDED, *told) for told in obstacles.describe_spreads()]


def describe_broken_tethers(obstacles: Obstacles) -> list[Reason]:
    """Reasons for tethers that contradict the states of their obstacles; they are not used."""
    return [Reason(ReasonKind.TETHER_BROKEN, *told) for told in obstacles.describe_broken_tethers()]


def describe_no_sources(obstacles: Obstacles) -> Reason:
    """The reason that no source was named or has sent: STOP, unless this was configured."""
    if not obstacles.expects_sources:
        return Reason(ReasonKind.NO_SOURCES_EXPECTED)
    detail = "none was named and none has sent; Obstacles(sources=[]) says that there is none"
    return Reason(ReasonKind.NO_SOURCES, detail=detail)


def _as_reason(fault: Fault) -> Reason:
    if fault.kind in (FaultKind.UNKNOWN_ID, FaultKind.STALE_REMOVAL):
        # Nothing was let go of, so nothing is known any worse than before.
        kind = ReasonKind.REMOVAL_IGNORED
    elif fault.kind is FaultKind.SHARED_ID:
        kind = ReasonKind.ID_SHARED
    elif fault.kind is FaultKind.LATE:
        # It is in the cell, and not in the table: nothing bounds it.
        kind = ReasonKind.OBSTACLE_NOT_BELIEVED
    elif fault.kind is FaultKind.POINTS_DROPPED:
        kind = ReasonKind.POINTS_DROPPED
    elif fault.kind is FaultKind.FORGOTTEN:
        kind = ReasonKind.FORGOTTEN
    elif fault.kind is FaultKind.PROMISE_BROKEN:
        kind = ReasonKind.OTHER_ARM_BROKE
    elif fault.id:
        kind = ReasonKind.OBSTACLE_REFUSED
    else:
        kind = ReasonKind.CALL_REFUSED
    verb = "" if fault.kind in _IN_WORDS else "is "
    detail = f"{fault.field} {verb}{fault.value}"
    if fault.kind is not FaultKind.FORGOTTEN:
        # Of that one the reason's own kind says it.
        detail += f": {fault.kind}"
    return Reason(kind, fault.id or fault.source, detail)
