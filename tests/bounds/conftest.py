"""The arm and its motion models."""

import pytest

from armguard.bounds import BrakingMotion, IsotropicMotion, JointMotion, ReachMotion
from armguard.robot import Robot
from support.example_arms import hold_at_all_speeds


@pytest.fixture(scope="module")
def robot():
    robot = Robot.load("panda")
    # What depends on load and speed has tests of its own.
    hold_at_all_speeds(robot)
    return robot


@pytest.fixture(scope="module")
def models(robot):
    return {
        "reach": ReachMotion(robot),
        "isotropic": IsotropicMotion(robot),
        "joint": JointMotion(robot),
        "braking": BrakingMotion(robot, 0.02),
    }
