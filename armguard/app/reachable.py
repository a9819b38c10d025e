"""Where an obstacle can be when the arm has come to rest: a ball around each of its points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armguard.bounds.free_body import length_above, top_speed
from armguard.obstacles.table import States


def find_reachable(states: States, row: int, now: float, horizon: float) -> NDArray[np.float64]:
    """Balls that contain an obstacle's points, its radius included, until a time.

    A body that starts at v and accelerates by at most a is within a s² / 2 of where it would be
    unaccelerated; one that is no faster than w is within w s of where it was. Both hold at every
    time, so the ball at the end that is the smaller one serves; for the whole time until then it
    is widened to contain where the body was measured.

    Args:
        states: Measured states.
        row: Of the obstacle.
        now: In [s] on the clock of the stamps.
        horizon: How far ahead to look, in [s].

    Returns:
        Centres and radii in the world, in [m]; of what may be anywhere, none. Shape (n, 4).
    """
    s = max(now - float(states.stamp[row]), 0.0) + horizon
    points = states.points[row, : int(states.point_count[row])]
    velocities = states.velocities[row, : len(points)]
    own = float(states.radius[row] + states.position_error[row])
    velocity_error, accel = float(states.velocity_error[row]), float(states.accel[row])
    balls = np.empty((len(points), 4))
    for ball, point, velocity in zip(balls, points, velocities, strict=True):
        measured = length_above(*velocity)
        top = top_speed(measured, float(states.speed[row]), velocity_error)
        drift = (velocity_error + 0.5 * accel * s) * s
        # The path from where it was measured to where it would be lies within half of its length.
        along = 0.5 * measured * s
        if drift + along < top * s:
            ball[:3], ball[3] = point + 0.5 * s * velocity, own + drift + along
        else:
            ball[:3], ball[3] = point, own + top * s
    return balls[np.isfinite(balls).all(axis=1)]
