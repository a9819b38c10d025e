"""A working arm beside recorded people: how often each rule stops it, and what that costs.

    ARMGUARD_RECORDINGS=... python benchmarks/bench_recordings.py            # several minutes
    ARMGUARD_RECORDINGS=... python benchmarks/bench_recordings.py --seconds 3 --placements 1 --seeds
    1

A Panda moves between random points of its workspace, its base at several places at the table where
people were recorded. Every rule judges every tick, with the same errors, delays and bounds on
people, and holds a STOP for as long as it takes a monitor to believe that it is over. First the arm
goes on whatever they say, so that all rules judge the same states. Then it obeys them, one by one:
after the delays its brakes act with what deceleration they guarantee, and once it may, it returns
to its path.

| column | what it is |
|---|---|
| goes on | share of time in STOP, of an arm that does not obey |
| obeys | the same of one that does |
| clear | of either, without what is said only because a body is hidden or not believed |
| stops/min | how often an arm that obeys is told to stop |
| time lost | by how much it falls behind the one that does not obey |
| missed | contacts of its cover with the recorded person while it moved: each is a failure |
| beyond | such contacts with a body that was hidden or whose last sample broke its bounds |
| tick | what a judgement costs beyond the arm's kinematics: median and 99th percentile |

No rule can know of a swapped marker beforehand, which is why "beyond" is no failure. A monitor says
STOP while it cannot believe a person, whatever the rule: only the row of the monitor, with braking
and its default schedule, has that in it; it includes the arm's kinematics in its price.
"""

from __future__ import annotations

import argparse
import copy
import os
import sys
import time
from collections import deque
from pathlib import Path
from typing import NamedTuple

import numpy as np

from armguard.obstacles import Obstacles
from armguard.pairs.separation import HUMAN_SPEED
from armguard.robot import Robot
from armguard.simulation import Recording, keeps_within, random_trajectory
from armguard.simulation.bodies import BODIES, POINTS
from scene.stop_rules import (
    BrakingRule,
    IsotropicRule,
    JointRule,
    MonitorRule,
    PlannedRule,
    Scene,
    SeparationStop,
    Timing,
)
from scene.working_arm import WorkingArm

ACCEL, SPEED = 10.0, 2.0  # bounds on people, [m/s²] and [m/s]
REACTION, LATENCY, RISE_DELAY = 0.02, 0.002, 0.3  # [s]
INTRUSION = 0.2  # [m], in the second of the rows of the separation distance
# Of the arm's base at the recordings' table: x and y in [m], and which way it faces, in degrees.
PLACEMENTS = ((0.0, 0.7, -90.0), (-0.9, 0.7, -50.0), (0.0, 1.1, -90.0), (0.9, 0.7, -130.0))
WORKSPACE = ([-0.3, -0.6, 0.0], [0.75, 0.6, 1.2])  # of all moving links, before the base, [m]
TRAJECTORY, ACCELERATION = 60.0, 0.125  # [s]; of the acceleration limits, at most


class Case(NamedTuple):
    """One recording, seen from one place of the arm's base, and what the arm does meanwhile."""

    recording: Recording
    seed: int


class Outcome:
    """What became of one rule; counts add up over cases."""

    def __init__(self) -> None:
        self.ticks = self.stopped = self.clear = self.stops = self.missed = self.beyond = 0
        self.lost = 0.0
        self.prices: list[float] = []


class Holder:
    """A verdict that falls at once and rises after `rise_delay` seconds without a STOP."""

    def __init__(self, rise_delay: float = RISE_DELAY) -> None:
        self.stops = True
        self._rise_delay = rise_delay
        self._last = -np.inf

    def update(self, now: float, safe: bool) -> bool:
        """Take a judgement; whether this tick says STOP."""
        if not safe:
            self._last = now
        self.stops = not safe or now - self._last < self._rise_delay
        return self.stops


class Brakes:
    """Carries verdicts to the arm: a GO after the latency, a STOP after all that delays it."""

    def __init__(self, arm: WorkingArm, delay: float) -> None:
        self._arm, self._delay = arm, delay
        self._due: deque[tuple[float, bool]] = deque()
        self._go = self._told = False

    def tell(self, now: float, stop: bool) -> None:
        """Send a verdict."""
        if stop == self._told:
            self._due.append((now + (self._delay if stop else LATENCY), not stop))
            self._told = not stop

    def run(self, now: float, period: float) -> None:
        """Let the arm move until the next tick."""
        while self._due and self._due[0][0] < now + period - 1e-9:
            when, go = self._due.popleft()
            if when > now:
                self._arm.step(when - now, self._go)
                period -= when - now
                now = when
            self._go = go
        self._arm.step(period, self._go)


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


