"""Writes the models of Universal Robots' e-Series in robots/: their kinematics, and hulls of links.

    git clone https://github.com/UniversalRobots/Universal_Robots_ROS2_Description description
    python benchmarks/make_ur.py description

Frames are those of ROS. Lengths, masses, inertias, and efforts are what the files there say; the
lengths are the Denavit-Hartenberg parameters that Universal Robots publishes. Nothing of the meshes
is copied: each link is the polyhedron between planes in 26 directions that stand `MARGIN` outside
of its mesh. A convex body that contains all vertices contains the mesh.
"""

from __future__ import annotations

import itertools
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio
import yaml

from armguard.cover.triangulation import hull_triangles

MODELS = "ur3e", "ur5e", "ur10e"

MARGIN = 2e-3
"""[m]. For what the collision meshes leave out of the arm, and for rounding here."""

ROBOTS = Path(__file__).resolve().parents[1] / "robots"

LINKS = "shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3"
JOINTS = (
    "shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint",
    "wrist_3_joint",
)  # fmt: skip

Values = dict[str, Any]


def _skip_tag(loader: yaml.SafeLoader, tag: str, node: yaml.Node) -> Any:
    """Degrees as they are written: no angle of the file is used."""
    return loader.construct_object(yaml.ScalarNode("tag:yaml.org,2002:float", node.value))


class Loader(yaml.SafeLoader):
    """Reads what ROS's xacro does."""


Loader.add_multi_constructor("!", _skip_tag)


def read(folder: Path, name: str) -> Values:
    """A file of parameters."""
    found: Values = yaml.load((folder / f"{name}.yaml").read_text(encoding="utf-8"), Loader)
    return found


def read_stl(path: Path) -> np.ndarray:
    """Vertices of a binary STL, in [m]. Shape (n, 3)."""
    data = path.read_bytes()
    count = int.from_bytes(data[80:84], "little")
    records = np.frombuffer(data[84:], np.uint8).reshape(count, 50)
    corners = np.ascontiguousarray(records[:, 12:48]).view("<f4").reshape(-1, 3)
    return np.unique(corners.astype(np.float64), axis=0)


def find_turn(link: str) -> tuple[float, float, float]:
    """How the mesh of a link is turned in its frame, as roll, pitch, and yaw in [rad]."""
    if link in ("base", "shoulder"):
        return 0.0, 0.0, np.pi
    if link in ("upper_arm", "forearm"):
        return 0.5 * np.pi, 0.0, -0.5 * np.pi
    return (0.0 if link == "wrist_2" else 0.5 * np.pi), 0.0, 0.0


def find_offset(link: str, physical: Values, visual: Values) -> float:
    """How far along z the mesh of a link is in its frame, in [m]."""
    if link in ("upper_arm", "forearm"):
        name = {"upper_arm": "shoulder_offset", "forearm": "elbow_offset"}[link]
        return float(physical["offsets"][name])
    return float(visual["mesh_files"][link].get("visual_offset", 0.0))


def enclose(points: np.ndarray) -> np.ndarray:
    """Corners of a polyhedron that contains points with `MARGIN`, in [m]. Shape (n, 3)."""
    steps = np.array([one for one in itertools.product((-1, 0, 1), repeat=3) if any(one)], float)
    normals = steps / np.linalg.norm(steps, axis=1, keepdims=True)
    offsets = (points @ normals.T).max(axis=0) + MARGIN
    corners = []
    for three in itertools.combinations(range(len(normals)), 3):
        if abs(np.linalg.det(normals[list(three)])) > 1e-9:
            corner = np.linalg.solve(normals[list(three)], offsets[list(three)])
            if (normals @ corner <= offsets + 1e-9).all():
                corners.append(corner)
    return np.unique(np.round(corners, 4), axis=0)


def spell_mesh(link: str, corners: np.ndarray) -> str:
    """The hull of corners, as OBJ."""
    numbers = {tuple(corner): i for i, corner in enumerate(corners.tolist(), 1)}
    lines = ["v " + " ".join(f"{x:g}" for x in corner) for corner in numbers]
    for triangle in hull_triangles(link, corners).tolist():
        lines.append("f " + " ".join(str(numbers[tuple(corner)]) for corner in triangle))
    return "\n".join(lines) + "\n"


