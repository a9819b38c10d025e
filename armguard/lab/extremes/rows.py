"""Lines of the table of extremes as rows, which are measured one by one, and kept."""

from __future__ import annotations

from typing import NamedTuple

from armguard.lab.extremes.evaluations import list_evaluations, measure_evaluation
from armguard.lab.extremes.line import Line
from armguard.lab.extremes.ticks import list_cases, measure_case
from armguard.lab.rows import MACHINE, Row, Rows, Tell

CASES = 50
"""Of each line of single evaluations."""


class Extent(NamedTuple):
    """What all lines share."""

    seed: int
    cases: int = CASES
    """Of each line of single evaluations."""


def measure_rows(extent: Extent, rows: Rows, tell: Tell) -> tuple[list[Line], bool]:
    """All lines in their order, and whether none is missing."""
    tasks = {name: ("evaluation", number) for number, name in enumerate(list_evaluations())}
    for number, case in enumerate(list_cases()):
        tasks[f"tick, {case.group}: {case.name}"] = "tick", number
    found, is_whole = rows.measure(measure_line, extent, tasks, "extremes", tell)
    lines = [Line(**row["line"] | {"machine": row.get(MACHINE, "")}) for row in found.values()]
    return lines, is_whole


def measure_line(extent: Extent, kind: str, number: int) -> Row:
    """One line as a row, by its kind and its place among those."""
    if kind == "evaluation":
        line = measure_evaluation(number, extent.cases, extent.seed)
    else:
        line = measure_case(list_cases()[number], extent.seed)
    return {"line": line._asdict()}