class Contacts:
    """Whether the recorded person touches the arm's cover, by body."""

    def __init__(self, scene: Scene, recording: Recording) -> None:
        spheres = scene.kinematics.spheres
        self._leaves = np.flatnonzero(spheres.child_count == 0)
        self._sizes = spheres.radius[self._leaves]
        self._scene, self._recording = scene, recording
        self._ends = [[POINTS.index(point) for point in body.points] for body in BODIES]

    def touched(self, now: float) -> list[str]:
        """Bodies in contact; between samples, people move straight on."""
        centers = self._scene.kinematics.centers[self._leaves]
        share, index = np.modf(now * self._recording.rate + 1e-6)
        frame = min(int(index), len(self._recording.position) - 1)
        after = min(frame + 1, len(self._recording.position) - 1)
        points = (1.0 - share) * self._recording.position[frame]
        if share > 1e-3:
            points = points + share * self._recording.position[after]
        names = []
        for body, ends in zip(BODIES, self._ends, strict=True):
            a, b = points[ends[0]], points[ends[-1]]
            along = b - a
            part = np.clip((centers - a) @ along / max(along @ along, 1e-12), 0.0, 1.0)
            gaps = np.linalg.norm(centers - a - part[:, None] * along, axis=1)
            if (gaps <= self._sizes + body.radius).any():
                names.append(body.name)
        return names


def find_doubtful(obstacles: Obstacles, now: float, rate: float) -> set[str]:
    """Bodies that are hidden or whose last sample was not believed."""
    table = obstacles.table
    hidden = now - table.stamp > 1.0 / rate + 1e-9
    rows = np.flatnonzero(table.alive & (table.refused | ~table.has_state | hidden))
    return {obstacles.ids[row] for row in rows}


def play(case, rules, outcomes, scene, trajectory, seconds, obeys):  # type: ignore[no-untyped-def]
    """One recording with one arm; share of ticks in which a body was doubtful."""
    recording = copy.copy(case.recording)  # which plays from its beginning
    obstacles = Obstacles(accel=ACCEL, speed=SPEED)
    scene.watch(obstacles)
    for rule in rules:
        rule.begin(scene)
    arm, contacts = WorkingArm(trajectory), Contacts(scene, recording)
    holders = [(Holder(0.0 if rule.holds else RISE_DELAY), Holder()) for rule in rules]
    brakes = Brakes(arm, rules[0].delay)
    period = scene.timing.period
    ticks = int(min(recording.duration, seconds) / period)
    touching: set[str] = set()
    doubted = 0
    for tick in range(ticks):
        now = tick * period
        recording.publish(obstacles, now)
        scene.place(arm, now)
        doubtful = find_doubtful(obstacles, now, recording.rate)
        doubted += bool(doubtful)
        for rule, (holder, clear), outcome in zip(rules, holders, outcomes, strict=True):
            begin = time.perf_counter()
            safe = rule.judge(scene)
            outcome.prices.append(time.perf_counter() - begin)
            stopped = holder.stops and tick > 0
            stops = holder.update(now, safe)
            outcome.ticks += 1
            outcome.stopped += stops
            outcome.clear += clear.update(now, safe or bool(doubtful)) and stops
            outcome.stops += stops and not stopped
        if obeys:
            touched = set(contacts.touched(now)) if not arm.rests else set()
            outcomes[0].beyond += len((touched - touching) & doubtful)
            outcomes[0].missed += len(touched - touching - doubtful)
            touching = touched
        brakes.tell(now, holders[0][0].stops if obeys else False)
        brakes.run(now, period)
    for outcome in outcomes:
        outcome.lost += ticks * period - arm.progress
    return doubted / max(ticks, 1)


