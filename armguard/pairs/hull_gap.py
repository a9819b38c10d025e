"""How far a link truly is from an obstacle, at the least: compiled, for many pairs in a tick.

What `hull_distance` answers by Coal is here a walk over simplices of the difference of two hulls,
Gilbert, Johnson and Keerthi's [Gilbert1988]_. Each of its steps finds the corners of both bodies
that are extreme along a direction, and that direction proves a gap: along any unit vector, what
lies between the two bodies is at most their distance. The greatest gap that was proved is the
answer, so a walk that ends early, or loses its way in a flat hull, costs tightness only.

Vertices stay in the frame of their link: the few corners of an obstacle are brought there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from armguard.contact.gjk import nearest_on_segment, nearest_on_triangle
from armguard.jit.arrays import FloatArray, IntArray
from armguard.jit.kernels import kernel
from armguard.jit.numerics import HULL_ROUNDING
from armguard.obstacles.table import MAXIMUM_POINTS
from armguard.robot.kinematics import ArmPlacement

MAX_STEPS = 32
"""After so many the best of what was proved must do; bodies that are apart take three to eight."""

TOLERANCE = 1e-6
ABSOLUTE_TOLERANCE = 1e-8
"""A gap this close to the distance, relative to it or in [m], is not made any better."""


class LinkHulls(NamedTuple):
    """Vertices of all links, by link, and room for a walk."""

    vertices: FloatArray
    """In the frame of each link's parent joint, [m]. Shape (v, 3)."""
    first: IntArray
    """First vertex of each link, and the end of the last one's. Shape (links + 1,)."""
    joint: IntArray
    """Pinocchio's index of each link's parent joint. Shape (links,)."""
    middle: FloatArray
    """Mean vertex of each link, [m]. Shape (links, 3)."""
    reach: FloatArray
    """Largest coordinate of each link's vertices, [m]. Shape (links,)."""
    corners: FloatArray
    """Room to work in: an obstacle's corners in a link's frame, [m]. Shape (8, 3)."""
    simplex: FloatArray
    """Room to work in: corners of the simplex and of what it becomes, [m]. Shape (8, 3)."""
    members: IntArray
    """Room to work in: which pair of corners each of those is. Shape (8,)."""


def lay_out_hulls(hulls: Sequence[FloatArray], joints: Sequence[int]) -> LinkHulls:
    """The hulls of a robot's links.

    Args:
        hulls: Vertices of each link in the frame of its parent joint, in [m]. Shapes (v, 3).
        joints: Pinocchio's index of each link's parent joint.
    """
    return LinkHulls(
        vertices=np.ascontiguousarray(np.concatenate(hulls)),
        first=np.cumsum([0, *map(len, hulls)]),
        joint=np.array(joints, dtype=np.int64),
        middle=np.array([vertices.mean(axis=0) for vertices in hulls]),
        reach=np.array([np.abs(vertices).max() for vertices in hulls]),
        corners=np.zeros((MAXIMUM_POINTS, 3)),
        simplex=np.zeros((8, 3)),
        members=np.zeros(8, dtype=np.int64),
    )


@kernel
def _find_farthest(hulls: LinkHulls, link: int, x: float, y: float, z: float) -> tuple[int, float]:
    """Vertex of a link that is farthest along a direction, and how far that is."""
    found, farthest = -1, -math.inf
    for i in range(hulls.first[link], hulls.first[link + 1]):
        along = hulls.vertices[i, 0] * x + hulls.vertices[i, 1] * y + hulls.vertices[i, 2] * z
        if along > farthest:
            found, farthest = i, along
    return found, farthest


@kernel
def _find_nearest(
    corners: FloatArray, count: int, x: float, y: float, z: float
) -> tuple[int, float]:
    """Corner of an obstacle that is nearest along a direction, and how far that is."""
    found, nearest = -1, math.inf
    for j in range(count):
        along = corners[j, 0] * x + corners[j, 1] * y + corners[j, 2] * z
        if along < nearest:
            found, nearest = j, along
    return found, nearest


@kernel
def _triangle(simplex: FloatArray, i: int, j: int, k: int) -> tuple[float, float, float]:
    """Weights of j and k in the point of a triangle nearest to the origin, and its square."""
    b, c = nearest_on_triangle(
        simplex[i, 0], simplex[i, 1], simplex[i, 2],
        simplex[j, 0], simplex[j, 1], simplex[j, 2],
        simplex[k, 0], simplex[k, 1], simplex[k, 2],
    )  # fmt: skip
    square = 0.0
    for axis in range(3):
        a = simplex[i, axis]
        square += (a + b * (simplex[j, axis] - a) + c * (simplex[k, axis] - a)) ** 2
    return b, c, square


