"""What it costs to count the person's own speed in contact limits: time in STOP by `person_speed`.

    ARMGUARD_RECORDINGS=... python benchmarks/bench_person_speed.py

Cases are those of bench_recordings.py, with 20 ms of reaction: an arm goes on whatever is said, so
all rules judge the same states. The limits of `scene/example_limits.py` are stated with each
`person_speed` in turn. Cases in which the arm goes through itself are left out. Shares are of the
time in which no recorded body is inside the arm's cover, as on the page that bench_recordings.py
writes.
"""

from __future__ import annotations

import argparse
from typing import Any, NamedTuple

from rich.progress import track

from armguard.robot import Robot
from bench_recordings import Case, Run, Workplace
from scene.contestants import OPERATING, PIECES, SEPARATION, WITH_LIMITS, Scope, make_operating
from scene.example_limits import PersonSpeed, make_limits
from scene.limited import find_open_share
from scene.plays import Judged, Obeyed
from scene.recorded_people import People
from scene.results import make_table, percent
from scene.short_runs import RATE, USUAL, add_options, list_cases, make_run, place_people
from scene.stop_rules import MonitorRule, PieceRule, Rule, Separation, Setting

SETTING = Setting(reaction=0.02, camera=0.0, bounds=USUAL)
NO_RULES = Scope((), (), ())  # of the general comparison


class Score(NamedTuple):
    """What became of one rule in one case."""

    rule: str
    person_speed: str
    """As limits state it; a dash for a rule without limits."""
    allowed: str
    """How fast a surface may be that touches a hand, and a chest, in [m]/[s]."""
    speed: float
    """Of the fastest joint, in [rad]/[s]."""
    outcome: Judged | Obeyed


def read_person_speed(text: str) -> PersonSpeed:
    """As the command line has it."""
    return "own" if text == "own" else float(text)


def make_rules(
    robot: Robot, fraction: float, person_speeds: list[PersonSpeed]
) -> dict[tuple[str, str, str], Rule]:
    """All rules, by their first cells in the table.

    Args:
        robot: The arm.
        fraction: What its trajectories use of the velocity limits at most.
        person_speeds: What limits are stated with.
    """
    given = robot, SETTING, 1.0 / RATE
    operating = make_operating(robot, fraction)
    rules: dict[tuple[str, str, str], Rule] = {
        (SEPARATION, "–", "–"): Separation(*given, SEPARATION)
    }
    for name in (OPERATING + WITH_LIMITS, PIECES + WITH_LIMITS):
        for person_speed in person_speeds:
            limits = make_limits(person_speed)
            options: dict[str, Any] = {"operating": operating, "contact_limits": limits}
            allowed = ", ".join(
                f"{limits.by_region[region].max_speed:.2f}" for region in ("hand", "chest")
            )
            rules[name, f"{person_speed}", allowed] = (
                MonitorRule(*given, name, **options)
                if name.startswith(OPERATING)
                else PieceRule(*given, name, motion="planned", **options)
            )
    return rules


def play(
    run: Run, speed: float, cases: list[Case], person_speeds: list[PersonSpeed]
) -> list[Score]:
    """All cases of one speed; nothing of those in which the arm goes through itself."""
    workplace = Workplace(run, speed)
    rules = make_rules(workplace.robot, workplace.fraction, person_speeds)
    workplace.rules = list(rules.values())
    scores = []
    for case in track(cases, f"{speed:g} rad/s", transient=True):
        found_by_rule = workplace.play(case, place_people(case, People))
        for cells, found in zip(rules, found_by_rule, strict=True):
            scores.append(Score(*cells, speed, found.outcome))
    return scores


def write_table(scores: list[Score]) -> list[str]:
    """By rule and what is counted of the person's speed."""
    speeds = list(dict.fromkeys(score.speed for score in scores))
    rows = []
    for cells in dict.fromkeys(score[:3] for score in scores):
        some = [score for score in scores if score[:3] == cells]
        shares = [
            find_open_share(one.outcome for one in some if one.speed == speed) for speed in speeds
        ]
        rows.append([*cells, *map(percent, shares)])
    heads = ["rule", "`person_speed` [m/s]", "limit of hand, chest [m/s]"]
    heads += [f"{speed:g} rad/s" for speed in speeds]
    return make_table(heads, rows)


def main(arguments: list[str] | None = None) -> list[Score]:
    """Print the table, and return what it was made of."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--person-speeds", type=read_person_speed, nargs="+", default=["own", 0.5, 1.0, 2.0],
        help="own, or in [m/s]",
    )  # fmt: skip
    add_options(parser, placements=2)
    options = parser.parse_args(arguments)
    run = make_run(NO_RULES, options.seconds)
    scores = []
    for speed in options.speeds:
        scores += play(run, speed, list_cases(options, speed), options.person_speeds)
    print("\n".join(write_table(scores)))
    return scores


if __name__ == "__main__":
    main()
