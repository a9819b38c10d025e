"""What deceleration an arm's motors can hold against gravity, load and its own motion.

    python benchmarks/braking.py panda --load 1.0 --speed 0.3

prints, for each joint, the least share of all acceleration limits that the effort limits of the
URDF support when every joint brakes at once with the worst combination of signs, over random
configurations and velocities: min over samples of

    (effort_i - |gravity and Coriolis torque_i|) / sum_j |M_ij| acceleration_limit_j.

The smallest of these, rounded down, is what `braking` in a robot.toml may be. It samples; it
does not prove. Friction, which helps, and the rate at which torque can rise are left out.
"""

from __future__ import annotations

import argparse

import numpy as np
import pinocchio
from numpy.typing import NDArray

from armguard.robot import Robot


def compute_supported_shares(
    robot: Robot,
    load: float,
    tool_point: NDArray[np.float64],
    speed: float,
    samples: int,
) -> NDArray[np.float64]:
    """Least share of all acceleration limits that each joint's effort supports. Shape (nv,).

    Args:
        robot: Whose URDF states effort limits.
        load: Point mass at `tool_point`, in [kg].
        tool_point: In the frame of the last joint, in [m]. Shape (3,).
        speed: Largest joint speed as a share of the velocity limits.
        samples: How many random configurations, each with a random velocity.
    """
    model = robot.model.copy()
    placement = pinocchio.SE3(np.eye(3), tool_point)
    inertia = pinocchio.Inertia(load, np.zeros(3), np.zeros((3, 3)))
    model.appendBodyToJoint(model.njoints - 1, inertia, placement)
    data = model.createData()
    random = np.random.default_rng(0)
    shares = np.full(model.nv, np.inf)
    for _ in range(samples):
        q = random.uniform(robot.lower_position_limit, robot.upper_position_limit)
        v = random.choice([-speed, speed], model.nv) * robot.velocity_limit
        mass = np.abs(pinocchio.crba(model, data, q, pinocchio.Convention.LOCAL))
        mass = np.triu(mass) + np.triu(mass, 1).T
        bias = np.abs(pinocchio.rnea(model, data, q, v, np.zeros(model.nv)))
        np.minimum(
            shares, (model.effortLimit - bias) / (mass @ robot.acceleration_limit), out=shares
        )
    return shares


def main() -> None:
    """Print the table for one robot."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("robot")
    parser.add_argument("--load", type=float, default=1.0, help="point mass at the tool [kg]")
    parser.add_argument("--tool", type=float, nargs=3, default=[0.0, 0.0, 0.2104], help="[m]")
    parser.add_argument("--speed", type=float, default=0.3, help="share of the velocity limits")
    parser.add_argument("--samples", type=int, default=20_000)
    arguments = parser.parse_args()
    robot = Robot.load(arguments.robot)
    shares = compute_supported_shares(
        robot, arguments.load, np.array(arguments.tool), arguments.speed, arguments.samples
    )
    for joint, share in zip(robot.joints, shares, strict=True):
        print(f"{joint:24s} {share:7.3f}")
    print(f"{'all':24s} {shares.min():7.3f}")


if __name__ == "__main__":
    main()
