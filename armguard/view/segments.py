"""End points of the lines between pairs: on the cover of the link, and on the obstacle."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def connect(balls: Array, points: Array, radius: float) -> Array:
    """The shortest line from a link's cover to an obstacle; of length 0 if they overlap.

    Args:
        balls: Centre and radius of the link's cover spheres, in [m]. Shape (n, 4).
        points: Points whose hull is the obstacle, in [m]. Shape (k, 3).
        radius: Radius around the hull, in [m].

    Returns:
        Points on the cover and on the obstacle, in [m]. Shape (2, 3).
    """
    centres = balls[:, :3]
    nearest = _find_nearest(centres, points)
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


def _find_nearest(centres: Array, points: Array) -> Array:
    """Nearest points of a hull to each of several points, in [m]. Shape (n, 3).

    From outside, the nearest point is inside a triangle between points of the hull, or on a line
    between two, or one of them. It is the foot of the perpendicular there, so all feet that lie in
    the hull are compared. Of a point inside the hull, the answer is in the hull as well.
    """
    feet = []
    for size in range(1, min(len(points), 3) + 1):
        corners = points[list(itertools.combinations(range(len(points)), size))]
        first, sides = corners[:, :1], corners[:, 1:] - corners[:, :1]
        weights = (centres - first) @ np.linalg.pinv(sides)
        is_within = (weights >= 0.0).all(axis=2) & (weights.sum(axis=2) <= 1.0)
        feet.append(np.where(is_within[..., None], first + weights @ sides, np.inf))
    candidates = np.concatenate(feet)
    distances = np.linalg.norm(candidates - centres, axis=2)
    nearest: Array = candidates[distances.argmin(axis=0), np.arange(len(centres))]
    return nearest
