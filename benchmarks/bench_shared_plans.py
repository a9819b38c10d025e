"""What a plan that another arm shares saves in stops and slow ticks, and what telling it costs.

    python benchmarks/bench_shared_plans.py [--seconds 20] [--seeds 1 2] [--promised 0.2 0.4]

Two Pandas face each other and go about between random configurations, the same motions for all
lines, whatever the monitor says: so each line judges the same states, and nothing is counted but
what it says of them. The watched arm is judged at 250 Hz; it is told the other arm's joint state
100 times a second and, but for the first line, ten times a second a plan of what comes next, held
for `promised` seconds. A line has the shares of STOP, SLOW and AWARE ticks, the mean bound on the
acceleration of the other's last ball, evaluations a tick, and the median time of
`ArmObstacles.publish`, processor time of this thread.
"""

from __future__ import annotations

import argparse
import time
from typing import NamedTuple

import numpy as np
import pinocchio

import armguard
from armguard.lab.simulation.arm import SimulatedArm
from armguard.lab.simulation.trajectory import random_trajectory
from armguard.verdict import Level

PERIOD, TELL_TICKS, SHARE_TICKS = 0.004, 2, 24
SPEED, ACCELERATION, DISTANCE = 0.15, 0.1, 1.0  # shares of limits; between bases, in [m]
FACING = pinocchio.SE3(pinocchio.utils.rotate("z", np.pi), np.array([DISTANCE, 0.0, 0.0]))


class Counts(NamedTuple):
    """What one line counts."""

    levels: dict[Level, int]
    """Ticks by level."""
    accels: list[float]
    """Bounds on the acceleration of the hand's last ball, [m/s²]."""
    costs: list[float]
    """Of telling states, [s]."""
    evaluated: list[int]
    """Of each tick."""


def watch(seconds: float, seed: int, promised: float, counts: Counts) -> None:
    """Judge one pair of motions; a promise of 0 seconds is none."""
    robot = armguard.Robot.load("panda")
    limits = armguard.OperatingLimits.fraction(robot, velocity=SPEED, acceleration=ACCELERATION)
    arms = [
        SimulatedArm(
            random_trajectory(
                robot,
                2 * seed + k,
                seconds,
                speed_fraction=0.9 * SPEED,
                acceleration_fraction=0.3,
            ),
            limits,
        )
        for k in range(2)
    ]
    obstacles = armguard.Obstacles(sources=["right"])
    other = armguard.ArmObstacles(robot, "right", base_placement=FACING, operating=limits)
    other.add_fixed(obstacles)
    monitor = armguard.Monitor(
        robot, obstacles, rate=1.0 / PERIOD, operating=limits, source_timeout=0.5
    )
    errors = np.full(len(robot.joints), 1e-3)
    for tick in range(round(seconds / PERIOD)):
        now = tick * PERIOD
        if promised and tick % SHARE_TICKS == 0:
            times = np.linspace(0.0, promised, max(5, round(promised / 0.02)))
            plan = armguard.Plan(now, times, *arms[1].preview(times), errors, errors)
            other.take_plan(plan, now + promised)
        if tick % TELL_TICKS == 0:
            begin = time.thread_time()
            other.publish(obstacles, now, arms[1].q, arms[1].v)
            counts.costs.append(time.thread_time() - begin)
            counts.accels.append(obstacles.table.accel[obstacles.row(other.ids[-1])])
        verdict = monitor.step(now, arms[0].q, arms[0].v)
        counts.levels[verdict.level] += 1
        counts.evaluated.append(verdict.evaluated)
        for arm in arms:
            arm.step(PERIOD)


def main() -> None:
    """Print the lines."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--seeds", type=int, nargs="*", default=[1, 2, 3, 4])
    parser.add_argument("--promised", type=float, nargs="*", default=[0.2, 0.4, 0.8])
    options = parser.parse_args()
    print("promised   STOP   SLOW  AWARE    m/s²  evaluated  publish [µs]")
    for promised in (0.0, *options.promised):
        counts = Counts(dict.fromkeys(Level, 0), [], [], [])
        for seed in options.seeds:
            watch(options.seconds, seed, promised, counts)
        shares = [
            counts.levels[level] / len(counts.evaluated)
            for level in (Level.STOP, Level.SLOW, Level.AWARE)
        ]
        print(
            f"{promised:8.1f}  {shares[0]:5.1%}  {shares[1]:5.1%}  {shares[2]:5.1%}  "
            f"{np.mean(counts.accels):6.2f}  {np.mean(counts.evaluated):9.1f}  "
            f"{1e6 * np.median(counts.costs):12.0f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
