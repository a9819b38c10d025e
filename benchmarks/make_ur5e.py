"""Writes robots/ur5e/ur5e.xml: Universal Robots' kinematics, and hulls around published meshes.

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

from armguard.cover.triangulation import triangulate
from armguard.robot.mjcf import read_mjcf

MARGIN = 2e-3
"""[m]. For lengths that the meshes' model rounds to millimetres, and for rounding here."""

OUT = Path(__file__).resolve().parents[1] / "robots" / "ur5e" / "ur5e.xml"

D1, A2, A3, D4, D5, D6 = 0.1625, 0.425, 0.3922, 0.1333, 0.0997, 0.0996
"""[m]. universal-robots.com, "Parameters for calculations of kinematics and dynamics", UR5e."""

SHOULDER, ELBOW = 0.138, -0.131
"""[m]. Where along their axes the frames of upper arm and forearm lie: free to choose."""

BODIES = (
    ("shoulder_link", "shoulder_pan_joint", (0.0, 0.0, D1), 0.0, "0 0 1"),
    ("upper_arm_link", "shoulder_lift_joint", (0.0, SHOULDER, 0.0), 90.0, "0 1 0"),
    ("forearm_link", "elbow_joint", (0.0, ELBOW, A2), 0.0, "0 1 0"),
    ("wrist_1_link", "wrist_1_joint", (0.0, 0.0, A3), 90.0, "0 1 0"),
    ("wrist_2_link", "wrist_2_joint", (0.0, D4 - SHOULDER - ELBOW, 0.0), 0.0, "0 0 1"),
    ("wrist_3_link", "wrist_3_joint", (0.0, 0.0, D5), 0.0, "0 1 0"),
)
"""Name, joint, position in its parent [m], turn about y [deg], axis of the joint."""


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


def write(source: Path) -> str:
    """The model, as MJCF."""
    published = read_mjcf(source)
    points: dict[str, list[np.ndarray]] = {}
    for geometry in published.collision_model.geometryObjects:
        link = str(published.model.frames[geometry.parentFrame].name)
        place = geometry.placement
        triangles = triangulate(link, geometry.geometry).reshape(-1, 3)
        moved = triangles @ place.rotation.T + place.translation
        points.setdefault(link.replace("fixed_base_link", "base_link"), []).append(moved)
    meshes = "\n".join(
        f'    <mesh name="{link}" vertex="'
        + "  ".join(" ".join(f"{x:g}" for x in corner) for corner in enclose(np.concatenate(found)))
        + '"/>'
        for link, found in points.items()
    )
    lines, indent = [], "      "
    for name, joint, position, turn, axis in BODIES:
        place = " ".join(f"{x:g}" for x in np.round(position, 6))
        lines += [
            f'{indent}<body name="{name}" pos="{place}" euler="0 {turn:g} 0">',
            f'{indent}  <joint name="{joint}" axis="{axis}"/>',
            f'{indent}  <geom mesh="{name}"/>',
        ]
        indent += "  "
    lines.append(f'{indent}<body name="flange" pos="0 {D6} 0" euler="-90 0 0"/>')
    lines += [f"{'  ' * k}      </body>" for k in reversed(range(len(BODIES)))]
    bodies = "\n".join(lines)
    return f"""<mujoco model="ur5e">
  <!-- written by benchmarks/make_ur5e.py: README.md says from what -->
  <compiler angle="degree"/>
  <default>
    <joint range="-360 360"/>
    <geom type="mesh"/>
  </default>
  <asset>
{meshes}
  </asset>
  <worldbody>
    <body name="base_link">
      <geom mesh="base_link"/>
{bodies}
    </body>
  </worldbody>
</mujoco>
"""


if __name__ == "__main__":
    OUT.write_text(write(Path(sys.argv[1])), encoding="utf-8")
