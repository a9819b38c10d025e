"""Arms of other makers, with made-up accelerations, and one ball a link for a cover."""

import functools
from types import SimpleNamespace

import numpy as np

from armguard.cover.miniball import enclose_points
from armguard.robot import Robot
from armguard.robot.description import find_example_urdf, read_description
from armguard.robot.urdf import read_urdf
from support.urdf_arms import SOURCES, brakes_for

ARMS = {
    "xarm7": ("xarm_description/urdf/xarm7.urdf", [f"joint{k}" for k in range(1, 8)]),
    "ur5": (
        "ur_description/urdf/ur5_robot.urdf",
        ["shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint"]
        + [f"wrist_{k}_joint" for k in (1, 2, 3)],
    ),
    "tiago": (
        "tiago_description/robots/tiago.urdf",
        ["torso_lift_joint", *(f"arm_{k}_joint" for k in range(1, 8))],
    ),
}


def hold_at_all_speeds(robot):
    """Let its brakes hold at every speed and load what they do at low speed, heavily loaded."""
    robot.braking_deceleration = robot.braking_deceleration


@functools.cache
def load_holding(name):
    """A robot that armguard knows, whose brakes hold at every speed and load; nobody changes it."""
    robot = Robot.load(name)
    held, gentle = robot.braking_deceleration, robot.brakes.gentlest_stop(robot.velocity_limit)
    robot.braking_deceleration = np.where(held > 0.0, held, gentle)
    return robot


def load_arm(name):
    if name == "panda":
        robot = Robot.load("panda")
        hold_at_all_speeds(robot)
        return robot
    path, joints = ARMS[name]
    urdf_path, packages = find_example_urdf(path)
    urdf = read_urdf(urdf_path, [packages])
    described, slows = {}, {}
    for joint in joints:
        number = urdf.model.getJointId(joint)
        column = urdf.model.joints[number].idx_v
        row = urdf.model.joints[number].idx_q
        speed = float(urdf.model.velocityLimit[column])
        described[joint] = {"velocity": speed, "acceleration": 5.0 * speed}
        slows[joint] = 2.0 * speed
        if joint not in urdf.continuous:
            described[joint]["position"] = [
                float(urdf.model.lowerPositionLimit[row]),
                float(urdf.model.upperPositionLimit[row]),
            ]
    locked = {name: {"position": 0.0} for name in list(urdf.model.names)[1:] if name not in joints}
    brakes = [brakes_for(*joints, deceleration=slows)]
    limits = {"sources": SOURCES, "joints": described, "brakes": brakes, "locked": locked}
    robot = Robot(name, urdf, read_description(limits), joints)
    robot.cover = SimpleNamespace(tree=lambda link: _single_ball(robot.hull(link)))
    return robot


def _single_ball(points):
    center, radius = enclose_points(points)
    return SimpleNamespace(
        spheres=np.append(center, radius)[None],
        first_child=np.zeros(1, np.int64),
        child_count=np.zeros(1, np.int64),
    )
