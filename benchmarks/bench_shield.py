"""What a shield gets done beside recorded people, and how smoothly, beside rules that stop an arm.

    ARMGUARD_RECORDINGS=... python benchmarks/bench_shield.py --out docs/shield_figures.md
    ARMGUARD_RECORDINGS=... python benchmarks/bench_shield.py --seconds 2 --placements 1
    --recordings 1

A Panda is to follow trajectories beside recorded people, as in `bench_recordings.py`. A shield
moves it, with several times to look ahead, and with contact limits. In the same run the arm obeys
levels, levels and the speed scale, pieces with their own stop, the separation distance, and one
that knows the future; and it is moved by failsafe motions that are verified at sampled instants.
"""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rich.progress import Progress

import bench_recordings as recorded
from armguard.lab.simulation import JointTrajectory
from armguard.robot import Robot
from armguard.robot.brakes import find_gentlest_stop
from armguard.shield import MotionLimits
from scene.clearance import Leaves
from scene.contestants import make_operating
from scene.example_limits import LIMITS
from scene.failsafe import OWN_BRAKING, OWN_JERK, FailsafeMover
from scene.long_tables import write_with_tables
from scene.machine import describe_machine
from scene.plays import Obeyed, Stage
from scene.recorded_people import People
from scene.shield_page import Outcome, Row, write_page
from scene.shielded import LISTEN, ExactArm, Mover, Shielded, ShieldMover, play
from scene.stop_rules import MonitorRule, Oracle, PieceRule, Rule, Separation, Setting
from scene.working_arm import WorkingArm

JERK = 500.0  # of all joints, [rad/s³]
LOOK_AHEADS = (0.0, 0.03, 0.06, 0.1)  # [s]
USUAL = 0.03  # [s], as a shield takes it by default
PERIOD = 0.01  # of steps beside recordings, [s]
FAST_PERIOD = 0.004  # of the run in which steps are timed, [s]
ONE, PARTS = "10 m/s², 2 m/s", "by body part"


class Case(NamedTuple):
    """One recording, seen from one place of the arm's base, at one speed of the arm."""

    speed: float
    path: Path
    placement: int


class Run(NamedTuple):
    """What all cases have in common."""

    seconds: float
    reactions: tuple[float, ...]
    ages: tuple[float, ...]


def list_settings(run: Run) -> list[Setting]:
    """The usual one at every reaction; bounds by body part at every age."""
    usual = [Setting(reaction, 0.0, ONE) for reaction in run.reactions]
    return usual + [Setting(run.reactions[0], age, PARTS) for age in run.ages]


class Workplace:
    """An arm, and all that moves or judges it at one speed.

    Args:
        run: What all cases have in common.
        speed: Of the fastest joint, in [rad]/[s].
    """

    def __init__(self, run: Run, speed: float) -> None:
        self.robot = robot = Robot.load("panda")
        self.fraction = fraction = speed / float(np.max(robot.velocity_limit))
        self._run, self._stage = run, Stage(robot, PERIOD)
        self._arm, self._clock = ExactArm(Leaves(robot)), 0.0
        operating = make_operating(robot, fraction)
        self._rules: list[tuple[str, Rule, bool]] = []
        self._movers: list[tuple[str, Mover]] = []
        velocity, acceleration = operating.resolve(robot)
        guaranteed = find_gentlest_stop(robot.brakes.make_curves(None), velocity)
        for setting in list_settings(run):
            given = robot, setting, PERIOD
            is_fresh = (setting.reaction, setting.camera) == (run.reactions[0], 0.0)
            obeyed = MonitorRule(*given, "operating limits", operating=operating)
            self._rules += [("obeys levels", obeyed, False), ("obeys the scale", obeyed, True)]
            pieces = PieceRule(*given, "pieces", motion="planned", operating=operating)
            self._rules.append(("pieces", pieces, False))
            self._rules.append(("separation distance", Separation(*given, "separation"), False))
            self._rules.append(("knows the future", Oracle(*given, "oracle"), False))
            for look_ahead in LOOK_AHEADS if is_fresh else (USUAL,):
                name = f"shield, {1e3 * look_ahead:g} ms ahead"
                made = ShieldMover(robot, setting, PERIOD, operating, JERK, max(look_ahead, PERIOD))
                self._movers.append((name, made))
            made = ShieldMover(
                robot, setting, PERIOD, operating, JERK, USUAL, contact_limits=LIMITS
            )
            self._movers.append(("shield, contact limits", made))
            for name, braking, jerk in (
                ("failsafe motions, guaranteed brakes", guaranteed, JERK),
                ("failsafe motions, own brakes", np.full(7, OWN_BRAKING), OWN_JERK),
            ):
                limits = MotionLimits(velocity, acceleration, braking, np.full(7, jerk))
                self._movers.append((name, FailsafeMover(Leaves(robot), limits, setting, PERIOD)))

    def play(self, case: Case, people: People) -> Iterator[Row]:
        """One case, moved or obeying in every way."""
        run = self._run
        trajectory = recorded.make_trajectory(self.robot, self.fraction, case.path, 0, run.seconds)
        free = self._go_free(trajectory, people)
        limits, setting = self._movers[0][1].limits, self._movers[0][1].setting
        alone = FailsafeMover(Leaves(self.robot), limits, setting, PERIOD, goes_on=True)
        free_moved = self._play(alone, people, trajectory).progress
        where = case.speed, people.name, case.placement
        for name, rule, by_scale in self._rules:
            arm = WorkingArm(trajectory)
            obeyed = self._stage.obey(people, arm, rule, run.seconds, by_scale=by_scale)
            yield Row(*where, name, rule.setting, free, _from_obeyed(obeyed))
        for name, mover in self._movers:
            played = self._play(mover, people, trajectory)
            yield Row(*where, name, mover.setting, free_moved, _from_shielded(played))

    def _play(self, mover: Mover, people: People, trajectory: JointTrajectory) -> Shielded:
        begin = self._clock
        self._clock += self._run.seconds + 60.0
        return play(mover, self._arm, people, trajectory, PERIOD, begin, self._run.seconds)

    def time_steps(self, case: Case, people: People) -> np.ndarray:
        """What steps take at the usual rate, in [s]."""
        operating = make_operating(self.robot, self.fraction)
        setting = Setting(self._run.reactions[0], 0.0, ONE)
        mover = ShieldMover(self.robot, setting, FAST_PERIOD, operating, JERK, USUAL)
        trajectory = recorded.make_trajectory(
            self.robot, self.fraction, case.path, 0, self._run.seconds
        )
        return play(
            mover, self._arm, people, trajectory, FAST_PERIOD, 0.0, self._run.seconds
        ).prices

    def _go_free(self, trajectory: JointTrajectory, people: People) -> float:
        """How far an arm comes that obeys nobody, in [s] along its trajectory."""
        arm = WorkingArm(trajectory)
        duration = min((len(people.ends) - 1) / people.rate - LISTEN, self._run.seconds)
        for _ in range(int(duration / PERIOD)):
            arm.step(PERIOD, True)
        return arm.progress


