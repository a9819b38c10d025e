"""The arm and its motion models."""

import pytest

from armguard.bounds import BrakingMotion, IsotropicMotion, JointMotion, ReachMotion
from armguard.robot import Robot


@pytest.fixture(scope="module")
def robot():
    return Robot.load("panda")


@pytest.fixture(scope="module")
def models(robot):
    return {
        "reach": ReachMotion(robot),
        "isotropic": IsotropicMotion(robot),
        "joint": JointMotion(robot),
        "braking": BrakingMotion(robot, 0.02),
    }
