"""The summary of a run: counts verdicts; makes one object for programs, one table for people."""

from __future__ import annotations

import math
from collections import Counter
from typing import Any

from rich.table import Table
from rich.text import Text

from armguard.app.loop import LoopReport, Spread
from armguard.app.realtime import Realtime
from armguard.streams.faults import quote
from armguard.verdict import Effect, Level, ReasonKind, Verdict, find_weightiest

REASONS_SHOWN = 8
"""Greatest number of reasons of stops in the table; `--json` has all of them."""

PERCENTILES = ("p50", "p99", "p99.9", "max")
"""Names of the fields of a `Spread`."""

COLORS = {"STOP": "red", "SLOW": "yellow", "AWARE": "cyan", "CLEAR": "green"}


def summarise(report: LoopReport, counts: VerdictCounts) -> dict[str, Any]:
    """The object that `--json` prints; a missing time is null."""
    soonest = counts.min_contact_time
    return {
        "ticks": report.ticks - counts.waiting,
        "waiting": counts.waiting,
        "stops": counts.stops,
        "stop_reasons": dict(counts.reasons.most_common()),
        "levels": {level.name: count for level, count in counts.levels.items()},
        "min_contact_time": soonest if math.isfinite(soonest) else None,
        "contact_limits": _describe_permitted(counts),
        "tick_us": _describe_spread(report.tick),
        "drain_us": _describe_spread(report.drain),
        "step_us": _describe_spread(report.step),
        "publish_us": _describe_spread(report.publish),
        "late": report.late,
        "realtime": _describe_realtime(report.realtime),
        "incomplete": counts.incomplete,
        "faults": report.monitor_faults + sum(report.faults.values()),
        "received": report.received,
        "cut_short": report.cut_short,
        "message_faults": report.faults,
        "recording_lost": report.lost,
    }


def draw_summary(summary: dict[str, Any]) -> Table:
    """The table at the end of a run."""
    table = Table(title="summary", show_header=False)
    table.add_row("ticks", f"{summary['ticks']} ({summary['late']} late)")
    table.add_row("waited for joint states", f"{summary['waiting']} ticks, all with a STOP")
    if summary["ticks"]:
        for name, count in summary["levels"].items():
            share = f"{100.0 * count / summary['ticks']:.1f} % of the time"
            table.add_row(Text(name, COLORS[name]), share)
    elif summary["waiting"]:
        table.add_row(Text("STOP", COLORS["STOP"]), "all the time: no usable joint state arrived")
    table.add_row("stops", str(summary["stops"]))
    told = list(summary["stop_reasons"].items())
    for reason, count in told[:REASONS_SHOWN]:
        table.add_row("", f"{count} × {reason}")
    if len(told) > REASONS_SHOWN:
        rest = sum(count for _, count in told[REASONS_SHOWN:])
        table.add_row("", f"{rest} × {len(told) - REASONS_SHOWN} further reasons")
    table.add_row("soonest contact", _tell_time(summary, summary["min_contact_time"]))
    permitted = summary["contact_limits"]
    if permitted is not None:
        table.add_row("soonest harm", _tell_time(summary, permitted["min_harm_time"]))
        table.add_row("contact allowed", _tell_permitted(summary["ticks"], permitted))
    table.add_row("tick " + " / ".join(PERCENTILES), _tell_spread(summary["tick_us"]))
    for part in ("drain", "step", "publish"):
        table.add_row(f"  of it {part}", _tell_spread(summary[f"{part}_us"]))
    table.add_row("real time", _tell_realtime(summary["realtime"]))
    table.add_row("times incomplete", str(summary["incomplete"]))
    if summary["cut_short"]:
        waits = f"{summary['cut_short']} times an input had more messages than a tick reads"
        table.add_row("messages that waited", waits)
    table.add_row("faults", str(summary["faults"]))
    if summary["recording_lost"] is not None:
        lost = summary["recording_lost"]
        table.add_row("recording", f"{lost} events lost" if lost else "nothing lost")
    return table


def _tell_spread(spread: dict[str, float | None]) -> str:
    times = ("–" if time is None else f"{time:.0f}" for time in spread.values())
    return " / ".join(times) + " µs"


def _tell_time(summary: dict[str, Any], soonest: float | None) -> str:
    """The least contact time or harm time of a run, in words."""
    if soonest is not None:
        return f"{soonest:.3f} s"
    return "none possible" if summary["levels"]["CLEAR"] else "unknown"


def _tell_permitted(ticks: int, permitted: dict[str, Any]) -> str:
    """Share of a run in which permitted contact was possible, and its greatest speed, in words."""
    if not permitted["ticks"]:
        return "never possible before rest"
    fastest = permitted["max_contact_speed"]
    speed = "speed unknown" if fastest is None else f"at most {fastest:.2f} m/s"
    return f"{100.0 * permitted['ticks'] / ticks:.1f} % of the time, {speed}"


