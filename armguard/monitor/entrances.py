"""Refuses entrances that overlap a link in every posture of the arm.

If an entrance and the arm overlap in some postures only, the verdict reports it: in these postures
contact is possible at once, and the verdict names link and entrance.
"""

from __future__ import annotations

import numpy as np

from armguard.exceptions import ArmguardError
from armguard.jit.arrays import FloatArray
from armguard.pairs.arm import WatchedArm

GOLDEN = 0.5 * (1.0 + 5.0**0.5)

CORNERS = np.array(
    [
        np.roll([0.0, one, other * GOLDEN], turn)
        for turn in range(3)
        for one in (-1.0, 1.0)
        for other in (-1.0, 1.0)
    ]
) * (3.0**0.5 / GOLDEN**2)
"""Corners of an icosahedron around a ball of radius 1. Shape (12, 3)."""

STEPS = 200
"""Greatest number of steps towards the nearest point of a hull; few suffice for a box."""

SETTLED = 1e-13
"""Tolerance on the squared distance at which the iteration ends, in [m²]."""

TOLERANCE = 1e-6
"""Tolerance by which a region counts as around a link, in [m]; exceeds the iteration's error."""


def check_entrances(arm: WatchedArm) -> None:
    """Refuse a table with an entrance that contains all places that a watched link can reach.

    Otherwise a body that no source has reported could touch that link in every posture, and every
    verdict would be a STOP.

    Args:
        arm: The arm and its obstacles.

    Raises:
        ArmguardError: There is such an entrance.
    """
    obstacles, table = arm.obstacles, arm.obstacles.table
    for row in obstacles.entrance_rows.tolist():
        points = table.points[row, : int(table.point_count[row])]
        watched = arm.watched_links(row)
        for number in np.flatnonzero(watched).tolist():
            ball = arm.motion.reach.link_balls[number]
            # A convex region that holds all corners around a ball holds the ball.
            corners = ball[:3] + ball[3] * CORNERS
            room = table.radius[row] + TOLERANCE
            if all(distance_to_hull(one, points) <= room for one in corners):
                name, link = obstacles.ids[row], arm.links[number]
                raise ArmguardError(
                    f"entrance {name!r}",
                    f"is around {link}, which cannot leave it: every verdict would be a STOP",
                    expected="a region that the arm can keep clear of, where bodies are not seen",
                    remedy="make it smaller, or detect sooner: it is widened by speed times "
                    "detection_time",
                )


def distance_to_hull(place: FloatArray, points: FloatArray) -> float:
    """Distance from a place to the hull of some points, or slightly more, in [m].

    Iterates by moving weight from one corner to another; each iterate is in the hull.

    Args:
        place: The place in [m]. Shape (3,).
        points: The points in [m]. Shape (k, 3).
    """
    corners = points - place
    weights = np.zeros(len(corners))
    weights[int(np.argmin((corners**2).sum(axis=1)))] = 1.0
    for _ in range(STEPS):
        offset = weights @ corners
        along = corners @ offset
        towards = int(np.argmin(along))
        away = int(np.argmax(np.where(weights > 0.0, along, -np.inf)))
        if not along[away] - along[towards] > SETTLED:
            break
        step = corners[towards] - corners[away]
        share = min(float((along[away] - along[towards]) / (step @ step)), float(weights[away]))
        weights[towards] += share
        weights[away] -= share
    return float(np.linalg.norm(weights @ corners))
