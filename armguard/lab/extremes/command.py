"""`armguard extremes`: what armguard does far away from everyday numbers."""

from __future__ import annotations

import collections
import sys
from pathlib import Path

from armguard.app.processes import COMPLAINT, complain
from armguard.app.terminal import print_json
from armguard.exceptions import ArmguardError
from armguard.lab.extremes.evaluations import list_evaluations, measure_evaluations
from armguard.lab.extremes.line import UNSOUND, Line
from armguard.lab.extremes.report import summarise, write_page
from armguard.lab.extremes.rows import Extent, measure_rows
from armguard.lab.extremes.ticks import list_cases, measure_ticks
from armguard.lab.rows import Tell
from armguard.lab.study_facts import Workers, list_facts, open_rows, show_progress, tell_command

CASES = 50
"""Of each line of single evaluations."""


def run(out: Path | None, *, seed: int, is_small: bool, workers: Workers) -> int:
    """Measure all cases, and print or write the page; the exit code, 1 if a case is unsound.

    Args:
        out: The page; None: it is printed.
        seed: Of all cases.
        is_small: Whether to leave out what takes long.
        workers: Where cases are measured.

    Raises:
        ArmguardError: The page cannot be written, or lines cannot be measured where they are to be.
        KeyboardInterrupt: It came before there was anything to show.
    """
    if not seed >= 0:
        raise ArmguardError("--seed", f"is {seed}", expected="0 or more")
    if out is not None and (out.is_dir() or not out.parent.is_dir()):
        problem = "is a folder" if out.is_dir() else "is in a folder that is not there"
        raise ArmguardError("--out", f"{out} {problem}", expected="a file to write")
    cases = 10 if is_small else CASES
    study = {"study": "extremes", "cases": str(cases), "small": str(is_small), "seed": str(seed)}
    if workers.is_by_rows and out is None:
        raise ArmguardError("--out", "is needed: lines are kept beside it", expected="a file")
    folder = None if out is None else out.with_name(f"{out.name}.kept")
    with open_rows(workers, folder, study) as rows, show_progress() as tell:
        if rows is None:
            lines, is_whole = _measure_here(cases, seed, is_small, tell)
        else:
            lines, is_whole = measure_rows(Extent(cases, seed, is_small), rows, tell)
    if not lines:
        raise KeyboardInterrupt
    facts = [f"{name.capitalize()}: {fact}" for name, fact in list_facts(seed).items()]
    machines = collections.Counter(line.machine for line in lines if line.machine)
    if machines:
        counted = (f"{count} lines on {machine}" for machine, count in sorted(machines.items()))
        facts.append(f"Measured: {', '.join(counted)}")
    page = write_page(lines, tell_command(), facts)
    if not is_whole:
        page = page.replace("\n##", "\nInterrupted: what is missing had not begun.\n\n##", 1)
    if out is None:
        sys.stdout.write(page)
    else:
        try:
            out.write_text(page, encoding="utf-8")
        except OSError as error:
            raise ArmguardError(str(out), f"cannot be written: {error.strerror}") from None
        sys.stdout.write(f"{summarise(lines)}\nwrote {out}\n")
    print_json(lambda: {"is_whole": is_whole, "lines": lines, "facts": facts, "wrote": out})
    if any(line.outcome == UNSOUND for line in lines):
        complain("a contact time was later than a contact that is possible: please report it")
        return COMPLAINT
    return 0


def _measure_here(cases: int, seed: int, is_small: bool, tell: Tell) -> tuple[list[Line], bool]:
    """Measure one line after the other; what Ctrl-C left of them, and whether none is missing."""
    lines: list[Line] = []
    count = len(list_evaluations()) + len(list_cases(is_small=is_small))
    try:
        for part in (
            measure_evaluations(cases, seed),
            measure_ticks(is_small=is_small, seed=seed),
        ):
            for line in part:
                lines.append(line)
                tell(f"{line.group}: {line.case}", len(lines) / count)
    except KeyboardInterrupt:
        return lines, False
    return lines, True
