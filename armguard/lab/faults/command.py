"""`armguard faults`: makes the campaign, shows how far it is, and what it found."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from armguard.exceptions import ArmguardError
from armguard.lab.faults.campaign import run_campaign
from armguard.lab.faults.catalogue import choose_faults
from armguard.lab.faults.report import describe, draw_table, write_page
from armguard.recording.recorder import check_installed

FAILED = 1
"""Exit code of a campaign in which something was not as it must be."""


def check_page(out: Path) -> None:
    """Refuse a page that cannot be written now, not after minutes; what stands in it stays.

    Raises:
        ArmguardError: It is a folder or in none, or may not be written.
    """
    try:
        is_new = not out.exists()
        out.open("a").close()
        if is_new:
            out.unlink()  # a campaign that comes to no end leaves no page
    except OSError as error:
        raise ArmguardError(
            str(out),
            f"cannot be written ({error.strerror})",
            expected="a file in a folder that is, such as faults.md",
        ) from None


def run_faults(
    only: Sequence[str],
    out: Path | None,
    print_json: Callable[[Callable[[], object]], None],
) -> int:
    """Make faults, and tell what came of them.

    Args:
        only: Names or patterns of faults; empty: all.
        out: The page to write; None: none.
        print_json: Takes what gives the report as plain data, for programs.

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
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), MofNCompleteColumn())
    with Progress(
        *columns, TimeElapsedColumn(), console=Console(stderr=True, markup=False)
    ) as progress:
        task = progress.add_task("starting", total=len(faults))

        def tell(text: str, done: int) -> None:
            progress.update(task, description=text, completed=done)

        report = run_campaign(faults, tell)
    if out is not None:
        try:
            out.write_text(write_page(report), encoding="utf-8")
        except OSError as error:
            raise ArmguardError(str(out), f"cannot be written ({error.strerror})") from None
    Console(markup=False, highlight=False).print(draw_table(report))
    print_json(lambda: describe(report))
    return 0 if report.passed else FAILED
