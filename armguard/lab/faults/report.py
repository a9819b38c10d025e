"""What a campaign found, as a table on a terminal, a page, and one JSON object."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from rich.table import Table

from armguard.lab.faults.campaign import CampaignReport
from armguard.lab.faults.outcome import Outcome
from armguard.lab.pages import write_table
from armguard.lab.study_facts import list_facts
from armguard.streams.faults import quote

COLUMNS = (
    "fault",
    "detected [ms]",
    "verdict",
    "by what",
    "recovered [ms]",
    "lost",
    "closest [mm]",
    "control",
    "contacts",
)

GROUP_COLUMNS = ("fault", "number", "detected at most [ms]", "contacts")

GROUPS = {
    "set": "values not finite",
    "drop": "messages dropped",
    "late": "messages late or out of order",
    "delay": "messages late or out of order",
    "swap": "messages late or out of order",
    "repeat": "messages late or out of order",
    "clock": "wrong clocks",
    "drift": "wrong clocks",
    "crowd": "overload",
    "flood": "overload",
}
"""Of disturbances, by kind."""

OTHERS, PROCESSES = "wrong content", "processes and disks"
"""Groups of all other disturbances, and of what strikes no stream."""

PAGE = Path(__file__).with_name("page.md")
"""The page, with places for what was found."""

UNTRIED = "could not be tried on this machine"
"""What is said of a fault before which the cell did not get sound, or its arm did not move."""

SIGN_WIDTH = 90
"""Longest sign in a table, in characters."""


def list_cells(outcome: Outcome) -> list[str]:
    """The cells of one fault's row, in the order of `COLUMNS`."""
    contacts = f"**{outcome.obeying.contacts}**" if outcome.obeying.contacts else "0"
    if not outcome.was_tried:
        return [outcome.fault.name, "–", "–", UNTRIED, "–", "–", "–", "–", contacts]
    sign = quote(outcome.sign, SIGN_WIDTH) if outcome.fault.signs else "none needed"
    detected = _tell_milliseconds(outcome.detected, "**no**" if outcome.fault.signs else "–")
    recovered = _tell_milliseconds(outcome.recovered, "**no**")
    if outcome.resets:
        resets = f"{outcome.resets} {'reset' if outcome.resets == 1 else 'resets'}"
        foreign = f"; no sign of it: {', '.join(outcome.foreign)}" if outcome.foreign else ""
        recovered += f" ({resets}{foreign})"
    distance = outcome.obeying.distance
    return [
        outcome.fault.name,
        detected,
        outcome.level,
        sign.replace("|", "/"),
        recovered,
        str(outcome.missing) if outcome.missing else "nothing",
        f"{1e3 * distance:.0f}" if math.isfinite(distance) else "stood",
        "hit" if outcome.ignoring.contacts else "**not hit**",
        contacts,
    ]


def draw_table(report: CampaignReport) -> Table:
    """The table for a terminal; what is not as it must be stands out."""
    table = Table(
        *COLUMNS, title="faults", caption=" ".join(list_findings(report)).replace("**", "")
    )
    for outcome in report.outcomes:
        cells = [cell.replace("**", "") for cell in list_cells(outcome)]
        table.add_row(*cells, style="red" if outcome.problem else None)
    return table


def write_page(report: CampaignReport, table: str) -> str:
    """The page for docs/faults.md; `table` names the file with a row a fault."""
    replays = [
        f"- a recording of {one.compared:,} verdicts"
        + (", whose writer was killed, reads up to there and" if one.cut_off else "")
        + (" replays bit-identically" if one.identical else " **does not replay identically**")
        + (f", with {one.lost} events lost" if one.lost else ", nothing lost")
        for one in report.replayed
    ]
    named = list(dict.fromkeys(_name_group(outcome) for outcome in report.outcomes))
    groups = [[one for one in report.outcomes if _name_group(one) == name] for name in named]
    return PAGE.read_text(encoding="utf-8").format(
        summary="\n".join(f"- {line}" for line in list_findings(report)),
        count=len(report.outcomes),
        minutes=f"{report.duration / 60.0:.1f}",
        machine="; ".join(list_facts().values()),
        groups="\n".join(write_table(GROUP_COLUMNS, map(_sum_up, groups))),
        replays="\n".join(replays),
        table=table,
    )


def _name_group(outcome: Outcome) -> str:
    fault = outcome.fault
    return PROCESSES if fault.act != "disturb" else GROUPS.get(fault.kind, OTHERS)


def _sum_up(outcomes: list[Outcome]) -> list[str]:
    """The row of a group."""
    needed = [one for one in outcomes if one.was_tried and one.fault.signs]
    return [
        _name_group(outcomes[0]),
        f"{len(outcomes)}",
        _tell_most([one.detected for one in needed]),
        f"{sum(one.obeying.contacts for one in outcomes)}",
    ]


def _tell_most(times: list[float | None]) -> str:
    """The longest in [ms]; one that never came stands out."""
    known = [time for time in times if time is not None]
    if len(known) < len(times):
        return "**no**"
    return _tell_milliseconds(max(known, default=None), "–")


def list_findings(report: CampaignReport) -> list[str]:
    """The result, a line each."""
    problems = [f"{one.fault.name}: {one.problem}" for one in report.outcomes if one.problem]
    problems += [f"{one.name}: another verdict" for one in report.replayed if not one.identical]
    tried = [outcome for outcome in report.outcomes if outcome.was_tried]
    untried = [outcome.fault.name for outcome in report.outcomes if not outcome.was_tried]
    hit = sum(outcome.ignoring.contacts > 0 for outcome in tried)
    lines = [
        f"**{report.whole.contacts} contacts** of the arm that obeys, in {len(report.outcomes)}"
        " faults.",
        f"**{1e3 * report.whole.distance:.0f} mm** was its smallest distance while it moved,"
        f" {100.0 * report.whole.moving:.0f} % of the time.",
        f"The control, an arm that ignores verdicts, was hit in **{hit} of {len(tried)}** faults.",
    ]
    if untried:
        lines.append(f"{UNTRIED.capitalize()}: {', '.join(untried)}.")
    if problems:
        lines.append(f"Not as it must be: {'; '.join(problems)}.")
    return lines


def describe(report: CampaignReport) -> dict[str, Any]:
    """The report as records and plain data in SI units, for `--json`."""
    faults = [one._asdict() | {"problem": one.problem} for one in report.outcomes]
    return {
        **list_facts(),
        "passed": report.passed,
        "seconds": report.duration,
        **report.whole._asdict(),
        "faults": [one | {"fault": one["fault"].name} for one in faults],
        "recordings": report.replayed,
    }


def _tell_milliseconds(seconds: float | None, otherwise: str) -> str:
    return otherwise if seconds is None else f"{1e3 * seconds:.0f}"
