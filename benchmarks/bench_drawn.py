"""How far what a URDF draws of its links sticks out of their covers.

    python benchmarks/bench_drawn.py panda ur5 ur10 xarm7 kinova tiago baxter

Covers hold collision geometry. What is drawn beside it is not proved to be inside; here each vertex
of each visual mesh is measured against the spheres of the whole arm, in random configurations: some
links are covered by what the link beside them has. Links that are drawn, but have no collision
geometry, have no cover; they are named, and not measured.

| column | what it is |
|---|---|
| link | that a watched joint moves, and whose drawing sticks out |
| outside | drawn vertices outside all spheres, of how many |
| by | the farthest one, rounded up, so that it may be given as `margin` |
"""

from __future__ import annotations

import argparse
import math
from typing import Any

import numpy as np
import pinocchio

from armguard.robot import Kinematics, Robot
from armguard.robot.description import find_example_urdf, find_robot, read_description
from armguard.robot.links import collect_surfaces
from armguard.robot.urdf import read_urdf
from scene.configurations import draw_configuration

AT_ONCE = 4096  # vertices measured together
CONFIGURATIONS = 20


def measure_robot(name: str, random: np.random.Generator) -> tuple[dict[str, Any], list[str]]:
    """By link: vertices outside, vertices, and how far the farthest is, in [m]; and bare links."""
    robot = Robot.load(name)
    description = read_description(find_robot(name) / "robot.toml")
    path, packages = find_example_urdf(description.urdf)
    urdf = read_urdf(path, [packages], description.travelling)
    drawn = pinocchio.buildGeomFromUrdf(
        urdf.model, str(path), pinocchio.GeometryType.VISUAL, package_dirs=[str(packages)]
    )
    kinematics, data = Kinematics(robot), robot.model.createData()
    found, bare = {}, []
    surfaces = collect_surfaces(urdf._replace(collision_model=drawn), robot.joints, description)
    for link, surface in surfaces.items():
        if link not in robot.links:
            bare.append(link)
            continue
        vertices = np.unique(surface.triangles.reshape(-1, 3), axis=0)
        own = measure(vertices, robot.cover.spheres(link))
        outside, farthest = vertices[own > 0.0], 0.0
        is_outside = np.zeros(len(outside), dtype=bool)
        for _ in range(CONFIGURATIONS if len(outside) else 0):
            q = draw_configuration(robot, random)
            kinematics.compute(q, np.zeros(len(q)))
            pinocchio.forwardKinematics(robot.model, data, q)
            leaves = kinematics.spheres.child_count == 0
            spheres = np.column_stack([kinematics.centers, kinematics.spheres.radius])[leaves]
            joint = data.oMi[robot.joint_index(link)]
            beyond = measure(outside @ joint.rotation.T + joint.translation, spheres)
            is_outside |= beyond > 0.0
            farthest = max(farthest, float(beyond.max()))
        found[link] = int(is_outside.sum()), len(vertices), farthest
    return found, bare


def measure(points: np.ndarray, spheres: np.ndarray) -> np.ndarray:
    """How far points are outside all spheres, in [m]; negative inside one. Shape (n,)."""
    parts = np.array_split(points, math.ceil(max(len(points), 1) / AT_ONCE))
    distances = [
        np.linalg.norm(part[:, None] - spheres[:, :3], axis=2) - spheres[:, 3] for part in parts
    ]
    return np.concatenate([part.min(axis=1) for part in distances])


def main() -> None:
    """Print a table for each robot."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("robots", nargs="+")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    random = np.random.default_rng(arguments.seed)
    for name in arguments.robots:
        found, bare = measure_robot(name, random)
        most = max(beyond for _, _, beyond in found.values())
        print(f"{name}: up to {math.ceil(1e4 * max(most, 0.0)) / 10:.1f} mm")
        for link, (outside, count, beyond) in found.items():
            if outside:
                by = math.ceil(1e4 * beyond) / 10
                print(f"  {link:28}{outside:7} of {count:7} outside, by {by:.1f} mm")
        if bare:
            print(f"  drawn without collision geometry: {', '.join(bare)}")


if __name__ == "__main__":
    main()
