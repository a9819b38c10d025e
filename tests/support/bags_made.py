"""Recordings of others, written by `rosbags` as ROS 2 would."""

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

PERCEPTION = {
    "vision_msgs/msg/ObjectHypothesis": "string class_id\nfloat64 score\n",
    "vision_msgs/msg/ObjectHypothesisWithPose": (
        "vision_msgs/ObjectHypothesis hypothesis\ngeometry_msgs/PoseWithCovariance pose\n"
    ),
    "vision_msgs/msg/BoundingBox3D": "geometry_msgs/Pose center\ngeometry_msgs/Vector3 size\n",
    "vision_msgs/msg/Detection3D": (
        "std_msgs/Header header\nvision_msgs/ObjectHypothesisWithPose[] results\n"
        "vision_msgs/BoundingBox3D bbox\nstring id\n"
    ),
    "people_msgs/msg/Person": (
        "string name\ngeometry_msgs/Point position\ngeometry_msgs/Point velocity\n"
        "float64 reliability\nstring[] tagnames\nstring[] tags\n"
    ),
    "people_msgs/msg/People": "std_msgs/Header header\npeople_msgs/Person[] people\n",
    "vision_msgs/msg/Detection3DArray": (
        "std_msgs/Header header\nvision_msgs/Detection3D[] detections\n"
    ),
}
START = 1_700_000_000_000_000_000
NAMES = [f"panda_joint{number}" for number in range(1, 8)]
READY = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]


def make_types():
    """All message types that tests write."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    types = {}
    for name, text in PERCEPTION.items():
        types.update(get_types_from_msg(text, name))
    store.register(types)
    return store


STORE = make_types()
T = STORE.types


def header(seconds, frame="world"):
    sec, nanosec = divmod(START + round(1e9 * seconds), 1_000_000_000)
    return T["std_msgs/msg/Header"](T["builtin_interfaces/msg/Time"](sec, nanosec), frame)


def point(x, y, z):
    return T["geometry_msgs/msg/Point"](float(x), float(y), float(z))


def vector(x, y, z):
    return T["geometry_msgs/msg/Vector3"](float(x), float(y), float(z))


def pose(position, turn=(0.0, 0.0, 0.0, 1.0)):
    orientation = T["geometry_msgs/msg/Quaternion"](*map(float, turn))
    return T["geometry_msgs/msg/Pose"](point(*position), orientation)


def joint_state(seconds, names=NAMES, q=READY, v=None):
    v = [0.0] * len(q) if v is None else v
    arrays = (np.array(values, dtype=float) for values in (q, v, []))
    return T["sensor_msgs/msg/JointState"](header(seconds), list(names), *arrays)


def pose_array(seconds, positions, frame="world"):
    poses = [pose(position) for position in positions]
    return T["geometry_msgs/msg/PoseArray"](header(seconds, frame), poses)


def marker(seconds, kind, id=0, *, ns="", action=0, at=(0, 0, 0), scale=(1, 1, 1), **more):
    color = T["std_msgs/msg/ColorRGBA"](1.0, 1.0, 1.0, 1.0)
    fields = {
        "lifetime": T["builtin_interfaces/msg/Duration"](0, 0),
        "frame_locked": False,
        "points": [point(*one) for one in more.pop("points", [])],
        "colors": [],
        "texture_resource": "",
        "texture": T["sensor_msgs/msg/CompressedImage"](header(0.0), "", np.zeros(0, np.uint8)),
        "uv_coordinates": [],
        "text": "",
        "mesh_resource": "",
        "mesh_file": T["visualization_msgs/msg/MeshFile"]("", np.zeros(0, np.uint8)),
        "mesh_use_embedded_materials": False,
    }
    place = pose(at, more.pop("turn", (0.0, 0.0, 0.0, 1.0)))
    return T["visualization_msgs/msg/Marker"](
        header=header(seconds, more.pop("frame", "world")),
        ns=ns,
        id=id,
        type=kind,
        action=action,
        pose=place,
        scale=vector(*scale),
        color=color,
        **fields,
    )


def markers(*made):
    return T["visualization_msgs/msg/MarkerArray"](list(made))


def detections(seconds, boxes, frame="world"):
    """Boxes as (id, position, size)."""
    found = [
        T["vision_msgs/msg/Detection3D"](
            header(seconds, frame),
            [],
            T["vision_msgs/msg/BoundingBox3D"](pose(position), vector(*size)),
            id,
        )
        for id, position, size in boxes
    ]
    return T["vision_msgs/msg/Detection3DArray"](header(seconds, frame), found)


def people(seconds, found, frame="world"):
    """People as (name, position)."""
    made = [
        T["people_msgs/msg/Person"](name, point(*at), point(0, 0, 0), 1.0, [], [])
        for name, at in found
    ]
    return T["people_msgs/msg/People"](header(seconds, frame), made)


def transforms(*made):
    """Transforms without a turn, as (seconds, parent, child, translation)."""
    still = T["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
    told = [
        T["geometry_msgs/msg/TransformStamped"](
            header(seconds, parent), child, T["geometry_msgs/msg/Transform"](vector(*at), still)
        )
        for seconds, parent, child, at in made
    ]
    return T["tf2_msgs/msg/TFMessage"](told)


def write_bag(path, messages, plugin="mcap"):
    """Write messages as (seconds, topic, message); the folder that ROS 2 would make."""
    storage = StoragePlugin.MCAP if plugin == "mcap" else StoragePlugin.SQLITE3
    with Writer(path, version=9, storage_plugin=storage) as writer:
        connections = {}
        for seconds, topic, message in messages:
            kind = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=STORE)
            data = STORE.serialize_cdr(message, kind)
            writer.write(connections[topic], START + round(1e9 * seconds), data)
    return path


def usual(count=20):
    """Joint states at 100 Hz and a ball at 50 Hz, both recorded 2 ms after they were measured."""
    messages = []
    for k in range(count):
        now = 0.01 * k
        if k % 2 == 0:
            ball = pose_array(now, [(3.0 - now, 0.0, 0.5)])
            messages.append((now + 0.002, "/people", ball))
        messages.append((now + 0.002, "/joint_states", joint_state(now)))
    return messages
