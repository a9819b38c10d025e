"""Writes robots/ur5e/ur5e.urdf: Universal Robots' kinematics, and hulls around published meshes.

    pip download --no-deps robosuite==1.5.2 && unzip robosuite-1.5.2*.whl -d wheel
    python benchmarks/make_ur5e.py wheel/robosuite/models/assets/robots/ur5e/robot.xml

Lengths are Denavit-Hartenberg parameters as Universal Robots publishes them. Nothing of the meshes
is copied: each link is the polyhedron between planes in 26 directions that stand `MARGIN` outside
of its mesh. A convex body that contains all vertices contains the mesh.
"""

from __future__ import annotations

import itertools
import sys
from pathlib import Path

import numpy as np

from armguard.cover.triangulation import hull_triangles, triangulate
from armguard.robot.mjcf import read_mjcf

MARGIN = 2e-3
"""[m]. For lengths that the meshes' model rounds to millimetres, and for rounding here."""

OUT = Path(__file__).resolve().parents[1] / "robots" / "ur5e"

D1, A2, A3, D4, D5, D6 = 0.1625, 0.425, 0.3922, 0.1333, 0.0997, 0.0996
"""[m]. universal-robots.com, "Parameters for calculations of kinematics and dynamics", UR5e."""

SHOULDER, ELBOW = 0.138, -0.131
"""[m]. Where along their axes the frames of upper arm and forearm lie: free to choose."""

TURN = 2.0 * np.pi  # [rad]

LINKS = (
    ("base_link", "shoulder_link", "shoulder_pan_joint", (0.0, 0.0, D1), 0.0, "0 0 1"),
    ("shoulder_link", "upper_arm_link", "shoulder_lift_joint", (0.0, SHOULDER, 0.0), 0.25, "0 1 0"),
    ("upper_arm_link", "forearm_link", "elbow_joint", (0.0, ELBOW, A2), 0.0, "0 1 0"),
    ("forearm_link", "wrist_1_link", "wrist_1_joint", (0.0, 0.0, A3), 0.25, "0 1 0"),
    ("wrist_1_link", "wrist_2_link", "wrist_2_joint", (0.0, D4 - SHOULDER - ELBOW, 0.0), 0.0,
     "0 0 1"),
    ("wrist_2_link", "wrist_3_link", "wrist_3_joint", (0.0, 0.0, D5), 0.0, "0 1 0"),
)  # fmt: skip
"""Parent, name, joint, position in the parent [m], turns about y, axis of the joint."""


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


def find_corners(source: Path) -> dict[str, np.ndarray]:
    """Corners of the polyhedron around each link of a published model, in [m]. Shapes (n, 3)."""
    published = read_mjcf(source)
    points: dict[str, list[np.ndarray]] = {}
    for geometry in published.collision_model.geometryObjects:
        link = str(published.model.frames[geometry.parentFrame].name)
        place = geometry.placement
        triangles = triangulate(link, geometry.geometry).reshape(-1, 3)
        moved = triangles @ place.rotation.T + place.translation
        points.setdefault(link.replace("fixed_base_link", "base_link"), []).append(moved)
    return {link: enclose(np.concatenate(found)) for link, found in points.items()}


def spell_mesh(link: str, corners: np.ndarray) -> str:
    """The hull of corners, as OBJ."""
    numbers = {tuple(corner): i for i, corner in enumerate(corners.tolist(), 1)}
    lines = ["v " + " ".join(f"{x:g}" for x in corner) for corner in numbers]
    for triangle in hull_triangles(link, corners).tolist():
        lines.append("f " + " ".join(str(numbers[tuple(corner)]) for corner in triangle))
    return "\n".join(lines) + "\n"


def spell_urdf(links: list[str]) -> str:
    """The model, as URDF; each link has a mesh of its name."""
    lines = []
    for link in links:
        shape = f'<geometry><mesh filename="{link}.obj"/></geometry>'
        lines += [f'  <link name="{link}">', f"    <visual>{shape}</visual>"]
        lines += [f"    <collision>{shape}</collision>", "  </link>"]
    for parent, link, joint, position, turns, axis in LINKS:
        place = " ".join(f"{x:g}" for x in np.round(position, 6))
        lines += [
            f'  <joint name="{joint}" type="revolute">',
            f'    <parent link="{parent}"/>',
            f'    <child link="{link}"/>',
            f'    <origin xyz="{place}" rpy="0 {TURN * turns!r} 0"/>',
            f'    <axis xyz="{axis}"/>',
            f'    <limit lower="{-TURN!r}" upper="{TURN!r}" effort="0" velocity="0"/>',
            "  </joint>",
        ]
    lines += [
        '  <link name="flange"/>',
        '  <joint name="flange_joint" type="fixed">',
        '    <parent link="wrist_3_link"/>',
        '    <child link="flange"/>',
        f'    <origin xyz="0 {D6} 0" rpy="{-0.25 * TURN!r} 0 0"/>',
        "  </joint>",
    ]
    return "\n".join(
        [
            '<robot name="ur5e">',
            "  <!-- written by benchmarks/make_ur5e.py: README.md says from what -->",
            *lines,
            "</robot>\n",
        ]
    )


def write(corners: dict[str, np.ndarray]) -> None:
    """Write the model and its meshes."""
    for link, found in corners.items():
        (OUT / f"{link}.obj").write_text(spell_mesh(link, found), encoding="utf-8")
    (OUT / "ur5e.urdf").write_text(spell_urdf(list(corners)), encoding="utf-8")


if __name__ == "__main__":
    write(find_corners(Path(sys.argv[1])))
