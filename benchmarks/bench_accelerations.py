"""What acceleration an arm's motors could reach at most, with nothing but its links to move.

    python benchmarks/bench_accelerations.py ur5

prints, for each joint, the largest acceleration over random configurations and full joint speeds
when all motors push together at their effort limits, whichever way is worst:

    max over samples of  sum_j |(M^-1)_ij| effort_j + |(M^-1 (gravity and Coriolis torques))_i|.

It is an upper bound of what the effort limits allow, because what it leaves out only slows a joint
down: the inertia of rotors and gears, friction, the time that torque needs to rise. It is a coarse
one, since in small joints the drive's own inertia is most of what has to be moved; but makers do
not publish it. It samples; it does not prove, so `acceleration` in a robot.toml is a quarter more.
Brakes that grip harder than the motors push are not in it.
"""

from __future__ import annotations

import argparse

import numpy as np
import pinocchio
from numpy.typing import NDArray

from armguard.robot import Robot
from scene.configurations import draw_configuration

MARGIN = 1.25  # for what sampling misses


def compute_accelerations(robot: Robot, samples: int) -> NDArray[np.float64]:
    """Largest acceleration of each joint met, in [rad/s²] or [m/s²]. Shape (nv,)."""
    model, data = robot.model, robot.model.createData()
    random = np.random.default_rng(0)
    largest = np.zeros(model.nv)
    for _ in range(samples):
        q = draw_configuration(robot, random)
        v = random.choice([-1.0, 1.0], model.nv) * robot.velocity_limit
        inverse = pinocchio.computeMinverse(model, data, q)
        inverse = np.triu(inverse) + np.triu(inverse, 1).T
        bias = pinocchio.rnea(model, data, q, v, np.zeros(model.nv))
        pushed = np.abs(inverse) @ model.effortLimit + np.abs(inverse @ bias)
        np.maximum(largest, pushed, out=largest)
    return largest


def round_up(value: float) -> float:
    """To two digits."""
    unit = 10.0 ** (np.floor(np.log10(value)) - 1.0)
    return float(np.ceil(value / unit) * unit)


def main() -> None:
    """Print the table for one robot."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("robot")
    parser.add_argument("--samples", type=int, default=20_000)
    arguments = parser.parse_args()
    robot = Robot.load(arguments.robot)
    for joint, value in zip(
        robot.joints, compute_accelerations(robot, arguments.samples), strict=True
    ):
        print(f"{joint:24s} {value:12.1f} {round_up(MARGIN * value):12.0f}")


if __name__ == "__main__":
    main()
