"""What work an arm that obeys loses beside recorded people whose bodies yield.

    ARMGUARD_RECORDINGS=... python benchmarks/bench_yielding.py --seconds 8

In bench_recordings.py people walk through an arm that stands in their way, and such an arm waits
until they have left. Here each body is a mass behind a skin that the arm's cover pushes aside, and
a spring draws it back to where it was recorded (`scene/yielding_people.py`). Cases, rules and
delays are the same; cases in which the arm goes through itself are left out. Touches are those with
bodies that had kept their bounds until then. Beyond a limit are touches of a surface that is
faster; without contact limits that is every touch.
"""

from __future__ import annotations

import argparse
from concurrent.futures import ProcessPoolExecutor
from typing import NamedTuple

from bench_recordings import (
    BOUNDS,
    PLACEMENTS,
    Case,
    Run,
    Workplace,
    find_recordings,
    make_trajectory,
    place_base,
)
from scene.contestants import Scope
from scene.limited import RULES, find_open_share
from scene.plays import BEGIN, Obeyed
from scene.results import make_table, milliseconds, percent
from scene.working_arm import WorkingArm
from scene.yielding_people import YieldingPeople

RATE = 100.0  # of ticks, [Hz]


class Score(NamedTuple):
    """What became of one rule in one case."""

    speed: float
    reaction: float
    rule: str
    how: str
    outcome: Obeyed
    free: float
    """Progress along its path of an arm that obeys nobody, in [s]."""


def play(case: Case, scope: Scope, seconds: float) -> list[Score]:
    """One case: an arm obeys all rules, one after the other."""
    workplace = Workplace(Run(scope, (), 0, RATE, seconds), case.speed)
    trajectory = make_trajectory(workplace.robot, workplace.fraction, case.path, case.seed, seconds)
    people = YieldingPeople(
        case.path,
        place_base(*PLACEMENTS[case.placement]),
        {name: BOUNDS[name] for name in scope.bounds},
    )
    arm = WorkingArm(trajectory)
    duration = min((len(people.ends) - 1) / people.rate, seconds + BEGIN) - BEGIN
    for _ in range(round(duration * RATE)):
        arm.step(1.0 / RATE, True)
    scores = []
    for rule in workplace.rules:
        if rule.name not in RULES:
            continue
        for how in ("obeys", "obeys the scale")[: 2 if rule.has_scale else 1]:
            by_scale = how == "obeys the scale"
            outcome = workplace.stage.obey(
                people, WorkingArm(trajectory), rule, seconds, by_scale=by_scale
            )
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
        touches = [touch for one in outcomes for touch in one.touches if touch.is_promised]
        lost = 1.0 - sum(one.progress for one in outcomes) / sum(score.free for score in some)
        rows.append(
            [
                f"{rule}, {how}", f"{speed:g} rad/s", milliseconds(reaction),
                percent(sum(one.stopped for one in outcomes) / ticks),
                percent(find_open_share(outcomes)),
                f"{60.0 * RATE * sum(one.stops for one in outcomes) / ticks:.1f}", percent(lost),
                str(len(touches)), str(sum(touch.is_beyond for touch in touches)),
                f"{1e3 * max((touch.depth for touch in touches), default=0.0):.1f} mm",
            ]
        )  # fmt: skip
    heads = [
        "rule", "speed", "reaction", "in STOP", "outside blocked time", "stops a minute",
        "work lost", "touches", "beyond a limit", "deepest",
    ]  # fmt: skip
    return make_table(heads, rows)


def main(arguments: list[str] | None = None) -> list[Score]:
    """Print the table, and return what it was made of."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--speeds", type=float, nargs="+", default=[0.3, 0.8], help="[rad/s]")
    parser.add_argument("--reactions", type=float, nargs="+", default=[0.02, 0.1], help="[s]")
    parser.add_argument("--seconds", type=float, default=8.0, help="of each recording, at most")
    parser.add_argument("--placements", type=int, default=1, help=f"at most {len(PLACEMENTS)}")
    parser.add_argument("--recordings", type=int, default=None, help="only so many of them")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    options = parser.parse_args(arguments)
    scope = Scope(tuple(options.reactions), (0.0,), (next(iter(BOUNDS)),))
    cases = [
        Case(speed, path, placement, 0)
        for speed in options.speeds
        for path in find_recordings()[: options.recordings]
        for placement in range(options.placements)
    ]
    count = len(cases)
    given = cases, [scope] * count, [options.seconds] * count
    if options.jobs == 1:
        scores = [score for some in map(play, *given) for score in some]
    else:
        with ProcessPoolExecutor(options.jobs) as pool:
            scores = [score for some in pool.map(play, *given) for score in some]
    print("\n".join(write_table(scores)))
    return scores


if __name__ == "__main__":
    main()
