"""Where armguard meets others: messages of ROS 2, simulations in MuJoCo, body-tracking kits.

`armguard.bridges.mujoco`, which needs a package of its own, and `armguard.bridges.skeletons` are
imported by their names.
"""

from armguard.bridges.messages import JointStateReader, ObstacleReader
from armguard.bridges.ros2 import FrameErrors, Ros2Cell, describe_verdict, read_speed_override

__all__ = [
    "FrameErrors",
    "JointStateReader",
    "ObstacleReader",
    "Ros2Cell",
    "describe_verdict",
    "read_speed_override",
]
