"""How smoothly an arm moves that takes the speed scale as its speed override, beside a person.

    python benchmarks/bench_scale.py [--seconds 15] [--phases 3] [--rise 0.5 1 2]

A Panda with its published operating limits swings between two places at 1 kHz, as fast as the speed
scale of each verdict lets it. A person stands at 0.8 m and shifts their weight; a camera sees them
30 times a second, 10 ms late. All of it is simulated time, so each run gives the same figures on
any machine. Each line is the mean over some phases of the person's motion.

`jumps` are changes of the scale by more than 0.3 from one tick to the next, `reversals` how often a
second the acceleration along the path changes its sign, `path` the way that the fastest joint has
covered, `STOP` the share of ticks, and `contacts` the ticks in which the arm
touched the person.
"""

from __future__ import annotations

import argparse
import math
from typing import NamedTuple

import numpy as np

from armguard.lab.simulation.arm import SimulatedArm
from armguard.lab.simulation.bodies import BODIES, POINTS
from armguard.lab.simulation.trajectory import JointTrajectory
from armguard.monitor import Monitor
from armguard.obstacles import Obstacles
from armguard.robot import Robot
from armguard.verdict import Level
from scene.beside import MIDDLE, SIZE, Person
from scene.clearance import Leaves

RATE, CAMERA, LATENCY = 1000.0, 30.0, 0.01  # [Hz], [Hz], [s]
JUMP = 0.3
RADII = np.array([body.radius for body in BODIES])
ENDS = np.array([[POINTS.index(body.points[k]) for k in (0, -1)] for body in BODIES])
FIRST_JOINT = (1.2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class Scene(NamedTuple):
    """How the arm moves beside the person."""

    size: tuple[float, ...]
    """Of the swing to either side, in [rad]. Shape (7,)."""
    speed: float
    """Of the trajectory, as a fraction of the velocity limits."""
    distance: float
    """Of the person's feet from the axis of the arm's base, in [m]."""


SCENES = {
    "all joints, half speed, 0.8 m": Scene(SIZE, 0.5, 0.8),
    "all joints, 0.7 of the speed, 0.8 m": Scene(SIZE, 0.7, 0.8),
    "first joint, 0.35 of the speed, 0.8 m": Scene(FIRST_JOINT, 0.35, 0.8),
    "first joint, 0.7 of the speed, 0.9 m": Scene(FIRST_JOINT, 0.7, 0.9),
}


class Score(NamedTuple):
    """What one run was like; times in [s]."""

    jumps: float
    reversals: float
    """A second."""
    path: float
    """[rad]."""
    stops: float
    """Share of ticks."""
    slow: float
    """Share of ticks."""
    full: float
    """Share of the SLOW ticks whose scale is 1."""
    contacts: float


def count_reversals(rates: np.ndarray) -> int:
    """How often the acceleration changes its sign, by the rate along the path in each tick."""
    signs = np.sign(np.diff(rates))
    signs = signs[signs != 0.0]
    return int((signs[1:] != signs[:-1]).sum())


def run(scene: Scene, seconds: float, begin: float, **settings: float) -> Score:
    """One run, with the person's motion from a time on."""
    robot = Robot.load("panda")
    middle, size = np.array(MIDDLE), np.array(scene.size)
    way = JointTrajectory(
        robot, [middle - size, middle + size], speed_fraction=scene.speed,
        acceleration_fraction=0.3, loop=True,
    )  # fmt: skip
    obstacles = Obstacles(sources=[])
    monitor = Monitor(robot, obstacles, rate=RATE, operating="published", **settings)
    arm, leaves = SimulatedArm(way, monitor.settings.operating), Leaves(robot)
    person = Person("person", scene.distance, -math.pi / 2.0)
    scales, levels, rates = [], [], []
    frame = contacts = 0
    path = 0.0
    for tick in range(round(seconds * RATE)):
        now = tick / RATE
        while frame == 0 or frame / CAMERA + LATENCY <= now + 1e-12:
            person.publish(obstacles, frame / CAMERA, begin=begin)
            frame += 1
        verdict = monitor.step(now, arm.q, arm.v)
        before = arm.q
        arm.step(1.0 / RATE, verdict.speed_scale)
        path += float(np.abs(arm.q - before).max())
        scales.append(verdict.speed_scale)
        levels.append(verdict.level)
        rates.append(0.0 if arm.braking else arm._rate)
        leaves.place(arm.q, arm.v)
        points, _ = person.find_points(begin + now)
        contacts += bool(leaves.gaps(points[ENDS], RADII).min() <= 0.0)
    slow = np.array(levels) == Level.SLOW
    return Score(
        float((np.abs(np.diff(scales)) > JUMP).sum()),
        count_reversals(np.array(rates)) / seconds,
        path,
        float((np.array(levels) == Level.STOP).mean()),
        float(slow.mean()),
        float((np.array(scales)[slow] == 1.0).mean()) if slow.any() else 0.0,
        float(contacts),
    )


def main(arguments: list[str] | None = None) -> dict[tuple[str, float], Score]:
    """Run the scenes and print a line for each; their mean scores by scene and rise."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seconds", type=float, default=15.0)
    parser.add_argument("--phases", type=int, default=3)
    parser.add_argument("--rise", type=float, nargs="*", default=[1.0], help="scale_rise, in 1/s")
    chosen = parser.parse_args(arguments)
    print("| scene | scale_rise | " + " | ".join(Score._fields) + " |")
    print("|---" * (2 + len(Score._fields)) + "|")
    scores = {}
    for name, scene in SCENES.items():
        for rise in chosen.rise:
            runs = [
                run(scene, chosen.seconds, 0.9 * phase, scale_rise=rise)
                for phase in range(chosen.phases)
            ]
            mean = Score(*np.mean(runs, axis=0).tolist())
            scores[name, rise] = mean
            print(f"| {name} | {rise:g} | " + " | ".join(f"{one:.3g}" for one in mean) + " |")
    return scores


if __name__ == "__main__":
    main()
