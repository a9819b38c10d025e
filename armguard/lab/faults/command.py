"""`armguard faults`: runs the campaign, shows its progress and its results."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from armguard.app.terminal import make_console, print_json
from armguard.lab.faults.campaign import run_campaign
from armguard.lab.faults.catalogue import choose_faults
from armguard.lab.faults.report import (
    COLUMNS,
    describe,
    draw_table,
    list_cells,
    write_page,
)
from armguard.lab.pages import check_page, name_table, write_csv, write_files
from armguard.lab.study_facts import show_progress
from armguard.recording.recorder import check_installed

FAILED = 1
"""Exit code of a campaign in which something was not as it must be."""


def run_faults(only: Sequence[str], out: Path | None) -> int:
    """Make faults, and tell what came of them.

    Args:
        only: Names or patterns of faults; empty: all.
        out: The page to write; None: none.

    Returns:
        0 where every fault that could be tried was detected if it has to be, the cell recovered
        from each, nobody was touched and the control was; else 1, and where none could be tried.

    Raises:
        ArmguardError: No such fault, a page that cannot be written, packages that are missing, or
            a cell that does not start.
    """
    faults = choose_faults(only)
    check_installed()
    if out is not None:
        check_page(out)
    with show_progress() as tell:
        report = run_campaign(faults, tell)
    if out is not None:
        table = name_table(out).name
        rows = write_csv(COLUMNS, map(list_cells, report.outcomes))
        write_files(out.parent, {out.name: write_page(report, table).encode(), table: rows})
    make_console().print(draw_table(report))
    print_json(lambda: describe(report))
    return 0 if report.passed else FAILED