def _describe_permitted(counts: VerdictCounts) -> dict[str, Any] | None:
    """Statistics of permitted contact; None without contact limits."""
    if not counts.are_limits_stated:
        return None
    soonest, fastest = counts.min_harm_time, counts.max_contact_speed
    return {
        "ticks": counts.permitted,
        "min_harm_time": soonest if math.isfinite(soonest) else None,
        "max_contact_speed": fastest if math.isfinite(fastest) else None,
    }


def _describe_spread(spread: Spread) -> dict[str, float | None]:
    """Percentiles of a duration in [µs], in words."""
    return {
        name: round(1e6 * time, 1) if math.isfinite(time) else None
        for name, time in zip(PERCENTILES, spread, strict=True)
    }


def _describe_realtime(realtime: Realtime | None) -> dict[str, Any] | None:
    if realtime is None:
        return None
    return {"priority": realtime.priority, "memory_locked": realtime.memory_locked}


def _tell_realtime(granted: dict[str, Any] | None) -> str:
    if granted is None:
        return "not asked for"
    priority = granted["priority"]
    scheduling = f"scheduled with priority {priority}" if priority else "scheduling refused"
    return scheduling + (", memory locked" if granted["memory_locked"] else ", memory not locked")


REASON_LIMIT = 64
"""Greatest number of reasons that are counted separately; others count as "other reasons"."""


class VerdictCounts:
    """Counts verdicts; its memory is bounded.

    Attributes:
        waiting: Ticks without a joint state to judge, all with a STOP; not counted anywhere else.
        levels: Ticks at each level.
        stops: How often the level fell to STOP; a run that begins with STOP begins with one.
        reasons: Number of stops by their weightiest reason.
        incomplete: How often verdicts changed from complete to incomplete.
        min_contact_time: Least contact time of all ticks with known arm and obstacles, in [s]; inf
            without such ticks.
        are_limits_stated: Whether contact limits were configured in any tick.
        min_harm_time: Least harm time of the same ticks, in [s]; inf without such ticks.
        permitted: Ticks in which permitted contact was possible before the arm was at rest.
        max_contact_speed: Greatest contact speed in those ticks, in [m/s].
    """

    def __init__(self) -> None:
        self.waiting = 0
        self.levels = dict.fromkeys(Level, 0)
        self.stops = 0
        self.reasons: Counter[str] = Counter()
        self.incomplete = 0
        self.min_contact_time = self.min_harm_time = math.inf
        self.are_limits_stated = False
        self.permitted = 0
        self.max_contact_speed = 0.0
        self._level: Level | None = None
        self._complete = True

    def count(self, verdict: Verdict) -> None:
        """Add one verdict."""
        if verdict.sequence == 0:
            self.waiting += 1
            return
        if verdict.level is Level.STOP and self._level is not Level.STOP:
            self.stops += 1
            self._count_reason(verdict)
        self._level = verdict.level
        self.levels[verdict.level] += 1
        self.incomplete += self._complete and not verdict.complete
        self._complete = verdict.complete
        if _is_known(verdict):
            self.min_contact_time = min(self.min_contact_time, verdict.contact_time)
            self.min_harm_time = min(self.min_harm_time, verdict.harm_time)
        if verdict.contact_speed is not None:
            self.are_limits_stated = True
            if any(one.kind is ReasonKind.CONTACT_ALLOWED for one in verdict.reasons):
                self.permitted += 1
                self.max_contact_speed = max(self.max_contact_speed, verdict.contact_speed)

    def _count_reason(self, verdict: Verdict) -> None:
        """Count the weightiest reason of a stop, without the figures of its detail."""
        reason = "no reason"
        weightiest = find_weightiest(verdict.reasons)
        if weightiest is not None:
            subject = quote(weightiest.subject)
            text = weightiest.kind.text
            reason = f"{text}: {subject}" if subject else text
        if reason not in self.reasons and len(self.reasons) >= REASON_LIMIT:
            reason = "other reasons"
        self.reasons[reason] += 1


def _is_known(verdict: Verdict) -> bool:
    """Whether a contact time was computed for a pair, and is not 0 because something is unknown.

    A refused joint state has no pair. An obstacle has contact time 0 if it could be anywhere,
    because its source is silent or its samples are refused. Measured contact counts as known.
    """
    if verdict.link is None or not verdict.complete:
        return False
    return verdict.contact_time > 0.0 or not any(
        reason.kind.effect is Effect.STANDING and reason.kind is not ReasonKind.IN_CONTACT
        for reason in verdict.reasons
    )
