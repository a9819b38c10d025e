"""What a campaign found, as a table on a terminal, a page, and one JSON object."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from rich.table import Table

from armguard.lab.faults.campaign import PATIENCE, CampaignReport
from armguard.lab.faults.outcome import Outcome
from armguard.lab.faults.scene import JOINT_TIMEOUT, LATENCY, SOURCE_TIMEOUT
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
    table = Table(*COLUMNS, title="faults", caption=summarise(report))
    for outcome in report.outcomes:
        cells = [cell.replace("**", "") for cell in list_cells(outcome)]
        table.add_row(*cells, style="red" if outcome.problem else None)
    return table


def write_page(report: CampaignReport) -> str:
    """The page for docs/faults.md."""
    rows = [list_cells(outcome) for outcome in report.outcomes]
    replays = [
        f"- a recording of {one.compared} verdicts"
        + (", whose writer was killed, reads up to there and" if one.cut_off else "")
        + (" replays bit-identically" if one.identical else " **does not replay identically**")
        + (f", with {one.lost} events lost" if one.lost else ", nothing lost")
        for one in report.replayed
    ]
    machine = "; ".join(list_facts().values())
    setting = (
        f"{len(report.outcomes)} faults in {report.duration / 60.0:.1f} minutes at 1 kHz on "
        f"{machine}. In the cell file: latency {1e3 * LATENCY:.0f} ms, joint_timeout "
        f"{1e3 * JOINT_TIMEOUT:.0f} ms, timeout of the camera {1e3 * SOURCE_TIMEOUT:.0f} ms."
    )
    return PAGE.read_text(encoding="utf-8").format(
        summary=f"{summarise(report)} {setting}",
        table="\n".join(write_table(COLUMNS, rows, range(len(COLUMNS)))),
        replays="\n".join(replays),
        patience=PATIENCE,
    )


def summarise(report: CampaignReport) -> str:
    """The result in a sentence or two."""
    problems = [f"{one.fault.name}: {one.problem}" for one in report.outcomes if one.problem]
    problems += [f"{one.name}: another verdict" for one in report.replayed if not one.identical]
    tried = [outcome for outcome in report.outcomes if outcome.was_tried]
    untried = [outcome.fault.name for outcome in report.outcomes if not outcome.was_tried]
    hit = sum(outcome.ignoring.contacts > 0 for outcome in tried)
    distance = 1e3 * report.whole.distance
    told = (
        f"{report.whole.contacts} contacts of the arm that obeys. It moved "
        f"{100.0 * report.whole.moving:.0f} % of the time and came no nearer than "
        f"{distance:.0f} mm while it did. The control, an arm that ignores verdicts, was hit in "
        f"{hit} of {len(tried)} faults."
    )
    if untried:
        told += f" {UNTRIED.capitalize()}: {', '.join(untried)}."
    return told + (f" Not as it must be: {'; '.join(problems)}." if problems else "")


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
