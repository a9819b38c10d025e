"""`armguard paper`: measures the paper's claims about its schedules, with 3 to 100,000 pairs."""

from __future__ import annotations

import sys

from armguard.app import cli
from armguard.app.processes import COMPLAINT, complain
from armguard.app.terminal import print_json
from armguard.exceptions import ArmguardError
from armguard.lab.pages import PAGE, list_lines, make_folder, write_report
from armguard.lab.paper.measure import BALLS, MOST_EVALUATIONS, PERIODS, Row, measure_claims
from armguard.lab.paper.report import describe, write_body
from armguard.lab.study_facts import list_facts, show_progress, tell_command


def run(wishes: cli.Paper) -> int:
    """Measure, write the report and print its summary; the exit code, 1 for an unwatched pair.

    Args:
        wishes: What the command line says.

    Raises:
        ArmguardError: Something is unusable.
        KeyboardInterrupt: It came before there was anything to show.
    """
    out, seed = wishes.out, wishes.seed
    if not seed >= 0:
        raise ArmguardError("--seed", f"is {seed}", expected="0 or more")
    make_folder(out)
    rows: list[Row] = []
    interrupted = False
    with show_progress() as tell:
        try:
            for found in measure_claims(PERIODS, BALLS, MOST_EVALUATIONS, seed, tell):
                rows += found
        except KeyboardInterrupt:
            if not rows:
                raise
            interrupted = True
    facts = {"command": f"`{tell_command()}`", **list_facts(seed)}
    data = describe(rows, interrupted, facts)
    write_report(
        out,
        "What the paper claims of its schedules, measured",
        write_body(rows),
        [f"{name.capitalize()}: {fact}" for name, fact in facts.items()],
        data,
    )
    sys.stdout.write(f"{list_lines(data['summary'])}wrote {out / PAGE}\n")
    print_json(lambda: data | {"wrote": out / PAGE})
    if any(row.unwatched for row in rows):
        complain("a pair came near while it was neither in turn nor flagged: please report it")
        return COMPLAINT
    return 0
