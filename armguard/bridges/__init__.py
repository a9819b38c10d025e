"""Where armguard meets others: ROS 2, MuJoCo, body-tracking kits and depth cameras.

Three modules are imported by their names: `armguard.bridges.mujoco`, which needs a package of its
own, `armguard.bridges.depth` and `armguard.bridges.skeletons`, which a camera's node needs alone.
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
