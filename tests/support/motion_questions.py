"""What motion models are asked about: states, directions, robots with other limits."""

from types import SimpleNamespace

import numpy as np

from armguard.robot.brakes import Brakes

HAND_POINT = np.array([0.0, 0.0, 0.1])
LIMITS = (
    "lower_position_limit",
    "upper_position_limit",
    "velocity_limit",
    "acceleration_limit",
    "braking_deceleration",
    "position_error",
    "velocity_error",
)


def unit(random):
    vector = random.normal(size=3)
    return vector / np.linalg.norm(vector)


def moderate_state(robot, random):
    q = random.uniform(robot.lower_position_limit, robot.upper_position_limit)
    return q, random.uniform(-0.3, 0.3, len(q)) * robot.velocity_limit


def altered(robot, **changes):
    """The robot with other limits."""
    keys = ("name", "model", "joints", "links", "cover", "joint_index", "brakes", *LIMITS)
    if "braking_deceleration" in changes:
        held = changes["braking_deceleration"]
        changes["brakes"] = Brakes.constant(robot.joints, held)
    return SimpleNamespace(**{key: getattr(robot, key) for key in keys} | changes)
