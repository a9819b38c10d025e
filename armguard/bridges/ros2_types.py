"""Types of messages of ROS 2, as their packages define them from Humble to Jazzy.

Where ROS 2 is installed it knows them by itself. Names of types are those of ROS; on the wire each
is `package::msg::dds_::Name_`, and a topic `/name` is `rt/name` there.
"""

from __future__ import annotations

from typing import NamedTuple

_TEXT = """
builtin_interfaces/msg/Time: int32 sec, uint32 nanosec
builtin_interfaces/msg/Duration: int32 sec, uint32 nanosec
std_msgs/msg/Header: builtin_interfaces/Time stamp, string frame_id
std_msgs/msg/Bool: bool data
std_msgs/msg/Float64: float64 data
std_msgs/msg/ColorRGBA: float32 r, float32 g, float32 b, float32 a

geometry_msgs/msg/Point: float64 x, float64 y, float64 z
geometry_msgs/msg/Vector3: float64 x, float64 y, float64 z
geometry_msgs/msg/Quaternion: float64 x, float64 y, float64 z, float64 w
geometry_msgs/msg/Pose: geometry_msgs/Point position, geometry_msgs/Quaternion orientation
geometry_msgs/msg/PoseArray: std_msgs/Header header, geometry_msgs/Pose[] poses
geometry_msgs/msg/PoseWithCovariance: geometry_msgs/Pose pose, float64[36] covariance
geometry_msgs/msg/Transform: geometry_msgs/Vector3 translation, geometry_msgs/Quaternion rotation
geometry_msgs/msg/TransformStamped: std_msgs/Header header, string child_frame_id,
    geometry_msgs/Transform transform
tf2_msgs/msg/TFMessage: geometry_msgs/TransformStamped[] transforms

sensor_msgs/msg/JointState: std_msgs/Header header, string[] name, float64[] position,
    float64[] velocity, float64[] effort
sensor_msgs/msg/CompressedImage: std_msgs/Header header, string format, uint8[] data
trajectory_msgs/msg/JointTrajectoryPoint: float64[] positions, float64[] velocities,
    float64[] accelerations, float64[] effort, builtin_interfaces/Duration time_from_start
trajectory_msgs/msg/JointTrajectory: std_msgs/Header header, string[] joint_names,
    trajectory_msgs/JointTrajectoryPoint[] points
diagnostic_msgs/msg/KeyValue: string key, string value
diagnostic_msgs/msg/DiagnosticStatus: byte level, string name, string message, string hardware_id,
    diagnostic_msgs/KeyValue[] values
diagnostic_msgs/msg/DiagnosticArray: std_msgs/Header header,
    diagnostic_msgs/DiagnosticStatus[] status

people_msgs/msg/Person: string name, geometry_msgs/Point position, geometry_msgs/Point velocity,
    float64 reliability, string[] tagnames, string[] tags
people_msgs/msg/People: std_msgs/Header header, people_msgs/Person[] people
vision_msgs/msg/ObjectHypothesis: string class_id, float64 score
vision_msgs/msg/ObjectHypothesisWithPose: vision_msgs/ObjectHypothesis hypothesis,
    geometry_msgs/PoseWithCovariance pose
vision_msgs/msg/BoundingBox3D: geometry_msgs/Pose center, geometry_msgs/Vector3 size
vision_msgs/msg/Detection3D: std_msgs/Header header,
    vision_msgs/ObjectHypothesisWithPose[] results, vision_msgs/BoundingBox3D bbox, string id
vision_msgs/msg/Detection3DArray: std_msgs/Header header, vision_msgs/Detection3D[] detections
visualization_msgs/msg/UVCoordinate: float32 u, float32 v
visualization_msgs/msg/MeshFile: string filename, uint8[] data
visualization_msgs/msg/Marker: std_msgs/Header header, string ns, int32 id, int32 type,
    int32 action, geometry_msgs/Pose pose, geometry_msgs/Vector3 scale, std_msgs/ColorRGBA color,
    builtin_interfaces/Duration lifetime, bool frame_locked, geometry_msgs/Point[] points,
    std_msgs/ColorRGBA[] colors, string texture_resource, sensor_msgs/CompressedImage texture,
    visualization_msgs/UVCoordinate[] uv_coordinates, string text, string mesh_resource,
    visualization_msgs/MeshFile mesh_file, bool mesh_use_embedded_materials
visualization_msgs/msg/MarkerArray: visualization_msgs/Marker[] markers
"""


class Field(NamedTuple):
    """A field of a message."""

    name: str
    kind: str
    """A primitive type as ROS calls it, or the name of a type of this module."""
    length: int | None
    """How many there are; 0: any number; None: it is no list."""


def _read_field(text: str) -> Field:
    kind, name = text.split()
    kind, bracket, length = kind.partition("[")
    full = kind.replace("/", "/msg/")
    return Field(name, full, int(length.rstrip("]") or 0) if bracket else None)


def _read_types(text: str) -> dict[str, tuple[Field, ...]]:
    lines = text.replace("\n    ", " ").split("\n")
    found = (line.split(": ", 1) for line in lines if line)
    return {name: tuple(map(_read_field, fields.split(", "))) for name, fields in found}


FIELDS = _read_types(_TEXT)
"""By type, its fields in their order; each type stands behind those that it is made of."""
