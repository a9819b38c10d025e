"""The region that an obstacle can reach until the arm is at rest: a ball around each point."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armguard.bounds.free_body import length_above, top_speed
from armguard.obstacles.table import States


def find_reachable(states: States, row: int, now: float, horizon: float) -> NDArray[np.float64]:
    """Balls that contain all points of an obstacle, including its radius, until a time.

    After a time s, a body with initial velocity v and acceleration at most a is within a s² / 2 of
    its position at constant velocity v. A body with speed at most w is within w s of its initial
    position. Both balls contain the body at the end, so the smaller one is used. It is enlarged to
    contain the measured position, so that it holds for the whole time until the end.

    Args:
        states: Measured states.
        row: Row of the obstacle.
        now: Time in [s] on the clock of the stamps.
        horizon: How far ahead to look, in [s].

    Returns:
        Centres and radii in the world, in [m]; no balls for an obstacle that can be anywhere. Shape
        (n, 4).
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
