"""`armguard paper`: what the paper claims of its schedules, measured from 3 to 100,000 pairs."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from armguard.app.processes import COMPLAINT, complain
from armguard.app.terminal import print_json
from armguard.exceptions import ArmguardError
from armguard.lab.pages import PAGE
from armguard.lab.paper.measure import BALLS, MOST_EVALUATIONS, PERIODS, Row, measure_claims
from armguard.lab.paper.plots import draw_pictures
from armguard.lab.paper.report import describe, summarise, write_report
from armguard.lab.pictures import check_plots
from armguard.lab.study_facts import list_facts, make_folder, show_progress, tell_command

SMALL_BALLS, SMALL_EVALUATIONS = BALLS[:5], 30_000
"""Of a run that takes no time."""


def run(out: Path, *, periods: Sequence[float], seed: int, is_small: bool, plots: bool) -> int:
    """Measure, write the report and print its summary; the exit code, 1 for an unwatched pair.

    Args:
        out: Folder of the report.
        periods: Of ticks, in [s]; none: the paper's and the default's.
        seed: Of all motions.
        is_small: Whether to leave out what takes long.
        plots: Whether to draw pictures.

    Raises:
        ArmguardError: Something is unusable.
        KeyboardInterrupt: It came before there was anything to show.
    """
    for period in periods:
        if not 1e-4 <= period <= 1.0:
            raise ArmguardError("--period", f"is {period:g} s", expected="0.0001 to 1")
    if len(set(periods)) != len(periods):
        raise ArmguardError("--period", "names one period twice", expected="each once")
    if not seed >= 0:
        raise ArmguardError("--seed", f"is {seed}", expected="0 or more")
    if plots:
        check_plots()
    make_folder(out)
    rows: list[Row] = []
    interrupted = False
    with show_progress() as tell:
        balls, most = (SMALL_BALLS, SMALL_EVALUATIONS) if is_small else (BALLS, MOST_EVALUATIONS)
        try:
            for found in measure_claims(periods or PERIODS, balls, most, seed, tell):
                rows += found
        except KeyboardInterrupt:
            if not rows:
                raise
            interrupted = True
    facts = {"command": f"`{tell_command()}`", **list_facts(seed)}
    write_report(out, rows, interrupted, facts, draw_pictures(rows) if plots else {})
    sys.stdout.write("".join(f"- {line}\n" for line in summarise(rows, interrupted)))
    sys.stdout.write(f"wrote {out / PAGE}\n")
    print_json(lambda: describe(rows, interrupted, facts) | {"wrote": out / PAGE})
    if any(row.unwatched for row in rows):
        complain("a pair came near while it was neither in turn nor flagged: please report it")
        return COMPLAINT
    return 0
