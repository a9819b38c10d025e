"""Measures what imported spheres leave uncovered, and enlarges them to a proved cover.

No sphere set of a planner covers its robot's surface. If each sphere is enlarged without being
moved, planner and monitor use corresponding spheres; a fitted cover is tighter.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from armguard.cover.containment import is_contained, tighten
from armguard.cover.cover import Cover, Surfaces, get_surface, hash_surface
from armguard.cover.fitting import cut_pieces
from armguard.cover.interchange import Spheres
from armguard.cover.patches import bisect_pieces, compute_corners, compute_hull_points
from armguard.cover.sphere_tree import MARGIN, Node, SphereTree, build_tree, enclose
from armguard.exceptions import CoverError
from armguard.jit.arrays import FloatArray


@dataclass(frozen=True)
class Gap:
    """How much of a link's surface spheres leave uncovered."""

    count: int
    """Spheres that the link has."""
    share: float
    """Part of its surface that is in none of them, measured on a few ten thousand points."""
    depth: float
    """Distance from its surface to the nearest sphere, in [m]: the largest; inf without spheres."""
    proved: bool
    """Whether its surface is proved to be inside them."""


def measure_gaps(robot: Surfaces, spheres: Spheres) -> dict[str, Gap]:
    """What is not covered, by link.

    Args:
        robot: Whose links should be.
        spheres: As `interchange.place_spheres` gives them.
    """
    gaps = {}
    for link in robot.links:
        surface = get_surface(robot, link)
        rows = spheres.get(link, np.zeros((0, 4)))
        if not len(rows):
            gaps[link] = Gap(0, 1.0, math.inf, proved=False)
            continue
        pieces = compute_corners(bisect_pieces(bisect_pieces(cut_pieces(surface))))
        sides = pieces[:, 1:] - pieces[:, :1]
        areas = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
        outside = _measure_outside(pieces.mean(axis=1), rows)
        share = float(areas[outside > 0.0].sum() / max(areas.sum(), np.finfo(float).tiny))
        corners = np.unique(pieces.reshape(-1, 3), axis=0)
        depth = max(float(outside.max()), float(_measure_outside(corners, rows).max()), 0.0)
        proved = depth == 0.0 and is_contained(surface, _make_flat_tree(surface, rows))
        gaps[link] = Gap(len(rows), share, depth, proved)
    return gaps


def inflate_spheres(robot: Surfaces, spheres: Spheres) -> Cover:
    """Grow spheres as little as a proved cover needs, without moving them.

    Each piece of surface goes to the sphere that must grow least for it; then each radius is made
    as small as the proof allows, but not smaller than it was. Spheres that no piece needs are
    left out.

    Args:
        robot: Whose links to cover.
        spheres: As `interchange.place_spheres` gives them.

    Raises:
        CoverError: A link has no spheres, or the result could not be proved.
    """
    trees, geometry = {}, {}
    for link in robot.links:
        surface = get_surface(robot, link)
        if link not in spheres or not len(spheres[link]):
            raise CoverError(f"link {link!r}", "has no spheres that could be inflated")
        trees[link] = _inflate(link, surface, spheres[link])
        geometry[link] = hash_surface(surface)
    return Cover(trees, geometry)


def _measure_outside(points: FloatArray, spheres: FloatArray) -> FloatArray:
    """Distance from each point to the nearest sphere, negative inside, in [m]. Shape (n,)."""
    nearest = np.full(len(points), math.inf)
    for sphere in spheres:
        distances = np.sqrt(((points - sphere[:3]) ** 2).sum(axis=1)) - sphere[3]
        np.minimum(nearest, distances, out=nearest)
    return nearest


def _make_flat_tree(surface: FloatArray, spheres: FloatArray) -> SphereTree:
    """All spheres as leaves below one ball that holds the whole surface."""
    corners = compute_hull_points(surface).reshape(-1, 3)
    root = enclose(corners.mean(axis=0), corners)
    count = len(spheres)
    return SphereTree(
        np.concatenate([root[None], spheres]),
        np.array([1] + [0] * count),
        np.array([count] + [0] * count),
    )


def _inflate(link: str, surface: FloatArray, spheres: FloatArray) -> SphereTree:
    pieces = compute_hull_points(bisect_pieces(bisect_pieces(cut_pieces(surface))))
    growth, owners = np.full(len(pieces), math.inf), np.zeros(len(pieces), dtype=np.int64)
    for i, sphere in enumerate(spheres):
        distances = np.sqrt(((pieces - sphere[:3]) ** 2).sum(axis=2)).max(axis=1)
        better = distances - sphere[3] < growth
        growth[better], owners[better] = distances[better] - sphere[3], i
    used = np.unique(owners)
    own = np.round(spheres[used, 3] + MARGIN, 6)
    leaves = []
    for i, radius in zip(used, own, strict=True):
        corners = np.unique(pieces[owners == i].reshape(-1, 3), axis=0)
        ball = enclose(spheres[i, :3], corners)
        ball[3] = max(ball[3], radius)
        leaves.append(Node(ball, corners, []))
    tree = build_tree(leaves)
    if not is_contained(surface, tree):
        raise CoverError(f"link {link!r}", "its inflated spheres could not be proved")
    # No leaf is made smaller than it was. Of two in one place the larger stays as it was, too.
    centers = np.array([leaf.sphere[:3] for leaf in leaves])
    is_there = (tree.spheres[:, None, :3] == centers).all(axis=2)
    least = np.where(is_there, own, 0.0).max(axis=1)
    return tighten(surface, tree, np.where(tree.child_count == 0, least, 0.0))
