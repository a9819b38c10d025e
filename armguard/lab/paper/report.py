"""The report on the paper's claims: JSON for programs, a page in Markdown for people.

Every figure comes from the run, whose command, machine, versions and seed the report names.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from armguard.lab.pages import Column, fit_exponent, write_table
from armguard.lab.paper.measure import (
    DAA,
    FULL,
    STOP_TIME,
    Row,
    compute_claim,
)

FROM = 100
"""Pairs from which on exponents are fitted: below, what every tick costs hides the growth."""

COUNTED = ("evaluations", "comparisons", "tick")
"""Fields of a row whose growth is fitted."""

COLUMNS = (
    Column("pairs", "pairs", "{:,}"),
    Column("balls", "balls", "{}"),
    Column("ticks", "ticks", "{}"),
    Column("rounds", "rounds", "{:.3g}"),
    Column("evaluations", "evaluations", "{:,.1f}"),
    Column("comparisons", "comparisons", "{:,.1f}"),
    Column("tick [µs]", "tick", "{:,.0f}"),
    Column("flagged", "flagged", "{:.1%}"),
    Column("agreement", "agreement", "{:.1%}"),
    Column("place: p50, max", "rank_p50 rank_max", "{:,.0f}, {:,.0f}"),
    Column("alarms", "alarms", "{}"),
    Column("late p50, max [ticks]", "late_p50 late_max", "{:.0f}, {:.0f}"),
    Column("unseen", "unseen", "{}"),
    Column("unwatched", "unwatched", "{}"),
)
"""Of the table for people."""

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
    """All that was found, as plain data."""
    return {
        **facts,
        "interrupted": interrupted,
        "summary": summarise(rows, interrupted),
        "rows": rows,
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
    unwatched = sum(row.unwatched for row in rows)
    alarms = sum(row.alarms for row in rows if row.schedule == FULL)
    lines.append(
        f"Unwatched pairs: {unwatched}, in {alarms} alarms."
        + (" A pair came near unwatched: please report it." if unwatched else "")
    )
    return lines


def write_body(rows: Sequence[Row]) -> list[str]:
    """Lines of the page between the summary and how it was measured: a table for each period."""
    heads = ["schedule", *(column.head for column in COLUMNS)]
    order = _list_schedules(rows)
    body = ["## Worlds", "", LEGEND]
    for period in dict.fromkeys(row.period for row in rows):
        body += ["", f"### A tick every {1e3 * period:g} ms", ""]
        some = sorted(
            (row for row in rows if row.period == period),
            key=lambda row: order.index(row.schedule),
        )
        cells = [[row.schedule, *(column.show(row) for column in COLUMNS)] for row in some]
        body += write_table(heads, cells)
    return body


def _list_schedules(rows: Sequence[Row]) -> list[str]:
    return list(dict.fromkeys(row.schedule for row in rows))
