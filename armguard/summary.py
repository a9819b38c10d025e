"""What a run was like, in one object for programs and in one table for people."""

from __future__ import annotations

import math
from typing import Any

from rich.markup import escape
from rich.table import Table

from armguard.loop import LoopReport
from armguard.realtime import Realtime
from armguard.tally import Tally

REASONS_SHOWN = 8
"""Most reasons of stops in the table; `--json` has all that are told apart."""

COLORS = {"STOP": "red", "SLOW": "yellow", "AWARE": "cyan", "CLEAR": "green"}


def summarise(report: LoopReport, tally: Tally) -> dict[str, Any]:
    """The object that `--json` prints; a time that there is not is null."""
    times = {"p50": report.p50, "p99": report.p99, "p99.9": report.p999, "max": report.longest}
    soonest = tally.min_contact_time
    return {
        "ticks": report.ticks - tally.waiting,
        "waiting": tally.waiting,
        "stops": tally.stops,
        "stop_reasons": dict(tally.reasons.most_common()),
        "levels": {level.name: count for level, count in tally.levels.items()},
        "min_contact_time": soonest if math.isfinite(soonest) else None,
        "tick_us": {
            name: round(1e6 * time, 1) if math.isfinite(time) else None
            for name, time in times.items()
        },
        "late": report.late,
        "realtime": _describe_realtime(report.realtime),
        "incomplete": tally.incomplete,
        "faults": report.monitor_faults + sum(report.faults.values()),
        "received": report.received,
        "message_faults": report.faults,
    }


def draw_summary(summary: dict[str, Any]) -> Table:
    """The table at the end of a run."""
    table = Table(title="summary", show_header=False)
    spent = summary["tick_us"]
    table.add_row("ticks", f"{summary['ticks']} ({summary['late']} late)")
    table.add_row("waited for joint states", f"{summary['waiting']} ticks, told to STOP")
    if summary["ticks"]:
        for name, count in summary["levels"].items():
            share = f"{100.0 * count / summary['ticks']:.1f} % of the time"
            table.add_row(f"[{COLORS[name]}]{name}[/]", share)
    elif summary["waiting"]:
        table.add_row(
            f"[{COLORS['STOP']}]STOP[/]", "all the time: no joint state came that could be judged"
        )
    table.add_row("stops", str(summary["stops"]))
    told = list(summary["stop_reasons"].items())
    for reason, count in told[:REASONS_SHOWN]:
        table.add_row("", f"{count} × {escape(reason)}")
    if len(told) > REASONS_SHOWN:
        rest = sum(count for _, count in told[REASONS_SHOWN:])
        table.add_row("", f"{rest} × {len(told) - REASONS_SHOWN} further reasons")
    table.add_row("soonest contact", _tell_contact(summary))
    names = ("p50", "p99", "p99.9", "max")
    times = ["–" if spent[name] is None else f"{spent[name]:.0f}" for name in names]
    table.add_row("tick " + " / ".join(names), " / ".join(times) + " µs")
    table.add_row("real time", _tell_realtime(summary["realtime"]))
    table.add_row("incomplete ticks", str(summary["incomplete"]))
    table.add_row("faults", str(summary["faults"]))
    return table


def _tell_contact(summary: dict[str, Any]) -> str:
    soonest = summary["min_contact_time"]
    if soonest is not None:
        return f"{soonest:.3f} s"
    return "none possible" if summary["levels"]["CLEAR"] else "unknown"


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
