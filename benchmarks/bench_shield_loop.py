"""A shield closes the loop: an arm with its dynamics, in MuJoCo, beside recorded people.

    ARMGUARD_RECORDINGS=... python benchmarks/bench_shield_loop.py --jobs 2
    --out docs/shield_loop.md
    ARMGUARD_RECORDINGS=... python benchmarks/bench_shield_loop.py --arms panda --seconds 2
    --placements 1 --recordings 1

A shield commands the arm at 250 Hz, and a controller follows its commands as well as it can
(`scene/simulated_arm.py`). How well that is, is measured first without people, and then stated to
the shield. Contacts are counted by the true distances of the links in each millisecond in which
the arm moves. As a control, the same arm goes the same ways and is shown nobody. The page is
written anew after each case. With `--rows` a run that was ended goes on with the cases that are
left.
"""

from __future__ import annotations

import argparse
import pickle
import shlex
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np

import bench_recordings as recorded
from armguard.lab.simulation import JointTrajectory, Recording
from armguard.lab.simulation.bodies import POINTS
from armguard.robot import Robot
from armguard.shield import Command
from scene.contestants import make_operating
from scene.long_tables import write_with_tables
from scene.loop_page import Row, find_hours, write_page
from scene.machine import describe_machine
from scene.recorded_people import People
from scene.shielded import Following, Shielded, ShieldMover, play
from scene.simulated_arm import LOAD, SimulatedArm
from scene.stop_rules import Setting

JERK = 500.0  # of all joints, [rad/s³]
LOOK_AHEAD = 0.03  # [s]
PERIOD = 0.004  # of the shield's steps, [s]
REACTION = 0.02  # of the brakes, [s]

PLACES = (0.85, 60.0), (0.7, 0.0), (0.85, -60.0), (1.0, 0.0)
"""Of the arm's base: how far it is from where the hands are mostly, in [m], and its direction from
there, as seen from the way the person faces, in degrees. It faces the hands."""

PRESUMED = Following(PERIOD, 0.05, 1.0)  # while tracking errors are measured
MARGIN = 1.5  # what is stated, as a share of what was measured
DRILLS = 3  # trajectories beside which it is measured
DRILL_SECONDS = 10.0  # of each of them
DRILL_EVERY = 2.0  # between the beginnings of two stops, [s]
DRILL_SEED = 1000  # of the first of these trajectories
BETWEEN = 60.0  # two cases on the shields' clock, [s]


class Run(NamedTuple):
    """What all cases have in common."""

    seconds: float
    settings: tuple[Setting, ...]


class Case(NamedTuple):
    """One arm at one speed, beside one recording that is seen from one place of its base."""

    arm: str
    speed: float
    """Of the fastest joint, in [rad]/[s]."""
    path: Path
    placement: int
    seed: int
    """Of the arm's trajectory."""


class BlindMover(ShieldMover):
    """A shield that is shown nobody.

    Attributes:
        stops_every: After so many steps it stops the arm as hard as it may; 0: never.
    """

    stops_every = 0

    def listen(self, since: float) -> None:
        """Be told that nobody is there."""
        self._table.update([], self._begin + since, source="camera")

    def step(self, since: float, q: np.ndarray, v: np.ndarray) -> Command:
        """The motion to follow from that time on."""
        if self.stops_every and round(since / PERIOD) % self.stops_every == 0:
            return self._shield.step(self._begin + since, q, v, velocity=np.zeros(len(q)))
        return super().step(since, q, v)


AnyMover = TypeVar("AnyMover", bound=ShieldMover)