def spell(values: Values, *names: str) -> str:
    """Some values, with as many digits as they need."""
    return " ".join(f"{round(float(values[name]), 10) + 0.0:.10g}" for name in names)


def spell_link(link: str, inertial: Values | None) -> list[str]:
    """One link, which has a mesh of its name."""
    shape = f'<geometry><mesh filename="{link}_link.obj"/></geometry>'
    lines = [f'  <link name="{link}_link">', f"    <visual>{shape}</visual>"]
    lines.append(f"    <collision>{shape}</collision>")
    if inertial is not None:
        turn, tensor = inertial["rotation"][link], inertial["tensor"][link]
        place = inertial["center_of_mass"][f"{link}_cog"]
        moments = " ".join(
            f'{name}="{spell(tensor, name)}"' for name in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
        )
        lines += [
            "    <inertial>",
            f'      <origin xyz="{spell(place, "x", "y", "z")}"'
            f' rpy="{spell(turn, "roll", "pitch", "yaw")}"/>',
            f'      <mass value="{spell(inertial, f"{link}_mass")}"/>',
            f"      <inertia {moments}/>",
            "    </inertial>",
        ]
    return [*lines, "  </link>"]


def spell_urdf(name: str, folder: Path) -> str:
    """The model, as URDF."""
    inertial = read(folder, "physical_parameters")["inertia_parameters"]
    limits = read(folder, "joint_limits")["joint_limits"]
    kinematics = read(folder, "default_kinematics")["kinematics"]
    lines = spell_link("base", None)
    for link in LINKS:
        lines += spell_link(link, inertial)
    parent = "base_link"
    for link, joint in zip(LINKS, JOINTS, strict=True):
        place = dict(kinematics[link])
        if parent == "base_link":
            # ROS turns the base by half a turn against the controller's.
            place["yaw"] = np.pi
        lines += [
            f'  <joint name="{joint}" type="revolute">',
            f'    <parent link="{parent}"/>',
            f'    <child link="{link}_link"/>',
            f'    <origin xyz="{spell(place, "x", "y", "z")}"'
            f' rpy="{spell(place, "roll", "pitch", "yaw")}"/>',
            '    <axis xyz="0 0 1"/>',
            f'    <limit lower="{-2.0 * np.pi!r}" upper="{2.0 * np.pi!r}"'
            f' effort="{limits[joint]["max_effort"]:g}"'
            f' velocity="{np.radians(limits[joint]["max_velocity"]):.10g}"/>',
            "  </joint>",
        ]
        parent = f"{link}_link"
    lines += [
        '  <link name="tool0"/>',
        '  <joint name="tool0_joint" type="fixed">',
        f'    <parent link="{parent}"/>',
        '    <child link="tool0"/>',
        "  </joint>",
    ]
    about = "  <!-- written by benchmarks/make_ur.py: README.md says from what -->"
    return "\n".join([f'<robot name="{name}">', about, *lines, "</robot>\n"])


def write(description: Path, name: str) -> None:
    """Write one model and its meshes."""
    folder, out = description / "config" / name, ROBOTS / name
    physical, visual = read(folder, "physical_parameters"), read(folder, "visual_parameters")
    out.mkdir(exist_ok=True)
    (out / f"{name}.urdf").write_text(spell_urdf(name, folder), encoding="utf-8")
    for link in ("base", *LINKS):
        mesh = str(visual["mesh_files"][link]["collision"]["mesh"]["path"])
        turn = pinocchio.rpy.rpyToMatrix(*find_turn(link))
        if link == "base":
            turn = pinocchio.rpy.rpyToMatrix(0.0, 0.0, np.pi) @ turn
        points = read_stl(description / mesh) @ turn.T
        points[:, 2] += find_offset(link, physical, visual)
        text = spell_mesh(f"{link}_link", enclose(points))
        (out / f"{link}_link.obj").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    for model in MODELS:
        write(Path(sys.argv[1]), model)
