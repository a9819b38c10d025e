"""A band along a path, as triangles: a line would be too thin to be visible."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SHORT = 1e-9
"""A path shorter than this, in [m], has no direction."""


def lay_ribbon(points: Array, width: float) -> Array:
    """A flat band along a path; horizontal where the path is, so that it is visible from above.

    Args:
        points: Points along the path, in [m]. Shape (n, 3).
        width: Width of the band, in [m].

    Returns:
        Corners of triangles, two for each step, in [m]. Shape (2 (n - 1), 3, 3); none for a path of
        fewer than two points.
    """
    if len(points) < 2:
        return np.zeros((0, 3, 3))
    along = np.gradient(points, axis=0)
    # Any direction that the way does not take; one for all of it, or the band would turn over.
    whole = np.abs(points[-1] - points[0])
    helper = [0.0, 0.0, 1.0] if whole[2] <= max(whole[0], whole[1]) else [1.0, 0.0, 0.0]
    across = np.cross(along, helper)
    across *= 0.5 * width / np.maximum(np.linalg.norm(across, axis=1, keepdims=True), SHORT)
    left, right = points + across, points - across
    first = np.stack([left[:-1], right[:-1], left[1:]], axis=1)
    second = np.stack([right[:-1], right[1:], left[1:]], axis=1)
    triangles: Array = np.concatenate([first, second])
    return triangles
