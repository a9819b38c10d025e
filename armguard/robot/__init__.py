"""The arm: its description, geometry and kinematics, and the check of joint states.

This package does not depend on obstacles.
"""

from armguard.cover.triangulation import triangulate
from armguard.robot.joint_states import JointStates
from armguard.robot.kinematics import Kinematics
from armguard.robot.operating_limits import OperatingLimits
from armguard.robot.robot import Robot

__all__ = [
    "JointStates",
    "Kinematics",
    "OperatingLimits",
    "Robot",
    "triangulate",
]
