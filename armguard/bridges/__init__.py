"""Bridges to other software: ROS 2, MuJoCo, body-tracking kits and depth cameras.

Three modules must be imported by name: `armguard.bridges.mujoco`, which needs the package mujoco,
and `armguard.bridges.depth` and `armguard.bridges.skeletons`, which only camera nodes need.
"""

from armguard.bridges.messages import JointStateReader, ObstacleReader
from armguard.bridges.ros2 import (
    AnswerMaker,
    FrameErrors,
    Ros2Cell,
    describe_verdict,
    read_speed_override,
)

__all__ = [
    "AnswerMaker",
    "FrameErrors",
    "JointStateReader",
    "ObstacleReader",
    "Ros2Cell",
    "describe_verdict",
    "read_speed_override",
]
