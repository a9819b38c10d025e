"""Pictures of the paper's claims: what a tick costs, and what is noticed for that."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Sequence
from typing import Any

from armguard.lab.paper.measure import DISTANCE, FULL, Row, compute_claim
from armguard.lab.pictures import MARKS, draw_figures

SIZE = 10.0, 4.5

CAPTIONS = {
    "cost": "What a tick costs, against the number of pairs",
    "awareness": "How often the most imminent pair is named, and what is flagged, against pairs",
}
"""What the pictures show, by name."""


def draw_pictures(rows: Sequence[Row]) -> dict[str, bytes]:
    """PNG files by name."""
    drawn = {"cost": _draw_cost, "awareness": _draw_awareness}
    return draw_figures(
        {name: functools.partial(draw, rows=rows) for name, draw in drawn.items()}, SIZE
    )


def _draw_cost(figure: Any, rows: Sequence[Row]) -> None:
    """Evaluations, comparisons and time against pairs, in the first of the periods."""
    period = rows[0].period
    for axes, field, label in zip(
        figure.subplots(1, 3, sharex=True),
        ("evaluations", "comparisons", "tick"),
        ("evaluations a tick", "comparisons a tick", "tick, median, µs"),
        strict=True,
    ):
        for name, some in _group(rows, period):
            axes.plot(
                [row.pairs for row in some], [getattr(row, field) for row in some],
                f"{MARKS[_place(rows, name)]}-", ms=4, label=name,
            )  # fmt: skip
        if field == "comparisons":
            pairs = sorted({row.pairs for row in rows})
            axes.plot(
                pairs, [compute_claim(count) for count in pairs], "k:", label="L log L, L buckets"
            )
        axes.set(xscale="log", yscale="log", xlabel="pairs", ylabel=label)
        axes.grid(alpha=0.3)
        if field == "comparisons":
            axes.legend(fontsize="x-small")


def _draw_awareness(figure: Any, rows: Sequence[Row]) -> None:
    """Agreement with the true order, and the share that is flagged, against pairs."""
    periods = list(dict.fromkeys(row.period for row in rows))
    for axes, field in zip(
        figure.subplots(1, 2, sharex=True), ("agreement", "flagged"), strict=True
    ):
        for period, style in zip(periods, itertools.cycle(("-", "--", ":")), strict=False):
            for name, some in _group(rows, period):
                if name == FULL or (field == "flagged" and name == DISTANCE):
                    continue
                axes.plot(
                    [row.pairs for row in some], [100.0 * getattr(row, field) for row in some],
                    f"{MARKS[_place(rows, name)]}{style}", ms=4, color=f"C{_place(rows, name)}",
                    label=f"{name}, {1e3 * period:g} ms",
                )  # fmt: skip
        axes.set(xscale="log", xlabel="pairs")
        axes.set_ylabel(
            "most imminent pair named, % of ticks" if field == "agreement" else "flagged, %"
        )
        axes.set_ylim(-3.0, 103.0)
        axes.grid(alpha=0.3)
        if field == "agreement":
            axes.legend(fontsize="x-small")


def _group(rows: Sequence[Row], period: float) -> list[tuple[str, list[Row]]]:
    some = [row for row in rows if row.period == period]
    return [
        (name, [row for row in some if row.schedule == name])
        for name in dict.fromkeys(row.schedule for row in some)
    ]


def _place(rows: Sequence[Row], name: str) -> int:
    return list(dict.fromkeys(row.schedule for row in rows)).index(name) % len(MARKS)
