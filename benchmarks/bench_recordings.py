"""How often each rule stops an arm beside recorded people, what that costs, and what it misses.

    ARMGUARD_RECORDINGS=... python benchmarks/bench_recordings.py --jobs 2 --out docs/usefulness.md
    ARMGUARD_RECORDINGS=... python benchmarks/bench_recordings.py --seconds 3 --placements 1
    --recordings 1

A Panda moves between random points of its workspace, its base at several places at the table where
people were recorded; from the last of these it reaches where they work. First the arm goes on
whatever is said, so that all rules judge the same states. Then it obeys them, one by one: after the
delays its brakes act with the deceleration that they guarantee, and once it may, it returns to its
path. At last it obeys the speed scales too. All of that is done with each of the bounds on people
and with samples of several ages, with clean data and with data as they come, faults included. Rules
with contact limits have tables of their own, with every touch. The page that this writes says how
to read it.

Time is judged at 100 Hz, the rate of the recordings. A rule says STOP by what could happen until
the next tick's STOP would bite, and that time is kept the same at every rate; at 200 Hz and at
1 kHz the shares of time are the same within a tenth of themselves.
"""

from __future__ import annotations

import argparse
import itertools
import os
import shlex
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rich.progress import Progress

from armguard.lab.simulation import JointTrajectory, keeps_within, random_trajectory
from armguard.robot import Robot
from scene.contestants import NOT_OBEYED, Scope, make_rules
from scene.long_tables import write_with_tables
from scene.machine import describe_machine
from scene.plays import Judged, Obeyed, Stage
from scene.recorded_people import People
from scene.results import Found
from scene.self_contact import meets_itself
from scene.stop_rules import Rule
from scene.usefulness import write_page
from scene.working_arm import WorkingArm

BOUNDS = {"10 m/s², 2 m/s": (10.0, 2.0), "by body part": None}
# Of the arm's base at the recordings' table: x and y in [m], and which way it faces, in degrees.
PLACEMENTS = ((-0.2, 0.2, -90.0), (0.0, 0.7, -90.0), (-0.9, 0.7, -50.0), (0.0, 1.1, -90.0))
WORKSPACE = ([-0.3, -0.6, 0.0], [0.75, 0.6, 1.2])  # of all moving links, before the base, [m]
TRAJECTORY = 30.0  # [s], before it starts again
NEXT_SEED = 10_000  # so much further is what takes the place of one through the arm itself
PRICE_RATE, PRICE_SECONDS = 1000.0, 3.0  # of the run in which ticks are timed, [Hz] and [s]
ACCELERATION = 0.125  # of the acceleration limits, at most, along the trajectory


class Case(NamedTuple):
    """One recording, seen from one place of the arm's base, and what the arm does meanwhile."""

    speed: float
    """Of the fastest joint, in [rad]/[s]."""
    path: Path
    placement: int
    seed: int


class Run(NamedTuple):
    """What all cases have in common."""

    scope: Scope
    obeys: bool
    """Whether the arm obeys as well."""
    rate: float
    seconds: float


def find_recordings() -> list[Path]:
    """Files of recordings; ends the program where there are none."""
    default = Path(__file__).parents[1] / ".." / "shared" / "data" / "human-motion"
    folder = Path(os.environ.get("ARMGUARD_RECORDINGS", default))
    paths = sorted(folder.glob("*.csv"))
    if not paths:
        sys.exit(f"no recordings in {folder}: set ARMGUARD_RECORDINGS to the folder of their .csv")
    return paths


def place_base(x: float, y: float, degrees: float) -> np.ndarray:
    """The recordings' origin, as seen from the arm's base. Shape (4, 4)."""
    angle = np.radians(degrees)
    rotation = np.array(
        [[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0, 0, 1]]
    )
    placement = np.eye(4)
    placement[:3, :3] = rotation.T
    placement[:3, 3] = -rotation.T @ np.array([x, y, 0.0])
    return placement


def make_trajectory(
    robot: Robot, fraction: float, path: Path, seed: int, seconds: float
) -> JointTrajectory:
    """What an arm does beside a recording: of random trajectories the first without itself.

    Random ones are not planned around the arm, and no real arm can go through itself.

    Args:
        robot: The arm.
        fraction: Of its velocity limits, that trajectories use at most.
        path: Of the recording.
        seed: Number of the trajectory beside it.
        seconds: For which the arm is to follow it, in [s].
    """
    share = ACCELERATION * robot.acceleration_limit / robot.braking_deceleration
    acceleration = min(1.0, float(share.min()))
    first = 100 * seed + find_recordings().index(path)
    accept = keeps_within(robot, *WORKSPACE)
    for number in itertools.count(first, NEXT_SEED):
        trajectory = random_trajectory(
            robot,
            number,
            TRAJECTORY,
            speed_fraction=fraction,
            acceleration_fraction=acceleration,
            accept=accept,
        )
        if not meets_itself(trajectory, seconds):
            break
    return trajectory