def run_speed(speed, options, robot, timing):  # type: ignore[no-untyped-def]
    """Play all cases at one top joint speed; outcomes by rule, of arms that go on and that obey."""
    scene = Scene(robot, timing)
    makers = [
        *(IsotropicRule, JointRule, BrakingRule),
        *(
            lambda scene, piece=piece: PlannedRule(scene, timing.horizon + piece)
            for piece in options.pieces
        ),
        lambda scene: SeparationStop(scene, 0.0),
        lambda scene: SeparationStop(scene, INTRUSION),
        MonitorRule,
    ]
    rules = [maker(scene) for maker in makers]
    going, obeying = [Outcome() for _ in rules], [Outcome() for _ in rules]
    accept = keeps_within(robot, *WORKSPACE)
    cases = [
        Case(Recording(path, placement=place_base(*place), accel=ACCEL, speed=SPEED), seed)
        for path in find_recordings()[: options.recordings]
        for place in PLACEMENTS[: options.placements]
        for seed in range(options.seeds)
    ]
    fraction = speed / float(np.max(robot.velocity_limit))
    trajectories = [
        random_trajectory(
            robot,
            seed,
            TRAJECTORY,
            speed_fraction=fraction,
            acceleration_fraction=float(
                np.min(ACCELERATION * robot.acceleration_limit / robot.braking_deceleration)
            ),
            accept=accept,
        )
        for seed in range(options.seeds)
    ]
    doubts = []
    for case in cases:
        inputs = scene, trajectories[case.seed], options.seconds
        doubts.append(play(case, rules, going, *inputs, False))
        for rule, outcome in zip(rules, obeying, strict=True):
            play(case, [rule], [outcome], *inputs, True)
    return rules, going, obeying, float(np.mean(doubts))


def print_table(speed, timing, rules, going, obeying, doubted):  # type: ignore[no-untyped-def]
    """One table."""
    minutes = going[0].ticks * timing.period / 60.0
    print(f"\nup to {speed} rad/s, {minutes:.1f} minutes with each rule")
    names = ("goes on", "clear", "obeys", "clear", "stops/min", "time lost", "missed", "beyond")
    print(f"{'':20}" + "".join(f"{name:>10}" for name in (*names, "tick p50", "p99 [µs]")))
    for rule, free, tied in zip(rules, going, obeying, strict=True):
        shares = [count / free.ticks for count in (free.stopped, free.clear)]
        shares += [count / tied.ticks for count in (tied.stopped, tied.clear)]
        lost = (tied.lost - free.lost) / (60.0 * minutes)
        price = 1e6 * np.percentile(free.prices, [50, 99])
        print(
            f"{rule.name:20}"
            + "".join(f"{share:10.1%}" for share in shares)
            + f"{tied.stops / minutes:10.1f}{lost:10.1%}{tied.missed:10d}{tied.beyond:10d}"
            + f"{price[0]:10.0f}{price[1]:10.0f}"
        )
    print(f"a body was hidden or not believed in {doubted:.1%} of the time")


def main(arguments: list[str] | None = None) -> dict[float, tuple[list, list, list]]:
    """Print a table for each speed; rules, outcomes of arms that go on and of such that obey."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--speeds", type=float, nargs="+", default=[0.3, 0.8], help="[rad/s]")
    parser.add_argument("--rate", type=float, default=200.0, help="ticks a second")
    parser.add_argument("--seconds", type=float, default=60.0, help="of each recording, at most")
    parser.add_argument("--placements", type=int, default=3, help=f"at most {len(PLACEMENTS)}")
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--recordings", type=int, default=None, help="only so many of them")
    parser.add_argument(
        "--pieces", type=float, nargs="*", default=[0.0, 0.2], help="of plans, beyond a tick [s]"
    )
    parser.add_argument(
        "--braking", type=float, default=None,
        help="guaranteed deceleration as a share of the acceleration limits, if not robot.toml's",
    )  # fmt: skip
    options = parser.parse_args(arguments)
    find_recordings()
    robot = Robot.load("panda")
    if options.braking is not None:
        robot.braking_deceleration = options.braking * robot.acceleration_limit
    share = float(np.min(robot.braking_deceleration / robot.acceleration_limit))
    timing = Timing(1.0 / options.rate, LATENCY, REACTION)
    print(
        f"grid {options.rate:g} Hz, latency {1e3 * LATENCY:g} ms, reaction {1e3 * REACTION:g} ms, "
        f"rise delay {RISE_DELAY} s, brakes {share:.0%} of the acceleration limits; "
        f"people: {ACCEL:g} m/s², {SPEED:g} m/s; separation: {HUMAN_SPEED:g} m/s"
    )
    found = {}
    for speed in options.speeds:
        rules, going, obeying, doubted = run_speed(speed, options, robot, timing)
        print_table(speed, timing, rules, going, obeying, doubted)
        found[speed] = rules, going, obeying
    return found


if __name__ == "__main__":
    main()
