"""Where armguard meets others: messages of ROS 2, MuJoCo simulations, and depth images.

`armguard.bridges.mujoco` needs a package of its own, and is imported by its name; so is
`armguard.bridges.depth`, which a camera's node needs alone.
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
