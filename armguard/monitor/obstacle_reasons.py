"""What is wrong with the obstacle table in a tick, as reasons of a verdict."""

from __future__ import annotations

from armguard.obstacles.faults import Fault, FaultKind
from armguard.obstacles.obstacles import Obstacles
from armguard.verdict import Reason, ReasonKind


def take_obstacle_reasons(obstacles: Obstacles, now: float, timeout: float) -> list[Reason]:
    """Reasons to stop for as long as they last; takes the faults that were left for this tick.

    States that are stamped too far ahead are given up: their obstacles could be anywhere.

    Args:
        obstacles: The table.
        now: Time of the tick, in [s].
        timeout: Silence that a source may keep, and lead of its stamps, in [s].
    """
    reasons = [
        Reason(ReasonKind.SOURCE_SILENT, name) for name in obstacles.silent_sources(now, timeout)
    ]
    for name in obstacles.ahead_sources(now, timeout):
        reasons.append(Reason(ReasonKind.STAMP_AHEAD, name))
    for row in obstacles.rows_ahead(now, timeout):
        reasons.append(Reason(ReasonKind.STAMP_AHEAD, obstacles.ids[row]))
        obstacles.distrust(row)
    named = set()
    for fault in obstacles.take_faults():
        named.add(fault.id)
        reasons.append(_as_reason(fault))
    for name in obstacles.unplaced():
        if name not in named:
            reasons.append(Reason(ReasonKind.OBSTACLE_REFUSED, name, str(FaultKind.TABLE_FULL)))
    for row in obstacles.refused_rows():
        if obstacles.ids[row] not in named:
            reasons.append(Reason(ReasonKind.OBSTACLE_REFUSED, obstacles.ids[row]))
    return reasons


def describe_no_sources(obstacles: Obstacles) -> Reason:
    """What it means that no source was named or heard: STOP, unless that was said."""
    if not obstacles.expects_sources:
        return Reason(ReasonKind.NO_SOURCES_EXPECTED)
    detail = "none was named and none was heard; Obstacles(sources=[]) says that there is none"
    return Reason(ReasonKind.NO_SOURCES, detail=detail)


def _as_reason(fault: Fault) -> Reason:
    if fault.kind in (FaultKind.UNKNOWN_ID, FaultKind.STALE_REMOVAL):
        # Nothing was let go of, so nothing is known any worse than before.
        kind = ReasonKind.REMOVAL_IGNORED
    elif fault.kind is FaultKind.SHARED_ID:
        kind = ReasonKind.ID_SHARED
    elif fault.id:
        kind = ReasonKind.OBSTACLE_REFUSED
    else:
        kind = ReasonKind.CALL_REFUSED
    return Reason(kind, fault.id or fault.source, f"{fault.field} is {fault.value}: {fault.kind}")
