"""`armguard extremes`: what armguard does far away from everyday numbers."""

from __future__ import annotations

import collections
import sys

from armguard.app import cli
from armguard.app.processes import COMPLAINT, complain
from armguard.app.terminal import print_json
from armguard.exceptions import ArmguardError
from armguard.lab.extremes.line import UNSOUND
from armguard.lab.extremes.report import summarise, write_page
from armguard.lab.extremes.rows import CASES, Extent, measure_rows
from armguard.lab.pages import check_page, write_files
from armguard.lab.study_facts import is_by_rows, list_facts, open_rows, show_progress, tell_command


def run(wishes: cli.Extremes) -> int:
    """Measure all cases, and print or write the page; the exit code, 1 if a case is unsound.

    Args:
        wishes: What the command line says.

    Raises:
        ArmguardError: The page cannot be written, or lines cannot be measured where they are to be.
        KeyboardInterrupt: It came before there was anything to show.
    """
    out, seed = wishes.out, wishes.seed
    if not seed >= 0:
        raise ArmguardError("--seed", f"is {seed}", expected="0 or more")
    if out is not None:
        check_page(out)
    elif is_by_rows(wishes):
        raise ArmguardError("--out", "is needed: lines are kept beside it", expected="a file")
    study = {"study": "extremes", "cases": str(CASES), "seed": str(seed)}
    folder = None if out is None else out.with_name(f"{out.name}.kept")
    with open_rows(wishes, folder, study) as rows, show_progress() as tell:
        lines, is_whole = measure_rows(Extent(seed), rows, tell)
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
        write_files(out.parent, {out.name: page.encode()})
        sys.stdout.write(f"{summarise(lines)}\nwrote {out}\n")
    print_json(lambda: {"is_whole": is_whole, "lines": lines, "facts": facts, "wrote": out})
    if any(line.outcome == UNSOUND for line in lines):
        complain("a contact time was later than a contact that is possible: please report it")
        return COMPLAINT
    return 0