def _from_obeyed(one: Obeyed) -> Outcome:
    return Outcome(
        one.ticks, one.progress, one.stops, None, None, None, one.missed, one.beyond, None, ()
    )


def _from_shielded(one: Shielded) -> Outcome:
    return Outcome(
        one.ticks, one.progress, one.rests, one.hard_stops, one.reversals, one.jerk, one.missed,
        one.beyond, one, one.touches,
    )  # fmt: skip


_workplaces: dict[float, Workplace] = {}
_people: dict[tuple[Path, int], People] = {}


def play_case(run: Run, case: Case) -> list[Row]:
    """One case, with what this process has made for earlier ones."""
    return list(_find_workplace(run, case).play(case, _find_people(case)))


def _find_workplace(run: Run, case: Case) -> Workplace:
    if case.speed not in _workplaces:
        _workplaces[case.speed] = Workplace(run, case.speed)
    return _workplaces[case.speed]


def _find_people(case: Case) -> People:
    place = case.path, case.placement
    if place not in _people:
        base = recorded.place_base(*recorded.PLACEMENTS[case.placement])
        _people[place] = People(case.path, base, recorded.BOUNDS)
    return _people[place]


def main(arguments: list[str] | None = None) -> list[Row]:
    """Play all cases, and print or write the page; all that was found."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    some = {"type": float, "nargs": "+"}
    parser.add_argument("--speeds", default=[0.3, 0.8], help="of the fastest joint [rad/s]", **some)
    parser.add_argument("--reactions", default=[0.02, 0.1], help="of the brakes [s]", **some)
    parser.add_argument("--ages", default=[0.0, 0.05, 0.1], help="of new samples [s]", **some)
    parser.add_argument("--seconds", type=float, default=8.0, help="of each recording, at most")
    parser.add_argument("--placements", type=int, default=2, help="of the arm's base")
    parser.add_argument("--recordings", type=int, default=None, help="only so many of them")
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument(
        "--out", type=Path, help="page to write, with tables beside it; default: print it"
    )
    options = parser.parse_args(arguments)
    paths = recorded.find_recordings()[: options.recordings]
    run = Run(options.seconds, tuple(options.reactions), tuple(options.ages))
    cases = [
        Case(speed, path, placement)
        for speed in options.speeds
        for path in paths
        for placement in range(options.placements)
    ]
    found: list[Row] = []
    with Progress(transient=True) as progress, ProcessPoolExecutor(options.jobs) as pool:
        task = progress.add_task("beside recorded people", total=len(cases))
        for rows in pool.map(play_case, [run] * len(cases), cases):
            found += rows
            progress.advance(task)
    prices = np.concatenate(
        [_find_workplace(run, case).time_steps(case, _find_people(case)) for case in cases[:2]]
    )
    words = shlex.join(sys.argv[1:] if arguments is None else arguments)
    command = f"python benchmarks/bench_shield.py {words}".strip()
    page, tables = write_page(found, prices, command, describe_machine(load=False))
    if options.out is None:
        print(page)
    else:
        write_with_tables(page, tables, options.out)
        print(f"wrote {options.out}")
    return found


if __name__ == "__main__":
    main()
