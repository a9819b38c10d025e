"""What work an arm that obeys loses beside recorded people whose bodies yield, in MuJoCo.

    ARMGUARD_RECORDINGS=... python benchmarks/bench_yielding.py --jobs 2 --out table.md

In bench_recordings.py people walk through an arm that stands in their way, and such an arm waits
until they have left. Here MuJoCo moves the arm and each body: a body is a mass in a skin that the
arm pushes aside, and a spring draws it back to where it was recorded (`scene/yielding_people.py`).
Cases, rules and delays are the same; cases in which the arm goes through itself are left out.
Touches are those with bodies that had kept their bounds until then. Beyond a limit are touches that
press harder than the limit permits; without contact limits that is every touch.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import NamedTuple

from bench_recordings import Case, Workplace, make_trajectory
from scene.contestants import Scope
from scene.limited import RULES, find_open_share
from scene.plays import BEGIN, Obeyed
from scene.results import make_table, milliseconds, percent
from scene.short_runs import RATE, USUAL, add_options, list_cases, make_run, place_people
from scene.working_arm import WorkingArm
from scene.yielding_people import Press, PressLog, YieldingPeople


class Score(NamedTuple):
    """What became of one rule in one case."""

    speed: float
    reaction: float
    rule: str
    how: str
    outcome: Obeyed
    free: float
    """Progress along its path of an arm that obeys nobody, in [s]."""

    @property
    def touches(self) -> list[Press]:
        """Those with bodies that had kept their bounds."""
        return [touch for touch in self.outcome.touches if touch.is_promised]


def play(case: Case, scope: Scope, seconds: float) -> list[Score]:
    """One case: an arm obeys all rules, one after the other."""
    workplace = Workplace(make_run(scope, seconds), case.speed)
    trajectory = make_trajectory(workplace.robot, workplace.fraction, case.path, case.seed, seconds)
    people = place_people(case, YieldingPeople, workplace.robot)
    arm = WorkingArm(trajectory)
    duration = min((len(people.ends) - 1) / people.rate, seconds + BEGIN) - BEGIN
    for _ in range(round(duration * RATE)):
        arm.step(1.0 / RATE, True)
    scores = []
    for rule in workplace.rules:
        if rule.name not in RULES:
            continue
        for how in ("obeys", "obeys the scale")[: 2 if rule.has_scale else 1]:
            outcome = workplace.stage.obey(
                people, WorkingArm(trajectory), rule, seconds,
                by_scale=how == "obeys the scale", log=PressLog(people, rule.limits),
            )  # fmt: skip
            reaction = rule.setting.reaction
            scores.append(Score(case.speed, reaction, rule.name, how, outcome, arm.progress))
    return scores


def write_table(scores: list[Score]) -> list[str]:
    """By speed, reaction and rule."""
    rows = []
    keys = dict.fromkeys(score[:4] for score in scores)
    for key in sorted(keys, key=lambda key: (key[1], key[0], RULES.index(key[2]), key[3])):
        speed, reaction, rule, how = key
        some = [score for score in scores if score[:4] == key]
        outcomes = [score.outcome for score in some]
        ticks = sum(one.ticks for one in outcomes)
        touches = [touch for score in some for touch in score.touches]
        shares = [one.energy / one.energy_limit for one in touches if one.energy_limit > 0.0]
        lost = 1.0 - sum(one.progress for one in outcomes) / sum(score.free for score in some)
        rows.append(
            [
                f"{rule}, {how}", f"{speed:g} rad/s", milliseconds(reaction),
                percent(sum(one.stopped for one in outcomes) / ticks),
                percent(find_open_share(outcomes)),
                f"{60.0 * RATE * sum(one.stops for one in outcomes) / ticks:.1f}", percent(lost),
                str(len(touches)), str(sum(touch.is_beyond for touch in touches)),
                f"{max(shares):.2f}" if shares else "–",
                f"{max((one.force for one in touches), default=0.0):.0f} N",
                f"{1e3 * max((one.depth for one in touches), default=0.0):.1f} mm",
                f"{1e3 * max((one.way for one in touches), default=0.0):.0f} mm",
            ]
        )  # fmt: skip
    heads = [
        "rule", "speed", "reaction", "in STOP", "outside blocked time", "stops a minute",
        "work lost", "touches", "beyond a limit", "most energy ÷ limit", "most force", "deepest",
        "pushed",
    ]  # fmt: skip
    return make_table(heads, rows)


def main(arguments: list[str] | None = None) -> list[Score]:
    """Print the table or write it, and return what it was made of."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    add_options(parser, placements=1)
    parser.add_argument("--reactions", type=float, nargs="+", default=[0.02, 0.1], help="[s]")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--out", type=Path, help="file for the table so far, in Markdown")
    options = parser.parse_args(arguments)
    scope = Scope(tuple(options.reactions), (0.0,), (USUAL,))
    cases = [case for speed in options.speeds for case in list_cases(options, speed)]
    scores: list[Score] = []
    for done, some in enumerate(play_all(cases, scope, options.seconds, options.jobs), 1):
        scores += some
        print(f"{done} of {len(cases)} cases{'' if some else ', left out'}", flush=True)
        if options.out:
            text = "\n".join(write_table(scores)) + "\n"
            options.out.write_text(text, encoding="utf-8")
    print("\n".join(write_table(scores)))
    return scores


def play_all(cases: list[Case], scope: Scope, seconds: float, jobs: int) -> Iterator[list[Score]]:
    """What came of each case, in as many processes."""
    given = cases, [scope] * len(cases), [seconds] * len(cases)
    if jobs == 1:
        yield from map(play, *given)
        return
    with ProcessPoolExecutor(jobs) as pool:
        yield from pool.map(play, *given)


if __name__ == "__main__":
    main()
