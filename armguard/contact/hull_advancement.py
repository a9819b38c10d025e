"""Conservative advancement against the rounded hull of several moving points.

For one separating direction the gap of a hull is the least of its points' gaps: that is safe
because every point of the hull is a convex combination of them, and concave because each of them
is. The direction joins the nearest points.
"""

from __future__ import annotations

import math

from armguard.contact.bodies import Ball, Hull
from armguard.contact.gap import (
    LARGE,
    LONGEST,
    TINY,
    Approach,
    are_bounds,
    direction,
    follow,
    limits,
    usable_accel,
)
from armguard.contact.gjk import nearest_on_hull
from armguard.jit.arrays import FloatArray
from armguard.jit.kernels import merged_kernel, separate_kernel

SETTLED = 1.0 + 2.0**-44  # a smaller gain is nothing but rounding


@merged_kernel
def carry_time(s: float, saturation: float) -> float:
    """How long a body is carried along its velocity until `s`, but not past its saturation time."""
    return min(s, saturation) if s >= 0.0 else max(s, -saturation)


@merged_kernel
def turn_hull(
    ball: Ball, carry1: float, hull: Hull, carry2: float
) -> tuple[float, float, float, float]:
    """The direction from ball to hull, each carried along its velocities for a time in [s]."""
    x, y, z = nearest_on_hull(
        ball.x + ball.vx * carry1, ball.y + ball.vy * carry1, ball.z + ball.vz * carry1,
        hull.points, hull.velocities, hull.size, carry2,
    )  # fmt: skip
    return direction(x, y, z)


@separate_kernel
def hull_contact_time(
    ball: Ball, hull: Hull, contact_distance: float, advances: int, trace: FloatArray | None
) -> float:
    """`row_contact_time` for a hull of any size.

    Invariant of the loop: there is no contact before `t`, and n is the direction to try from there.
    """
    points, velocities, count, bounds = hull
    t = 0.0
    if not (
        count > 0 and are_bounds(ball.bounds) and are_bounds(bounds) and contact_distance >= 0.0
    ):
        return t
    age1, age2 = ball.bounds.age, bounds.age
    top1, margin1 = limits(ball.vx, ball.vy, ball.vz, ball.bounds)
    a1 = usable_accel(ball.bounds.accel)
    a2 = usable_accel(bounds.accel)
    # Bodies that are aged have been carried on already; how far depends on the direction:
    # a first round with the direction of the measured places only finds the saturation times.
    refine = age1 != 0.0 or age2 != 0.0
    nx, ny, nz, inverse = turn_hull(ball, 0.0, hull, 0.0)
    k = 0
    while k < advances:
        # Advance: the soonest root of all corners' gaps is the time that this direction reaches.
        closing1 = (nx * ball.vx + ny * ball.vy + nz * ball.vz) * inverse
        reached = math.inf
        saturation1 = math.inf
        saturation2 = math.inf
        for j in range(count):
            x = points[j, 0] - ball.x
            y = points[j, 1] - ball.y
            z = points[j, 2] - ball.z
            ux, uy, uz = velocities[j, 0], velocities[j, 1], velocities[j, 2]
            length = abs(x) + abs(y) + abs(z) + contact_distance
            if not TINY < length < LARGE:
                return t
            top2, margin2 = limits(ux, uy, uz, bounds)
            closing2 = -(nx * ux + ny * uy + nz * uz) * inverse
            root, until1, until2 = follow(
                (nx * x + ny * y + nz * z) * inverse - contact_distance, length, t,
                Approach(closing1, margin1, top1, a1, 1.0 / a1, age1),
                Approach(closing2, margin2, top2, a2, 1.0 / a2, age2),
            )  # fmt: skip
            if root < reached or j == 0:
                reached, saturation1, saturation2 = root, until1, until2
            if not root > t:
                break
        # Refine, once: turn to where bodies that are aged are now, and advance from `t` again.
        if refine:
            refine = False
            cx, cy, cz, turned = turn_hull(
                ball, carry_time(age1 + t, saturation1), hull, carry_time(age2 + t, saturation2)
            )
            if not math.isnan(turned):
                nx, ny, nz, inverse = cx, cy, cz, turned
                continue
        if trace is not None:
            trace[k, 0] = t
            trace[k, 1], trace[k, 2], trace[k, 3] = nx * inverse, ny * inverse, nz * inverse
        # Turn: from the new time on, along the nearest points of where the bodies are carried to.
        if not t * SETTLED < reached < LONGEST:
            return max(t, reached)
        t = reached
        nx, ny, nz, inverse = turn_hull(
            ball, carry_time(age1 + t, saturation1), hull, carry_time(age2 + t, saturation2)
        )
        k += 1
    return t