class Workplace:
    """An arm at one speed, and the shields that move it.

    Args:
        name: Of the arm.
        speed: Of its fastest joint, in [rad]/[s].
        settings: Of the shields.
    """

    def __init__(self, name: str, speed: float, settings: tuple[Setting, ...]) -> None:
        self._robot = robot = Robot.load(name)
        self._fraction = speed / float(np.max(robot.velocity_limit))
        self._clock = 0.0
        self._following = following = self._measure_following(settings[0])
        self._blind = self._make_mover(BlindMover, settings[0], following)
        self._movers = [self._make_mover(ShieldMover, one, following) for one in settings]

    def play(self, case: Case, people: People, seconds: float) -> list[Row]:
        """One case, shown nobody and with every setting."""
        rows: list[Row] = []
        number = recorded.find_recordings().index(case.path)
        trajectory = self._make_trajectory(case.path, case.seed, seconds)
        for mover in (self._blind, *self._movers):
            seed = case.seed, number, len(rows)
            arm = SimulatedArm(self._robot, PERIOD, self._following, seed)
            played = self._play(mover, arm, people, trajectory, seconds)
            free = rows[0].played.progress if rows else played.progress
            rows.append(
                Row(
                    *find_key(case), None if mover is self._blind else mover.setting,
                    self._following, free,
                    played, arm.share, arm.steps_off, arm.least_gap,
                )
            )  # fmt: skip
        return rows

    def _measure_following(self, setting: Setting) -> Following:
        """What may be stated of how well the arm follows commands."""
        mover = self._make_mover(BlindMover, setting, PRESUMED)
        mover.stops_every = round(DRILL_EVERY / PERIOD)
        arm = SimulatedArm(self._robot, PERIOD, PRESUMED, [DRILL_SEED])
        path = recorded.find_recordings()[0]
        people = find_people(path, 0)  # shown to nobody
        for seed in range(DRILL_SEED, DRILL_SEED + DRILLS):
            trajectory = self._make_trajectory(path, seed, DRILL_SECONDS)
            self._play(mover, arm, people, trajectory, DRILL_SECONDS)
        return Following(PERIOD, *(MARGIN * arm.seen))

    def _make_trajectory(self, path: Path, seed: int, seconds: float) -> JointTrajectory:
        return recorded.make_trajectory(self._robot, self._fraction, path, seed, seconds)

    def _play(
        self,
        mover: ShieldMover,
        arm: SimulatedArm,
        people: People,
        trajectory: JointTrajectory,
        seconds: float,
    ) -> Shielded:
        begin = self._clock
        self._clock += seconds + BETWEEN
        return play(mover, arm, people, trajectory, PERIOD, begin, seconds, clock=time.thread_time)

    def _make_mover(self, kind: type[AnyMover], setting: Setting, following: Following) -> AnyMover:
        operating = make_operating(self._robot, self._fraction)
        given = self._robot, setting, PERIOD, operating, JERK, LOOK_AHEAD
        return kind(*given, following=following)


_workplaces: dict[tuple[str, float], Workplace] = {}
_people: dict[tuple[Path, int], People] = {}


def find_people(path: Path, placement: int) -> People:
    """Of a recording, seen from one place; kept by this process."""
    place = path, placement
    if place not in _people:
        _people[place] = People(path, place_base(path, *PLACES[placement]), recorded.BOUNDS)
    return _people[place]


def place_base(path: Path, distance: float, degrees: float) -> np.ndarray:
    """A recording's origin, as seen from the arm's base. Shape (4, 4).

    Args:
        path: Of the recording.
        distance: As in `PLACES`.
        degrees: As in `PLACES`.
    """
    position = Recording(path).position
    hands = [POINTS.index(f"{side}_hand") for side in ("left", "right")]
    middle = np.nanmedian(position[:, hands], axis=(0, 1))
    ahead = middle - np.nanmedian(position[:, POINTS.index("hip")], axis=0)
    angle = np.arctan2(ahead[1], ahead[0]) + np.radians(degrees)
    x, y = middle[:2] + distance * np.array([np.cos(angle), np.sin(angle)])
    return recorded.place_base(x, y, float(np.degrees(angle)) + 180.0)


