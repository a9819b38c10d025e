"""`armguard extremes`: tests armguard with extreme numbers."""

from __future__ import annotations

import sys

from armguard.app import cli
from armguard.app.processes import COMPLAINT, complain
from armguard.app.terminal import print_json
from armguard.exceptions import ArmguardError
from armguard.lab.extremes.evaluations import Evaluations, list_evaluations
from armguard.lab.extremes.report import HEADS, UNSOUND, Line, list_rows, summarise, write_page
from armguard.lab.extremes.ticks import Case, list_cases
from armguard.lab.pages import check_page, name_table, write_csv, write_files
from armguard.lab.study_facts import Tell, list_facts, show_progress, tell_command


def run(wishes: cli.Extremes) -> int:
    """Measure all cases, and print or write the page; the exit code, 1 if a case is unsound.

    Args:
        wishes: What the command line says.

    Raises:
        ArmguardError: The page cannot be written.
        KeyboardInterrupt: It came before there was anything to show.
    """
    out, seed = wishes.out, wishes.seed
    if not seed >= 0:
        raise ArmguardError("--seed", f"is {seed}", expected="0 or more")
    if out is not None:
        check_page(out)
    lines: list[Line] = []
    is_whole = True
    with show_progress() as tell:
        try:
            measure_all(seed, lines, tell)
        except KeyboardInterrupt:
            is_whole = False
    if not lines:
        raise KeyboardInterrupt
    facts = [f"{name.capitalize()}: {fact}" for name, fact in list_facts(seed).items()]
    table = "" if out is None else name_table(out).name
    page = write_page(lines, tell_command(), facts, is_whole=is_whole, table=table)
    if out is None:
        sys.stdout.write(page)
    else:
        files = {out.name: page.encode(), table: write_csv(HEADS, list_rows(lines))}
        write_files(out.parent, files)
        sys.stdout.write(f"{summarise(lines)}\nwrote {out}\n")
    print_json(lambda: {"is_whole": is_whole, "lines": lines, "facts": facts, "wrote": out})
    if any(line.outcome == UNSOUND for line in lines):
        complain("a contact time was later than a contact that is possible: please report it")
        return COMPLAINT
    return 0


def measure_all(seed: int, lines: list[Line], tell: Tell) -> None:
    """Add the lines of all cases, in their order."""
    cases: list[Evaluations | Case] = [*list_evaluations(), *list_cases()]
    for number, case in enumerate(cases):
        tell(f"{case.group}: {case.name}", number / len(cases))
        lines.append(case.measure(seed))
