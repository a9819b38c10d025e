"""The report on the paper's claims: CSV and JSON for programs, a page in Markdown for people.

Every figure comes from the run, whose command, machine, versions and seed the report names.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec

from armguard.exceptions import ArmguardError
from armguard.studies.paper.measure import (
    DAA,
    DISTANCE,
    FULL,
    STOP_TIME,
    Row,
    compute_claim,
    fit_exponent,
)

JSON_FILE, CSV_FILE, PAGE = "report.json", "claims.csv", "README.md"
"""What is written, beside pictures."""

FROM = 100
"""Pairs from which on exponents are fitted: below, what every tick costs hides the growth."""

COUNTED = ("evaluations", "comparisons", "tick")
"""Fields of a row whose growth is fitted."""

COLUMNS: tuple[tuple[str, str, str], ...] = (
    ("pairs", "pairs", "{:,}"),
    ("balls", "balls", "{}"),
    ("ticks", "ticks", "{}"),
    ("rounds", "rounds", "{:.3g}"),
    ("evaluations", "evaluations", "{:,.1f}"),
    ("comparisons", "comparisons", "{:,.1f}"),
    ("tick [µs]", "tick", "{:,.0f}"),
    ("flagged", "flagged", "{:.1%}"),
    ("agreement", "agreement", "{:.1%}"),
    ("place: p50, max", "rank_p50 rank_max", "{:,.0f}, {:,.0f}"),
    ("alarms", "alarms", "{}"),
    ("late p50, max [ticks]", "late_p50 late_max", "{:.0f}, {:.0f}"),
    ("unseen", "unseen", "{}"),
    ("unwatched", "unwatched", "{}"),
)
"""Of the table for people: head, fields, and how they are shown."""

LEGEND = (
    "Balls fly about in a hall; every two of them are a pair. Means are over the ticks after the "
    "first, which evaluates and sorts all pairs. “Rounds” says how often the last bucket came "
    "round meanwhile. “Evaluations” are of pairs whose turn it is, “comparisons” those of a merge "
    "sort, “tick” is processor time of evaluating, sorting and naming the first. “Flagged” is the "
    "share of the pairs that are to be watched out of turn, in addition to the evaluations "
    "counted here. “Agreement” is the share of ticks in which the pair named first has the "
    "smallest contact time of all, “place” where it really stands. An “alarm” is a contact time "
    f"that falls to {STOP_TIME:g} s; “late” is how long after it the pair has its turn, “unseen” "
    "counts those that had gone before. “Unwatched” counts ticks of pairs within that time which "
    "were neither in turn nor flagged; it must be 0."
)


def describe(rows: Sequence[Row], interrupted: bool, facts: Mapping[str, str]) -> dict[str, Any]:
    """All that was found, as plain data; what is no number is null."""
    return {
        **facts,
        "interrupted": interrupted,
        "summary": summarise(rows, interrupted),
        "rows": [
            {
                name: round_off(value) if isinstance(value, float) else value
                for name, value in row._asdict().items()
            }
            for row in rows
        ],
        "exponents": fit_exponents(rows),
    }


def fit_exponents(rows: Sequence[Row]) -> dict[str, dict[str, float]]:
    """By schedule and counted field, the exponent of growth with pairs, over all periods."""
    fitted: dict[str, dict[str, float]] = {}
    for name in _list_schedules(rows):
        some = [row for row in rows if row.schedule == name and row.pairs >= FROM]
        if len({row.pairs for row in some}) < 2:
            continue
        pairs = [float(row.pairs) for row in some]
        fitted[name] = {
            field: round(fit_exponent(pairs, [getattr(row, field) for row in some]), 3)
            for field in COUNTED
        }
    return fitted


def compare_with_claim(rows: Sequence[Row], schedule: str) -> tuple[float, float]:
    """Least and most comparisons of a schedule's tick, in units of L log2 L over L buckets."""
    shares = [
        row.comparisons / compute_claim(row.pairs)
        for row in rows
        if row.schedule == schedule and row.pairs >= FROM
    ]
    return min(shares, default=math.nan), max(shares, default=math.nan)


