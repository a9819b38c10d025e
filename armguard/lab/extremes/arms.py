"""Arms of any number of joints, and covers of any number of spheres, for extremes."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from armguard.cover.cover import Cover, CoverTree, Surfaces, hash_surface
from armguard.robot.links import UrdfLinks
from armguard.robot.robot import Robot

SIZE = (0.08, 0.06, 0.1)
"""Of each link, a box, in [m]."""

SPACING = 0.12
"""Between two joints, in [m]."""

OVERLAP = 1.1
"""Radius of the balls of a grid, over what would just fill it."""


def make_arm(joints: int, edge: int = 2) -> Robot:
    """A chain of equal links, which turn about z and y by turns, in covers of edge³ balls a link.

    Args:
        joints: How many.
        edge: Balls along each side of a link.

    Raises:
        ArmguardError: No such robot can be made, or the balls do not cover it.
    """
    names = [f"joint{number}" for number in range(joints)]
    parts = ['<link name="base"/>']
    for number, name in enumerate(names):
        axis = "0 0 1" if number % 2 == 0 else "0 1 0"
        parent = f"link{number - 1}" if number else "base"
        size = " ".join(map(str, SIZE))
        parts.append(
            f'<link name="link{number}"><collision><origin xyz="0 0 {SPACING / 2}"/>'
            f'<geometry><box size="{size}"/></geometry></collision></link>'
            f'<joint name="{name}" type="revolute"><parent link="{parent}"/>'
            f'<child link="link{number}"/><origin xyz="0 0 {SPACING if number else 0.0}"/>'
            f'<axis xyz="{axis}"/><limit lower="-2" upper="2" effort="10" velocity="2"/></joint>'
        )
    limits: dict[str, Any] = {
        "sources": dict.fromkeys(("position", "velocity", "acceleration", "braking"), "CHOSEN"),
        "joints": {
            name: {"velocity": 2.0, "acceleration": 10.0, "position": [-2.0, 2.0]} for name in names
        },
        "brakes": [{"load": 1.0, "speed": dict.fromkeys(names, 4.0), "deceleration": 5.0}],
    }
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "chain.urdf"
        path.write_text(f'<robot name="chain">{"".join(parts)}</robot>', encoding="utf-8")
        cover = Path(folder) / "cover.json"
        make_grid_cover(UrdfLinks(path), edge).save(cover)
        return Robot.from_urdf(path, limits=limits, cover=cover)


def make_grid_cover(robot: Surfaces, edge: int) -> Cover:
    """A cover of edge³ balls a link, below one that holds them all; proved by who takes it.

    Args:
        robot: Whose links are boxes of `SIZE`, as those of `make_arm`.
        edge: Balls along each side of a link.
    """
    size = np.array(SIZE)
    steps = (np.arange(edge) + 0.5) / edge - 0.5
    centers = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)
    centers = centers * size + [0.0, 0.0, SPACING / 2]
    half = 0.5 * float(np.linalg.norm(size))
    leaves = np.column_stack([centers, np.full(len(centers), OVERLAP * half / edge)])
    root = [0.0, 0.0, SPACING / 2, OVERLAP * half]
    count = np.zeros(len(leaves) + 1, dtype=np.int64)
    first = count.copy()
    first[0], count[0] = 1, len(leaves)
    tree = CoverTree(np.vstack([root, leaves]), first, count)
    if edge == 1:
        tree = CoverTree(leaves, first[:1] * 0, count[:1] * 0)
    return Cover(
        dict.fromkeys(robot.links, tree),
        {link: hash_surface(robot.surface(link)) for link in robot.links},
    )
