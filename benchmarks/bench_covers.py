"""How many spheres cover a robot: ours, beside the simple greedy cover at the same protrusion.

    python benchmarks/bench_covers.py panda xarm7 ur5 --protrusions 30 20

fits every link of a robot, its base included, with spheres that stick out by no more than so many
millimetres, in both ways. The greedy cover takes candidate centres on a grid, gives each ball the
radius (distance to the surface) + protrusion, and picks the ball that covers most of what is left
until nothing is. Both measure from the same surface, but the greedy cover need only hold points
spread over it, which favours it; ours is proved to hold all of it.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
from numpy.typing import NDArray

from armguard.cover.containment import is_contained
from armguard.cover.fitting import cut_pieces, fit_tree
from armguard.cover.patches import bisect_pieces
from armguard.cover.signed_distance import arrange_surface, compute_signed_distances
from armguard.cover.triangulation import triangulate
from armguard.robot.description import find_example_urdf, find_robot, read_description
from armguard.robot.links import place
from armguard.robot.urdf import read_urdf

Array = NDArray[np.float64]

CANDIDATES = 2000  # about as many grid points in the box around a link, and points on it

PUBLISHED = """
Published for Panda, as counted in the files of the projects (which are not part of this one):
  VAMP   resources/panda/panda_spherized.urdf: 59 spheres (58 on moving links)
  cuRobo content/configs/robot/spheres/franka_mesh.yml: 61 spheres (59 on moving links)
Neither is a cover: `armguard cover panda --import FILE` shows what they leave out, and
docs/covers.md what inflating them into covers costs."""


def read_links(name: str) -> dict[str, Array]:
    """Triangles of every link that has collision geometry, each in one frame, in [m]."""
    path, packages = find_example_urdf(read_description(find_robot(name) / "robot.toml").urdf)
    urdf = read_urdf(path, [packages])
    links: dict[str, list[Array]] = {}
    for geometry in urdf.collision_model.geometryObjects:
        link = str(urdf.model.frames[geometry.parentFrame].name)
        triangles = triangulate(link, geometry.geometry)
        links.setdefault(link, []).append(place(geometry.placement, triangles))
    return {link: np.concatenate(parts) for link, parts in links.items()}


def count_greedy(triangles: Array, protrusion: float) -> int:
    """Balls of the simple greedy cover of points on the surface."""
    pieces, surface = cut_pieces(triangles), arrange_surface(triangles)
    points = bisect_pieces(bisect_pieces(pieces)).mean(axis=1)
    corners = pieces.reshape(-1, 3)
    lower, extent = corners.min(axis=0), np.ptp(corners, axis=0)
    step = float(np.prod(extent) / CANDIDATES) ** (1 / 3)
    axes = [np.arange(lower[i], lower[i] + extent[i] + step, step) for i in range(3)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    centers = np.concatenate([grid, points[:: len(points) // CANDIDATES + 1]])
    radii = protrusion - compute_signed_distances(centers, surface)
    reaches = np.array(
        [
            ((points - center) ** 2).sum(axis=1) <= max(radius, 0.0) ** 2
            for center, radius in zip(centers, radii, strict=True)
        ]
    )
    is_open, count = reaches.any(axis=0), 0
    while is_open.any():
        best = int(np.argmax(np.count_nonzero(reaches & is_open, axis=1)))
        is_open &= ~reaches[best]
        count += 1
    return count


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("robots", nargs="+")
    parser.add_argument("--protrusions", nargs="+", type=float, default=[30.0, 20.0], help="mm")
    arguments = parser.parse_args()
    print("robot     protrusion  greedy    ours   fewer   fitting")
    for name in arguments.robots:
        links = read_links(name)
        for millimetres in arguments.protrusions:
            start = time.process_time()
            ours = 0
            for link, triangles in links.items():
                tree = fit_tree(triangles, protrusion=1e-3 * millimetres)
                if not is_contained(triangles, tree):
                    raise SystemExit(f"{name}: {link}: not proved")
                ours += int((tree.child_count == 0).sum())
            seconds = time.process_time() - start
            greedy = sum(count_greedy(surface, 1e-3 * millimetres) for surface in links.values())
            print(
                f"{name:10}{millimetres:7.0f} mm{greedy:9}{ours:8}{1 - ours / greedy:8.0%}"
                f"{seconds:8.1f} s",
                flush=True,
            )
    print(PUBLISHED)


if __name__ == "__main__":
    main()
