"""What deceleration an arm's motors can hold against gravity, load and its own motion.

    python benchmarks/bench_braking.py panda --load 1.0 --speed 0.3

prints, for each joint, the least share of all acceleration limits that the effort limits of the
URDF support when every joint brakes at once with the worst combination of signs, over random
configurations and velocities: min over samples of

    (effort_i - |gravity and Coriolis torque_i|) / sum_j |M_ij| b_j,

with b the acceleration limits. Where those are derived themselves, and far apart, `--proportional`
takes the velocity limits for b: then the share is one over the time in which the arm stops from
full speed, in [1/s]. A safe part of the smallest share is what a deceleration under `[[brakes]]`
in a robot.toml may rest on; several values of `--load` and `--speed` print one line for each pair.

    python benchmarks/bench_braking.py panda --stated

asks the same of what the robot's table states: how many times each of its decelerations is
supported, under its load, with all joints at the speed up to which it holds; below 1 it is not.

It samples; it does not prove. Friction, which helps, is left out, and so are the inertia of the
drives and the rate at which torque can rise, which do not help.
"""

from __future__ import annotations

import argparse

import numpy as np
from numpy.typing import NDArray

from armguard.robot import Robot
from armguard.robot.efforts import compute_supported_shares


def list_stated(
    robot: Robot,
) -> list[tuple[str, tuple[float, NDArray[np.float64], NDArray[np.float64]]]]:
    """Load, speeds and decelerations that the robot's table states for all joints together."""
    cases = []
    for load in sorted({one.load for row in robot.brakes.entries.values() for one in row}):
        if load > robot.brakes.most_payload:
            continue
        curves = robot.brakes.make_curves(load)
        for step in range(curves.speed.shape[1]):
            repeats = step > 0 and (curves.speed[:, step] == curves.speed[:, step - 1]).all()
            if not repeats and (curves.deceleration[:, step] > 0.0).all():
                speeds = curves.speed[:, step]
                share = 100.0 * np.min(speeds / robot.velocity_limit)
                name = f"{load:g} kg, up to {share:.0f} %"
                cases.append((name, (load, speeds, curves.deceleration[:, step])))
    return cases


def main() -> None:
    """Print the table for one robot."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("robot")
    parser.add_argument(
        "--load", type=float, nargs="+", default=[1.0], help="point mass at the tool [kg]"
    )
    parser.add_argument("--tool", type=float, nargs=3, default=[0.0, 0.0, 0.2104], help="[m]")
    parser.add_argument(
        "--speed", type=float, nargs="+", default=[0.3], help="share of the velocity limits"
    )
    parser.add_argument("--stated", action="store_true", help="check what the robot's table states")
    parser.add_argument("--samples", type=int, default=20_000)
    parser.add_argument("--proportional", action="store_true", help="to the velocity limits")
    parser.add_argument("--balanced", nargs="*", default=[], help="joints with springs")
    arguments = parser.parse_args()
    robot = Robot.load(arguments.robot)
    shape = robot.velocity_limit if arguments.proportional else robot.acceleration_limit
    places = [(load, speed) for load in arguments.load for speed in arguments.speed]
    cases = [(load, speed * robot.velocity_limit, shape) for load, speed in places]
    names = [f"{load:g} kg, {100.0 * speed:g} %" for load, speed in places]
    if arguments.stated:
        stated = list_stated(robot)
        cases = [case for _, case in stated]
        names = [name for name, _ in stated]
    print(f"{'':24s} {'all':>9s}  {'least':12s} {'each joint'}")
    for name, (load, speeds, slows) in zip(names, cases, strict=True):
        shares = compute_supported_shares(
            robot.model,
            slows,
            load,
            np.array(arguments.tool),
            speeds,
            arguments.samples,
            arguments.balanced,
        )
        worst = robot.joints[int(np.argmin(shares))]
        each = " ".join(f"{share:.3f}" for share in shares)
        print(f"{name:24s} {shares.min():9.3f}  {worst:12s} {each}")


if __name__ == "__main__":
    main()
