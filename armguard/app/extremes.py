"""`armguard extremes`: what armguard does far away from everyday numbers."""

from __future__ import annotations

import sys
from pathlib import Path

from rich.console import Console
from rich.progress import Progress, TextColumn, TimeElapsedColumn

from armguard.app.processes import COMPLAINT, complain
from armguard.app.study_facts import list_facts, tell_command
from armguard.exceptions import ArmguardError
from armguard.studies.extremes.evaluations import measure_evaluations
from armguard.studies.extremes.line import UNSOUND, Line
from armguard.studies.extremes.report import summarise, write_page
from armguard.studies.extremes.ticks import measure_ticks

CASES = 50
"""Of each line of single evaluations."""


def run(out: Path | None, *, seed: int, is_small: bool) -> int:
    """Measure all cases, and print or write the page; the exit code, 1 if a case is unsound.

    Args:
        out: The page; None: it is printed.
        seed: Of all cases.
        is_small: Whether to leave out what takes long.

    Raises:
        ArmguardError: The page cannot be written.
    """
    if not seed >= 0:
        raise ArmguardError("--seed", f"is {seed}", expected="0 or more")
    if out is not None and (out.is_dir() or not out.parent.is_dir()):
        problem = "is a folder" if out.is_dir() else "is in a folder that is not there"
        raise ArmguardError("--out", f"{out} {problem}", expected="a file to write")
    lines: list[Line] = []
    interrupted = False
    with Progress(
        TextColumn("{task.description}"), TimeElapsedColumn(), console=Console(stderr=True),
        transient=True,
    ) as progress:  # fmt: skip
        bar = progress.add_task("starting")
        try:
            for part in (
                measure_evaluations(10 if is_small else CASES, seed),
                measure_ticks(is_small=is_small, seed=seed),
            ):
                for line in part:
                    lines.append(line)
                    progress.update(bar, description=f"{line.group}: {line.case}")
        except KeyboardInterrupt:
            if not lines:
                raise
            interrupted = True
    facts = [f"{name.capitalize()}: {fact}" for name, fact in list_facts(seed).items()]
    page = write_page(lines, tell_command(), facts)
    if interrupted:
        page = page.replace("\n##", "\nInterrupted: what is missing had not begun.\n\n##", 1)
    if out is None:
        sys.stdout.write(page)
    else:
        try:
            out.write_text(page, encoding="utf-8")
        except OSError as error:
            raise ArmguardError(str(out), f"cannot be written: {error.strerror}") from None
        sys.stdout.write(f"{summarise(lines)}\nwrote {out}\n")
    if any(line.outcome == UNSOUND for line in lines):
        complain("a contact time was later than a contact that is possible: please report it")
        return COMPLAINT
    return 0
