"""Draws legs for a person whose upper body alone is tracked, so that it looks like a person.

The legs are thin lines for display only; the monitor does not watch them. If a source reports
bodies named as in `armguard.lab.simulation.bodies`, two lines go from the hip to the floor.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

HIP, LEFT, RIGHT = "hip", "left_shoulder", "right_shoulder"
WIDTH = 0.18  # between the feet, in [m]
FOOT = 0.22  # in [m]


def draw_legs(places: Mapping[str, Array], floor: float) -> Array:
    """Lines of both legs and feet, in [m]; none without a hip above the floor.

    Args:
        places: First point of each obstacle, in the world, in [m], by its name. Shape (3,) each.
        floor: Height of the floor, in [m].

    Returns:
        End points in the world. Shape (n, 2, 3).
    """
    hip = places.get(HIP)
    if hip is None or not (np.isfinite(hip).all() and hip[2] > floor + 0.1):
        return np.zeros((0, 2, 3))
    left, right = places.get(LEFT), places.get(RIGHT)
    across = np.array([0.0, 1.0, 0.0])
    if left is not None and right is not None:
        way = (left - right) * (1.0, 1.0, 0.0)
        length = float(np.linalg.norm(way))
        across = way / length if length > 1e-3 else across
    forward = np.cross(across, [0.0, 0.0, 1.0])
    lines = []
    for side in (-1.0, 1.0):
        top = hip + 0.5 * side * WIDTH * across
        heel = np.array([top[0], top[1], floor])
        knee = 0.5 * (top + heel) + 0.03 * forward
        lines += [(top, knee), (knee, heel), (heel, heel + FOOT * forward)]
    return np.array(lines)
