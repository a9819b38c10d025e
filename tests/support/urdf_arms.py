"""Small arms, written as URDF files, and limits for them."""

import struct

import numpy as np

from armguard.robot.brakes import Brakes

BOX = '<geometry><box size="0.1 0.06 0.04"/></geometry>'
SOURCES = dict.fromkeys(("position", "velocity", "acceleration", "braking"), "a test")


def entry(**changes):
    limits = {"velocity": 1.0, "acceleration": 5.0, "position": [-1.0, 2.0]}
    return {key: value for key, value in (limits | changes).items() if value is not None}


def brakes_for(*joints, deceleration=2.0, **changes):
    """One row of brakes that hold one deceleration up to 1 kg and faster than any joint goes."""
    row = {"load": 1.0, "speed": dict.fromkeys(joints, 10.0), "deceleration": deceleration}
    return {key: value for key, value in (row | changes).items() if value is not None}


def hold(decelerations):
    """Brakes that hold one deceleration of each joint, whatever its speed and the load."""
    return Brakes.constant(range(len(decelerations)), decelerations).make_curves()


def limits_for(*joints, locked=None, brakes=None, **changes):
    described = {joint: entry(**changes) for joint in joints}
    brakes = [brakes_for(*joints)] if brakes is None else brakes
    return {"sources": SOURCES, "joints": described, "brakes": brakes, "locked": locked or {}}


def joint_xml(name, parent, child, kind="revolute", extra=""):
    return f"""<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>
        <origin xyz="0 0 0.3" rpy="0.3 0 0"/><axis xyz="0 0.6 0.8"/>
        <limit lower="-1" upper="2" effort="10" velocity="1"/>{extra}</joint>"""


def link_xml(name, geometry=BOX):
    collision = f"<collision>{geometry}</collision>" if geometry else ""
    return f'<link name="{name}">{collision}</link>'


def write_urdf(folder, *elements):
    path = folder / "arm.urdf"
    path.write_text(f'<robot name="arm">{"".join(elements)}</robot>')
    return path


def two_links(folder, geometry=BOX, kind="revolute", extra=""):
    return write_urdf(
        folder,
        link_xml("base"),
        link_xml("upper", geometry),
        joint_xml("shoulder", "base", "upper", kind, extra),
    )


def write_stl(path, triangles):
    body = b"".join(struct.pack("<12fH", 0, 0, 1, *np.ravel(triangle), 0) for triangle in triangles)
    path.write_bytes(b"\0" * 80 + struct.pack("<I", len(triangles)) + body)


def mesh_xml(name):
    return f'<geometry><mesh filename="{name}"/></geometry>'