def summarise(rows: Sequence[Row], interrupted: bool) -> list[str]:
    """What was found, a line each."""
    lines = []
    if interrupted:
        lines.append("Interrupted: this is what was measured; larger worlds had not begun.")
    fitted = fit_exponents(rows)
    for name in _list_schedules(rows):
        some = [row for row in rows if row.schedule == name]
        text = (
            f"{name}: {some[0].evaluations:,.1f} evaluations a tick at {some[0].pairs} pairs, "
            f"{some[-1].evaluations:,.1f} at {some[-1].pairs:,}"
        )
        if name in fitted:
            growth = fitted[name]
            text += (
                f"; from {FROM} pairs on evaluations grow as pairs^{growth['evaluations']:.2f}, "
                f"comparisons as pairs^{growth['comparisons']:.2f}, time as "
                f"pairs^{growth['tick']:.2f}"
            )
        if name == FULL and name in fitted:
            large = [row for row in some if row.pairs >= FROM]
            balls = fit_exponent([row.balls for row in large], [row.evaluations for row in large])
            text += f"; in balls, evaluations grow as balls^{balls:.2f}, the paper's O(N²)"
        lines.append(f"{text}.")
    for name, _, sort in DAA:
        least, most = compare_with_claim(rows, name)
        if sort == "partial" and math.isfinite(least):
            lines.append(
                f"{name}: a tick's comparisons are {least:.2f} to {most:.2f} times L log2 L at all "
                "sizes, L being the number of buckets of 1, 2, 4 … places: the paper's "
                "O(log N log log N)."
            )
    for period in dict.fromkeys(row.period for row in rows):
        for name in (DAA[0][0], DAA[1][0], DISTANCE):
            some = [row for row in rows if row.schedule == name and row.period == period]
            if some:
                lines.append(_tell_agreement(period, name, some))
    unwatched = sum(row.unwatched for row in rows)
    alarms = sum(row.alarms for row in rows if row.schedule == FULL)
    lines.append(
        f"Unwatched pairs: {unwatched}, in {alarms} alarms."
        + (" A pair came near unwatched: please report it." if unwatched else "")
    )
    return lines


def _tell_agreement(period: float, name: str, rows: Sequence[Row]) -> str:
    parts = [
        f"{row.agreement:.1%}" + (f" (flagged {row.flagged:.1%})" if row.flagged else "")
        + f" at {row.pairs:,}"
        for row in rows
    ]  # fmt: skip
    text = f"Every {1e3 * period:g} ms, {name} names the most imminent pair in "
    return f"{text}{', '.join(parts)} pairs."


def write_report(
    folder: Path,
    rows: Sequence[Row],
    interrupted: bool,
    facts: Mapping[str, str],
    pictures: Mapping[str, bytes],
) -> None:
    """Write all files; pictures are PNG and SVG by file name.

    Raises:
        ArmguardError: One of them cannot be written.
    """
    data = describe(rows, interrupted, facts)
    files: dict[str, bytes] = {
        JSON_FILE: msgspec.json.format(msgspec.json.encode(data), indent=1),
        CSV_FILE: _write_csv(rows).encode(),
        PAGE: _write_page(rows, interrupted, facts, sorted(pictures)).encode(),
        **pictures,
    }
    for name, content in files.items():
        try:
            (folder / name).write_bytes(content)
        except OSError as error:
            raise ArmguardError(
                str(folder / name), f"cannot be written: {error.strerror}"
            ) from None


def round_off(value: float) -> float | None:
    """Six digits of a number; None for what is no number."""
    return float(f"{value:.6g}") if math.isfinite(value) else None


def _list_schedules(rows: Sequence[Row]) -> list[str]:
    return list(dict.fromkeys(row.schedule for row in rows))


def _write_csv(rows: Sequence[Row]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(Row._fields)
    for row in rows:
        writer.writerow(
            "" if value is None else value
            for value in (round_off(one) if isinstance(one, float) else one for one in row)
        )
    return text.getvalue()


def _write_page(
    rows: Sequence[Row], interrupted: bool, facts: Mapping[str, str], pictures: Sequence[str]
) -> str:
    lines = ["# What the paper claims of its schedules, measured", ""]
    lines += [f"- {line}" for line in summarise(rows, interrupted)]
    lines += ["", "## Worlds", "", LEGEND, ""]
    for period in dict.fromkeys(row.period for row in rows):
        lines += [f"### A tick every {1e3 * period:g} ms", ""]
        lines.append(f"| schedule | {' | '.join(head for head, _, _ in COLUMNS)} |")
        lines.append(f"|---|{'---:|' * len(COLUMNS)}")
        for row in sorted(
            (row for row in rows if row.period == period),
            key=lambda row: _list_schedules(rows).index(row.schedule),
        ):
            lines.append(f"| {row.schedule} | {' | '.join(show(row))} |")
        lines.append("")
    for name in pictures:
        if name.endswith(".png"):
            lines += [f"![{name.removesuffix('.png')}]({name})", ""]
    lines += ["## How it was measured", ""]
    lines += [f"- {name.capitalize()}: {fact}" for name, fact in facts.items()]
    lines += ["", f"All figures are in [{JSON_FILE}]({JSON_FILE}) and [{CSV_FILE}]({CSV_FILE})."]
    return "\n".join(lines) + "\n"


def show(row: Row) -> list[str]:
    """A row's cells for people."""
    cells = []
    for _, fields, form in COLUMNS:
        values = [getattr(row, field) for field in fields.split()]
        cells.append(form.format(*values) if all(map(math.isfinite, values)) else "–")
    return cells
