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

from armguard.robot import Robot
from armguard.robot.efforts import HARDER, compute_accelerations, round_up


def main() -> None:
    """Print the table for one robot."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("robot")
    parser.add_argument("--samples", type=int, default=20_000)
    arguments = parser.parse_args()
    robot = Robot.load(arguments.robot)
    for joint, value in zip(
        robot.joints, compute_accelerations(robot.model, arguments.samples), strict=True
    ):
        print(f"{joint:24s} {value:12.1f} {round_up(HARDER * value):12.0f}")


if __name__ == "__main__":
    main()