@kernel
def _shrink(simplex: FloatArray, members: IntArray, size: int) -> tuple[int, float, float, float]:
    """Keep of a simplex what holds its point nearest to the origin: how many corners, that point.

    Of four corners the last one is new, and the nearest point lies on a face that it belongs to.
    """
    i, j, k = 0, 1, 2
    b, c = 0.0, 0.0
    if size == 2:
        b = nearest_on_segment(
            simplex[0, 0], simplex[0, 1], simplex[0, 2],
            simplex[1, 0], simplex[1, 1], simplex[1, 2],
        )  # fmt: skip
        k = 1
    elif size == 3:
        b, c, _ = _triangle(simplex, 0, 1, 2)
    elif size == 4:
        i, j, k = 3, 0, 1
        b, c, best = _triangle(simplex, 3, 0, 1)
        other_b, other_c, square = _triangle(simplex, 3, 0, 2)
        if square < best:
            b, c, best, k = other_b, other_c, square, 2
        other_b, other_c, square = _triangle(simplex, 3, 1, 2)
        if square < best:
            b, c, j, k = other_b, other_c, 1, 2
    # The nearest point, then the corners that have a part in it, moved to the front.
    x = simplex[i, 0] + b * (simplex[j, 0] - simplex[i, 0]) + c * (simplex[k, 0] - simplex[i, 0])
    y = simplex[i, 1] + b * (simplex[j, 1] - simplex[i, 1]) + c * (simplex[k, 1] - simplex[i, 1])
    z = simplex[i, 2] + b * (simplex[j, 2] - simplex[i, 2]) + c * (simplex[k, 2] - simplex[i, 2])
    kept = 0
    for corner, weight in ((i, 1.0 - b - c), (j, b), (k, c)):
        if weight > 0.0:
            for axis in range(3):
                simplex[4 + kept, axis] = simplex[corner, axis]
            members[4 + kept] = members[corner]
            kept += 1
    for corner in range(kept):
        for axis in range(3):
            simplex[corner, axis] = simplex[4 + corner, axis]
        members[corner] = members[4 + corner]
    return kept, x, y, z


@kernel
def _prove_gap(hulls: LinkHulls, link: int, count: int) -> float:
    """Greatest gap between a link and the first `count` corners that a walk has proved, [m]."""
    corners, simplex, members = hulls.corners, hulls.simplex, hulls.members
    x, y, z = -hulls.middle[link, 0], -hulls.middle[link, 1], -hulls.middle[link, 2]
    for j in range(count):
        x += corners[j, 0] / count
        y += corners[j, 1] / count
        z += corners[j, 2] / count
    proved = -math.inf
    size = 0
    for _ in range(MAX_STEPS):
        # Invariant: with a simplex, (x, y, z) is its point nearest to the origin, and so never
        # nearer than the difference of the bodies is; it points from the link to the obstacle.
        length = math.sqrt(x * x + y * y + z * z)
        if not length > 0.0:
            if size > 0:
                break
            # Any direction will do to begin with.
            x, length = 1.0, 1.0
        nx, ny, nz = x / length, y / length, z / length
        i, farthest = _find_farthest(hulls, link, nx, ny, nz)
        j, nearest = _find_nearest(corners, count, nx, ny, nz)
        if i < 0 or j < 0:
            # No number was found anywhere.
            return -math.inf
        proved = max(proved, nearest - farthest)
        if size > 0 and not length - proved > TOLERANCE * length + ABSOLUTE_TOLERANCE:
            break
        member = i * MAXIMUM_POINTS + j
        is_known = False
        for corner in range(size):
            is_known = is_known or members[corner] == member
        if is_known:
            break
        for axis in range(3):
            simplex[size, axis] = corners[j, axis] - hulls.vertices[i, axis]
        members[size] = member
        size, x, y, z = _shrink(simplex, members, size + 1)
    return proved


@kernel
def hull_gap(
    hulls: LinkHulls, link: int, placement: ArmPlacement, points: FloatArray, count: int,
    radius: float,
) -> float:  # fmt: skip
    """Proved distance from a link to the hull of some points, rounded by a radius.

    Args:
        hulls: Of all links; its room is written.
        link: Index in `robot.links`.
        placement: Where the joints are.
        points: Corners of the obstacle in the world, in [m]. Shape (k, 3).
        count: How many of them count, at least 1.
        radius: In [m].

    Returns:
        In [m], never above the true distance, and about 1e-6 of it below while the bodies are
        apart; not positive where they overlap; -inf where anything is no number.
    """
    joint = hulls.joint[link]
    rotation, translation = placement.rotation, placement.translation
    largest = shift = 0.0
    for axis in range(3):
        shift = max(shift, abs(translation[joint, axis]))
    for k in range(count):
        for axis in range(3):
            largest = max(largest, abs(points[k, axis]))
            along = 0.0
            for other in range(3):
                away = points[k, other] - translation[joint, other]
                along += rotation[joint, other, axis] * away
            hulls.corners[k, axis] = along
    gap = _prove_gap(hulls, link, count) - radius
    gap -= HULL_ROUNDING * (largest + shift + hulls.reach[link] + radius)
    return gap if gap < math.inf else -math.inf