def play_case(run: Run, case: Case) -> list[Row]:
    """One case, with what this process has made for earlier ones."""
    what = case.arm, case.speed
    if what not in _workplaces:
        _workplaces[what] = Workplace(*what, run.settings)
    return _workplaces[what].play(case, find_people(case.path, case.placement), run.seconds)


def list_cases(options: argparse.Namespace) -> list[Case]:
    """All cases; the first ones have every recording, and every place of the base, already."""
    paths = recorded.find_recordings()[: options.recordings]
    places = range(options.placements)
    return [
        Case(arm, speed, path, place, options.seeds * place + seed)
        for seed in range(options.seeds)
        for shift in places
        for number, path in enumerate(paths)
        for place in [places[(number + shift) % len(places)]]
        for arm in options.arms
        for speed in options.speeds
    ]


def find_key(case: Case) -> tuple[object, ...]:
    """What its rows begin with."""
    return case.arm, case.speed, case.path.stem, case.placement, case.seed


def play_all(run: Run, cases: list[Case], jobs: int) -> Iterator[list[Row]]:
    """What came of each case, in as many processes."""
    given = [run] * len(cases), cases
    if jobs == 1:
        yield from map(play_case, *given)
        return
    with ProcessPoolExecutor(jobs) as pool:
        yield from pool.map(play_case, *given)


def read_options(arguments: list[str] | None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    some = {"type": float, "nargs": "+"}
    parser.add_argument("--arms", nargs="+", default=["panda", "xarm7"])
    parser.add_argument("--speeds", default=[0.3, 0.8], help="of the fastest joint [rad/s]", **some)
    parser.add_argument("--ages", default=[0.0, 0.05], help="of new samples [s]", **some)
    parser.add_argument("--seconds", type=float, default=30.0, help="of each recording, at most")
    text = f"of the arm's base, at most {len(PLACES)}"
    parser.add_argument("--placements", type=int, default=len(PLACES), help=text)
    parser.add_argument("--seeds", type=int, default=1, help="trajectories at each of them")
    parser.add_argument("--recordings", type=int, default=None, help="only so many of them")
    parser.add_argument("--jobs", type=int, default=1, help="processes; they slow steps down")
    parser.add_argument("--rows", type=Path, help="file of what was found, to go on with later")
    parser.add_argument("--out", type=Path, help="page to write after each case, with tables")
    return parser.parse_args(arguments)


def main(arguments: list[str] | None = None) -> list[Row]:
    """Play all cases, and print the page or write it as well; all that was found."""
    options = read_options(arguments)
    settings = [
        Setting(REACTION, age, bounds) for bounds in recorded.BOUNDS for age in options.ages
    ]
    run = Run(options.seconds, tuple(settings))
    cases = list_cases(options)
    words = shlex.join(sys.argv[1:] if arguments is None else arguments)
    facts = {
        "cases": len(cases), "command": f"python benchmarks/bench_shield_loop.py {words}".strip(),
        "machine": describe_machine(load=False), "load": LOAD,
        "margin": MARGIN,
    }  # fmt: skip

    def make_page() -> tuple[str, dict[str, list[str]]]:
        return write_page(rows, PERIOD, done=len({row[:5] for row in rows}), **facts)

    rows: list[Row] = []
    if options.rows is not None and options.rows.exists():
        rows = pickle.loads(options.rows.read_bytes())
    played = {row[:5] for row in rows}
    left = [case for case in cases if find_key(case) not in played]
    for done, some in enumerate(play_all(run, left, options.jobs), 1 + len(cases) - len(left)):
        rows += some
        shown = [row for row in rows if row.setting is not None]
        contacts = sum(row.played.missed for row in shown)
        hours = find_hours(shown, PERIOD)
        print(f"{done} of {len(cases)} cases, {hours:.2f} h, {contacts} contacts", flush=True)
        if options.rows is not None:
            options.rows.write_bytes(pickle.dumps(rows))
        if options.out is not None:
            write_with_tables(*make_page(), options.out)
    print(make_page()[0])
    return rows


if __name__ == "__main__":
    main()