class Workplace:
    """An arm with the rules that judge it at one speed, which serve one case after the other.

    Args:
        run: What all cases have in common.
        speed: Of the fastest joint, in [rad]/[s].

    Attributes:
        fraction: What trajectories use of the velocity limits at most.
        rules: All that judge a case.
    """

    def __init__(self, run: Run, speed: float) -> None:
        self.robot = robot = Robot.load("panda")
        self._run, period = run, 1.0 / run.rate
        self.fraction = speed / float(np.max(robot.velocity_limit))
        self.stage = Stage(robot, period)
        self.rules = [
            rule
            for setting in run.scope.settings()
            for rule in make_rules(robot, self.fraction, run.scope, setting, period)
        ]

    def play(self, case: Case, people: People) -> Iterator[Found]:
        """One case: all rules judge it, then they are obeyed one by one."""
        run = self._run
        trajectory = make_trajectory(self.robot, self.fraction, case.path, case.seed, run.seconds)

        def found(rule: Rule, how: str, outcome: Judged | Obeyed) -> Found:
            where = people.name, case.placement, case.seed
            return Found(case.speed, rule.name, rule.setting, how, *where, outcome)

        judged = self.stage.judge(people, WorkingArm(trajectory), self.rules, run.seconds)
        for rule, outcome in zip(self.rules, judged, strict=True):
            yield found(rule, "goes on", outcome)
        for rule in self.rules:
            if not run.obeys or rule.name in NOT_OBEYED:
                continue
            has_scale = rule.has_scale and rule.clean and run.scope.is_usual(rule.setting)
            for how in ("obeys", "obeys the scale")[: 2 if has_scale else 1]:
                arm, by_scale = WorkingArm(trajectory), how == "obeys the scale"
                obeyed = self.stage.obey(people, arm, rule, run.seconds, by_scale=by_scale)
                yield found(rule, how, obeyed)


_workplaces: dict[float, Workplace] = {}
_people: dict[tuple[Path, int], People] = {}


def play_case(run: Run, case: Case) -> list[Found]:
    """One case, with what this process has made for earlier ones."""
    if case.speed not in _workplaces:
        _workplaces[case.speed] = Workplace(run, case.speed)
    place = case.path, case.placement
    if place not in _people:
        bounds = {name: BOUNDS[name] for name in run.scope.bounds}
        _people[place] = People(case.path, place_base(*PLACEMENTS[case.placement]), bounds)
    return list(_workplaces[case.speed].play(case, _people[place]))


def play_all(run: Run, cases: list[Case], jobs: int) -> list[Found]:
    """All cases, in as many processes; says how far it is."""
    found: list[Found] = []
    with Progress(transient=True) as progress:
        task = progress.add_task("beside recorded people", total=len(cases))
        if jobs == 1:
            for case in cases:
                found += play_case(run, case)
                progress.advance(task)
            return found
        with ProcessPoolExecutor(jobs) as pool:
            for some in pool.map(play_case, [run] * len(cases), cases):
                found += some
                progress.advance(task)
    return found


def read_options(arguments: list[str] | None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    some = {"type": float, "nargs": "+"}
    parser.add_argument("--speeds", default=[0.3, 0.8], help="of the fastest joint [rad/s]", **some)
    parser.add_argument("--reactions", default=[0.02, 0.1], help="of the brakes [s]", **some)
    parser.add_argument(
        "--cameras", default=[0.0, 0.05, 0.1], help="age of new samples [s]", **some
    )
    parser.add_argument(
        "--bounds", nargs="+", choices=list(BOUNDS), default=list(BOUNDS), help="on people"
    )
    parser.add_argument("--rate", type=float, default=100.0, help="ticks a second")
    parser.add_argument("--seconds", type=float, default=8.0, help="of each recording, at most")
    parser.add_argument("--placements", type=int, default=4, help=f"at most {len(PLACEMENTS)}")
    parser.add_argument("--seeds", type=int, default=1, help="trajectories beside each recording")
    parser.add_argument("--recordings", type=int, default=None, help="only so many of them")
    parser.add_argument("--jobs", type=int, default=1, help="processes; they spoil prices")
    parser.add_argument(
        "--out", type=Path, help="page to write, with tables beside it; default: print it"
    )
    return parser.parse_args(arguments)


def main(arguments: list[str] | None = None) -> list[Found]:
    """Play all cases, and print or write the page; all that was found."""
    options = read_options(arguments)
    paths = find_recordings()[: options.recordings]
    scope = Scope(tuple(options.reactions), tuple(options.cameras), tuple(options.bounds))
    run = Run(scope, True, options.rate, options.seconds)
    cases = [
        Case(speed, path, placement, seed)
        for speed in options.speeds
        for path in paths
        for placement in range(min(options.placements, len(PLACEMENTS)))
        for seed in range(options.seeds)
    ]
    found = play_all(run, cases, options.jobs)
    usual = Scope(scope.reactions[:1], scope.cameras[:1], scope.bounds[:1])
    paced = run._replace(
        scope=usual, obeys=False, rate=PRICE_RATE, seconds=min(PRICE_SECONDS, run.seconds)
    )
    _workplaces.clear()
    priced = play_all(paced, [Case(speed, paths[0], 0, 0) for speed in options.speeds], 1)
    words = shlex.join(sys.argv[1:] if arguments is None else arguments)
    command = f"python benchmarks/bench_recordings.py {words}".strip()
    machine = describe_machine(load=False)
    page, tables = write_page(found, priced, scope, options.rate, command, machine)
    if options.out is None:
        print(page)
    else:
        write_with_tables(page, tables, options.out)
        print(f"wrote {options.out}")
    return found


if __name__ == "__main__":
    main()
