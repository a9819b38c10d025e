"""The smallest ball around points: exact support set, radius rounded outwards.

The basis exchange of Gärtner's miniball: keep the at most four points that the ball rests on; as
long as some point lies outside, take the farthest and find the ball of those five by trying their
subsets. The radius grows with every exchange, so it ends.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np

from armguard.jit.arrays import FloatArray
from armguard.jit.numerics import SUPPORT_SLACK


def enclose_points(points: FloatArray) -> tuple[FloatArray, float]:
    """The smallest ball that contains all points.

    Args:
        points: In [m]. Shape (n, 3), n > 0.

    Returns:
        Centre in [m], shape (3,), and a radius in [m] that reaches every point as computed.
    """
    middle = points.mean(axis=0)
    support = [int(np.argmax(((points - middle) ** 2).sum(axis=1)))]
    center, radius = points[support[0]], 0.0
    while True:
        distances = np.sqrt(((points - center) ** 2).sum(axis=1))
        farthest = int(np.argmax(distances))
        if not (distances[farthest] > radius * (1.0 + SUPPORT_SLACK)):
            return center, float(distances[farthest])
        previous = radius
        support, center, radius = _ball_of_few(points, [*support, farthest])
        if not (radius > previous):  # rounding has ended the progress
            return center, float(np.sqrt(((points - center) ** 2).sum(axis=1)).max())


def _ball_of_few(points: FloatArray, candidates: list[int]) -> tuple[list[int], FloatArray, float]:
    """The smallest ball of at most five points, which rests on the last of them."""
    *others, last = candidates
    few = points[candidates]
    best: tuple[list[int], FloatArray, float] | None = None
    for size in range(1, min(3, len(others)) + 1):
        for chosen in combinations(others, size):
            corners = points[[*chosen, last]]
            center = _circumcenter(corners)
            radius = float(np.sqrt(((corners - center) ** 2).sum(axis=1)).max())
            reach = float(np.sqrt(((few - center) ** 2).sum(axis=1)).max())
            if reach <= radius * (1.0 + SUPPORT_SLACK) and (best is None or radius < best[2]):
                best = [*chosen, last], center, radius
    if best is None:  # degenerate to rounding: any ball around them will do to go on from
        center = few.mean(axis=0)
        return candidates[-4:], center, float(np.sqrt(((few - center) ** 2).sum(axis=1)).max())
    return best


def _circumcenter(corners: FloatArray) -> FloatArray:
    """The point in the affine span of 2 to 4 corners that is equally far from all."""
    edges = corners[1:] - corners[0]
    weights = np.linalg.lstsq(2.0 * edges @ edges.T, (edges**2).sum(axis=1), rcond=None)[0]
    center: FloatArray = corners[0] + weights @ edges
    return center
