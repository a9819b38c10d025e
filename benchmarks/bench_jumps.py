"""What it costs to count a body that broke its bounds with wider ones: by factor and by time.

    ARMGUARD_RECORDINGS=... python benchmarks/bench_jumps.py
    ARMGUARD_RECORDINGS=... python benchmarks/bench_jumps.py --counts 1.5,2 1,2 --placements 1

Cases are those of bench_recordings.py, data as they come, with 20 ms of reaction: an arm goes on
whatever is said. `BROKEN_FACTOR` and `BROKEN_FOR` of `armguard.obstacles.broken_bounds` are
compiled into kernels, so each pair of them is measured with a copy of the package that has them. To
compile one takes a minute or more.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path

from armguard.obstacles.broken_bounds import BROKEN_FACTOR, BROKEN_FOR
from bench_recordings import Workplace
from scene.contestants import AS_THEY_COME, OPERATING, SEPARATION, TETHERED, Scope, make_operating
from scene.plays import Judged
from scene.recorded_people import People
from scene.results import make_table, multiple, percent
from scene.short_runs import RATE, USUAL, add_options, list_cases, make_run, place_people
from scene.stop_rules import FAULT_KINDS, MonitorRule, Oracle, Separation, Setting

ROOT = Path(__file__).parents[1]
SETTING = Setting(reaction=0.02, camera=0.0, bounds=USUAL)
NO_RULES = Scope((), (), ())  # of the general comparison
RULES = (OPERATING + AS_THEY_COME, OPERATING + TETHERED)
COUNTS = ("1.5,2", "1,2", "1.5,0.5", "1.5,4", "2,2")


def measure(options: argparse.Namespace) -> dict[str, Counter[str]]:
    """Ticks by rule: all, those in STOP, by cause, and missed; with the package that is loaded."""
    found = {rule: Counter[str]() for rule in (SEPARATION, *RULES)}
    for speed in options.speeds:
        workplace = Workplace(make_run(NO_RULES, options.seconds), speed)
        given = workplace.robot, SETTING, 1.0 / RATE
        operating = make_operating(workplace.robot, workplace.fraction)
        plain, tethered = RULES
        workplace.rules = [
            Oracle(*given, "oracle"),
            Separation(*given, SEPARATION, clean=False),
            MonitorRule(*given, plain, clean=False, operating=operating),
            MonitorRule(*given, tethered, clean=False, tied="anybody", operating=operating),
        ]
        for case in list_cases(options, speed):
            for one in workplace.play(case, place_people(case, People)):
                outcome = one.outcome
                if one.rule not in found or not isinstance(outcome, Judged):
                    continue
                sums = {"ticks": outcome.ticks, "stopped": outcome.stopped}
                sums |= {"needed": outcome.needed, "missed": outcome.missed}
                sums |= {"hidden": outcome.hidden, "beyond": outcome.beyond}
                found[one.rule].update(sums | outcome.causes)
    return found


def copy_package(factor: float, lasting: float, place: Path) -> None:
    """Lay a copy of armguard into a folder, with another factor and time in [s]."""
    shutil.copytree(
        ROOT / "armguard", place / "armguard", ignore=shutil.ignore_patterns("__pycache__")
    )
    for path in ("robots", "pyproject.toml"):
        (place / path).symlink_to(ROOT / path)
    module = place / "armguard" / "obstacles" / "broken_bounds.py"
    text = module.read_text(encoding="utf-8")
    for name, value in (("BROKEN_FACTOR", factor), ("BROKEN_FOR", lasting)):
        text, count = re.subn(rf"^{name} = .*$", f"{name} = {value}", text, flags=re.MULTILINE)
        assert count == 1, name
    module.write_text(text, encoding="utf-8")


def measure_copy(counts: str, words: list[str]) -> dict[str, Counter[str]]:
    """The same with another factor and time, in a process of its own.

    Args:
        counts: Factor and time in [s], with a comma between.
        words: Of the command line, for the process.
    """
    factor, lasting = map(float, counts.split(","))
    if (factor, lasting) == (BROKEN_FACTOR, BROKEN_FOR):
        return measure(read_options(words))
    with tempfile.TemporaryDirectory() as folder:
        copy_package(factor, lasting, Path(folder))
        command = [sys.executable, str(Path(__file__)), *words, "--measure"]
        told = subprocess.run(
            command, env=os.environ | {"PYTHONPATH": folder}, check=True, stdout=subprocess.PIPE
        ).stdout
    ours, *found = json.loads(told)
    assert ours == [factor, lasting], "another armguard was loaded"
    return {rule: Counter(counts) for rule, counts in found[0].items()}


def write_table(found: dict[str, dict[str, Counter[str]]]) -> list[str]:
    """By factor and time, for each rule; the multiple is that of the separation distance."""
    rows = []
    for counts, by_rule in found.items():
        factor, lasting = counts.split(",")
        rival = by_rule[SEPARATION]
        for rule in RULES:
            one = by_rule[rule]
            share, rivals = one["stopped"] / one["ticks"], rival["stopped"] / rival["ticks"]
            missed = ", ".join(str(one[name]) for name in ("missed", "hidden", "beyond"))
            cells = [factor, f"{lasting} s", "no" if rule == RULES[0] else "yes"]
            cells += [percent(share), multiple(share / rivals if rivals else float("nan"))]
            cells += [percent(one[kind.text] / one["ticks"]) for kind in FAULT_KINDS[:3]]
            rows.append([*cells, f"{missed} of {one['needed']}"])
    heads = ["factor", "for", "tethers", "STOP", "of separation distance"]
    heads += [kind.text for kind in FAULT_KINDS[:3]]
    return make_table([*heads, "missed, hidden, beyond"], rows)


def read_options(words: list[str] | None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--counts", nargs="+", default=COUNTS, help="factor,time [s] in turns")
    parser.add_argument("--measure", action="store_true", help="this package alone; prints JSON")
    add_options(parser, placements=4)
    return parser.parse_args(words)


def main(arguments: list[str] | None = None) -> dict[str, dict[str, Counter[str]]]:
    """Print the table, and return what it was made of."""
    words = sys.argv[1:] if arguments is None else arguments
    options = read_options(words)
    if options.measure:
        print(json.dumps([[BROKEN_FACTOR, BROKEN_FOR], measure(options)]))
        return {}
    found = {}
    for counts in options.counts:
        found[counts] = measure_copy(counts, words)
        print(f"measured {counts}", file=sys.stderr)
    print("\n".join(write_table(found)))
    return found


if __name__ == "__main__":
    main()
