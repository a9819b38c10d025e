"""What deceleration an arm's motors can hold against gravity, load and its own motion.

    python benchmarks/bench_braking.py panda --load 1.0 --speed 0.3

prints, for each joint, the least share of all acceleration limits that the effort limits of the
URDF support when every joint brakes at once with the worst combination of signs, over random
configurations and velocities: min over samples of

    (effort_i - |gravity and Coriolis torque_i|) / sum_j |M_ij| b_j,

with b the acceleration limits. Where those are derived themselves, and far apart, `--proportional`
takes the velocity limits for b: then the share is one over the time in which the arm stops from
full speed, in [1/s]. A safe part of the smallest share is what `braking` in a robot.toml may rest
on. It samples; it does not prove. Friction, which helps, is left out, and so are the inertia of the
drives and the rate at which torque can rise, which do not help.
"""

from __future__ import annotations

import argparse

import numpy as np
import pinocchio
from numpy.typing import NDArray

from armguard.robot import Robot
from scene.configurations import draw_configuration


def compute_supported_shares(
    robot: Robot,
    shape: NDArray[np.float64],
    load: float,
    tool_point: NDArray[np.float64],
    speed: float,
    samples: int,
    balanced: list[str],
) -> NDArray[np.float64]:
    """Least share of a deceleration that each joint's effort supports. Shape (nv,).

    Args:
        robot: Whose URDF states effort limits.
        shape: Decelerations of which a share is sought. Shape (nv,).
        load: Point mass at `tool_point` of each last joint, in [kg].
        tool_point: In the frame of each last joint, in [m]. Shape (3,).
        speed: Largest joint speed as a share of the velocity limits.
        samples: How many random configurations, each with a random velocity.
        balanced: Joints whose gravity torque something else carries, such as springs.
    """
    model = robot.model.copy()
    for joint in range(1, model.njoints):
        if joint not in list(model.parents):
            placement = pinocchio.SE3(np.eye(3), tool_point)
            inertia = pinocchio.Inertia(load, np.zeros(3), np.zeros((3, 3)))
            model.appendBodyToJoint(joint, inertia, placement)
    data = model.createData()
    random = np.random.default_rng(0)
    shares = np.full(model.nv, np.inf)
    at_rest = np.array([joint in balanced for joint in robot.joints])
    for _ in range(samples):
        q = draw_configuration(robot, random)
        v = random.choice([-speed, speed], model.nv) * robot.velocity_limit
        mass = np.abs(pinocchio.crba(model, data, q, pinocchio.Convention.LOCAL))
        mass = np.triu(mass) + np.triu(mass, 1).T
        bias = pinocchio.rnea(model, data, q, v, np.zeros(model.nv))
        gravity = pinocchio.computeGeneralizedGravity(model, data, q)
        bias = np.abs(bias - np.where(at_rest, gravity, 0.0))
        np.minimum(shares, (model.effortLimit - bias) / (mass @ shape), out=shares)
    return shares


def main() -> None:
    """Print the table for one robot."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("robot")
    parser.add_argument("--load", type=float, default=1.0, help="point mass at the tool [kg]")
    parser.add_argument("--tool", type=float, nargs=3, default=[0.0, 0.0, 0.2104], help="[m]")
    parser.add_argument("--speed", type=float, default=0.3, help="share of the velocity limits")
    parser.add_argument("--samples", type=int, default=20_000)
    parser.add_argument("--proportional", action="store_true", help="to the velocity limits")
    parser.add_argument("--balanced", nargs="*", default=[], help="joints with springs")
    arguments = parser.parse_args()
    robot = Robot.load(arguments.robot)
    shares = compute_supported_shares(
        robot,
        robot.velocity_limit if arguments.proportional else robot.acceleration_limit,
        arguments.load,
        np.array(arguments.tool),
        arguments.speed,
        arguments.samples,
        arguments.balanced,
    )
    for joint, share in zip(robot.joints, shares, strict=True):
        print(f"{joint:24s} {share:7.3f}")
    print(f"{'all':24s} {shares.min():7.3f}")


if __name__ == "__main__":
    main()
