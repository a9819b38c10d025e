"""Where the lines between pairs end: on the cover of the link, and on the obstacle."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def connect(balls: Array, points: Array, radius: float) -> Array:
    """The shortest line from a link's cover to an obstacle; of no length where they overlap.

    Args:
        balls: Centre and radius of the link's cover spheres, in [m]. Shape (n, 4).
        points: Whose hull the obstacle is, in [m]. Shape (k, 3).
        radius: Around the hull, in [m].

    Returns:
        On the cover, and on the obstacle, in [m]. Shape (2, 3).
    """
    centres = balls[:, :3]
    if len(points) == 1:
        nearest = np.broadcast_to(points, centres.shape)
    elif len(points) == 2:
        along = points[1] - points[0]
        share = (centres - points[0]) @ along / max(float(along @ along), 1e-12)
        nearest = points[0] + np.clip(share, 0.0, 1.0)[:, None] * along
    else:
        nearest = _nearest_on_hull(centres, points)
    gaps = np.linalg.norm(nearest - centres, axis=1) - balls[:, 3]
    best = int(np.argmin(gaps))
    start, end = centres[best], nearest[best]
    way = end - start
    length = float(np.linalg.norm(way))
    own = float(balls[best, 3])
    if length <= own + radius:
        # They overlap: a point between both surfaces.
        share = own / max(own + radius, 1e-12)
        return np.stack([start + share * way] * 2)
    return np.stack([start + own / length * way, end - radius / length * way])


def _nearest_on_hull(centres: Array, points: Array) -> Array:
    """Nearest points of a hull to each of several points, in [m]. Shape (n, 3).

    Of all triangles between the hull's points the nearest one is asked for: from outside, the
    nearest point lies on one of them, and of eight points there are 56. Of a point inside, the
    answer is inside as well.
    """
    corners = points[np.array(list(itertools.combinations(range(len(points)), 3)))]
    found, nearest = np.full(len(centres), np.inf), np.zeros_like(centres)
    for triangle in corners:
        candidates = _nearest_on_triangle(centres, triangle)
        distance = np.linalg.norm(candidates - centres, axis=1)
        better = distance < found
        found[better], nearest[better] = distance[better], candidates[better]
    return nearest


def _nearest_on_triangle(centres: Array, triangle: Array) -> Array:
    """Nearest points of a triangle, which may have no area, to each of several. Shape (n, 3)."""
    first, sides = triangle[0], triangle[1:] - triangle[0]
    weights = (centres - first) @ np.linalg.pinv(sides)
    nearest: Array = first + weights @ sides
    outside = ~((weights >= 0.0).all(axis=1) & (weights.sum(axis=1) <= 1.0))
    best = np.full(len(centres), np.inf)
    for start, end in ((0, 1), (1, 2), (2, 0)):
        along = triangle[end] - triangle[start]
        share = (centres - triangle[start]) @ along / max(float(along @ along), 1e-12)
        point = triangle[start] + np.clip(share, 0.0, 1.0)[:, None] * along
        distance = np.linalg.norm(point - centres, axis=1)
        better = outside & (distance < best)
        best[better], nearest[better] = distance[better], point[better]
    return nearest
