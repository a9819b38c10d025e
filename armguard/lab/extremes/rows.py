"""Lines of the table of extremes as rows, which are measured one by one, and kept."""

from __future__ import annotations

from typing import Any, NamedTuple

from armguard.lab.extremes.evaluations import list_evaluations, measure_evaluation
from armguard.lab.extremes.line import Line
from armguard.lab.extremes.ticks import list_cases, measure_case
from armguard.lab.rows import Row, Rows, Tell


class Extent(NamedTuple):
    """Which lines there are."""

    cases: int
    """Of each line of single evaluations."""
    seed: int
    is_small: bool
    """Whether ticks that take long are left out."""


def measure_rows(extent: Extent, rows: Rows, tell: Tell) -> tuple[list[Line], bool]:
    """All lines in their order, and whether none is missing."""
    tasks: dict[str, tuple[Any, ...]] = {
        name: ("evaluation", number) for number, name in enumerate(list_evaluations())
    }
    for number, case in enumerate(list_cases(is_small=extent.is_small)):
        tasks[f"tick, {case.group}: {case.name}"] = "tick", number
    found, is_whole = rows.measure(measure_line, extent, tasks, "extremes", tell)
    lines = [Line(**row["line"], machine=row.get("machine", "")) for row in found.values()]
    return lines, is_whole


def measure_line(extent: Extent, kind: str, number: int) -> Row:
    """One line as a row."""
    if kind == "evaluation":
        line = measure_evaluation(number, extent.cases, extent.seed)
    else:
        line = measure_case(number, is_small=extent.is_small, seed=extent.seed)
    data = line._asdict()
    del data["machine"]
    return {"line": data}
