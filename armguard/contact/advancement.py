"""Conservative advancement: the earliest possible contact of a sphere and a moving rounded hull.

It begins with the separating direction towards the present position of the other body, and follows
its gap to its root. Then it turns the direction to the positions that the bodies have by then along
their velocities, each at most until its saturation time, when it may have reached its speed bound.
It follows the new gap from there, and so on. Each time on the way is a proven lower bound, and more
advances come closer: without speed bounds to the smallest root of the quartic, quadratically. `gap`
explains how rounding is accounted for.
"""

from __future__ import annotations

import math

from armguard.contact.bodies import Ball, Bounds, Hull
from armguard.contact.gap import (
    LARGE,
    LONGEST,
    TINY,
    Approach,
    are_bounds,
    direction,
    follow,
    limits,
    motion,
    usable_accel,
)
from armguard.contact.hull_advancement import SETTLED, carry_time, hull_contact_time
from armguard.jit.arrays import FloatArray
from armguard.jit.kernels import kernel, merged_kernel, separate_kernel

Trace = FloatArray | None
"""Takes separating directions: see `row_contact_time`. None costs nothing."""


@merged_kernel
def _turn(
    one: Ball, carry1: float, other: Ball, carry2: float
) -> tuple[float, float, float, float]:
    """The direction from one to the other, each carried along its velocity for a time in [s]."""
    return direction(
        (other.x - one.x) + other.vx * carry2 - one.vx * carry1,
        (other.y - one.y) + other.vy * carry2 - one.vy * carry1,
        (other.z - one.z) + other.vz * carry2 - one.vz * carry1,
    )


@kernel
def _turn_aged(
    one: Ball, approach1: Approach, other: Ball, approach2: Approach
) -> tuple[float, float, float, float]:
    """The first direction where bodies have been carried on already.

    How far that is depends on the direction: first the one between their places at their stamps.
    The approaches' closing speeds do not count.
    """
    px, py, pz, inverse = direction(other.x - one.x, other.y - one.y, other.z - one.z)
    _, margin1, top1, accel1, inverse1, age1 = approach1
    _, margin2, top2, accel2, inverse2, age2 = approach2
    closing1 = (px * one.vx + py * one.vy + pz * one.vz) * inverse
    closing2 = -(px * other.vx + py * other.vy + pz * other.vz) * inverse
    approach1 = Approach(closing1, margin1, top1, accel1, inverse1, age1)
    approach2 = Approach(closing2, margin2, top2, accel2, inverse2, age2)
    carry1 = carry_time(age1, motion(approach1, age1)[5])
    carry2 = carry_time(age2, motion(approach2, age2)[5])
    cx, cy, cz, turned = _turn(one, carry1, other, carry2)
    if math.isnan(turned):
        return px, py, pz, inverse
    return cx, cy, cz, turned


@separate_kernel
def ball_contact_time(
    one: Ball, other: Ball, contact_distance: float, advances: int, trace: Trace
) -> float:
    """`row_contact_time` for two balls."""
    x, y, z = other.x - one.x, other.y - one.y, other.z - one.z
    length = abs(x) + abs(y) + abs(z) + contact_distance
    if not (
        are_bounds(one.bounds)
        and are_bounds(other.bounds)
        and TINY < length < LARGE
        and contact_distance >= 0.0
    ):
        return 0.0
    age1, age2 = one.bounds.age, other.bounds.age
    top1, margin1 = limits(one.vx, one.vy, one.vz, one.bounds)
    top2, margin2 = limits(other.vx, other.vy, other.vz, other.bounds)
    a1 = usable_accel(one.bounds.accel)
    a2 = usable_accel(other.bounds.accel)
    inverse1 = 1.0 / a1
    inverse2 = 1.0 / a2
    if age1 == 0.0 and age2 == 0.0:
        px, py, pz, inverse = direction(x, y, z)
    else:
        px, py, pz, inverse = _turn_aged(
            one, Approach(0.0, margin1, top1, a1, inverse1, age1),
            other, Approach(0.0, margin2, top2, a2, inverse2, age2),
        )  # fmt: skip
    # Invariant: there is no contact before `t`, and p is the direction to try from there.
    t = 0.0
    for k in range(advances):
        if trace is not None:
            trace[k, 0] = t
            trace[k, 1], trace[k, 2], trace[k, 3] = px * inverse, py * inverse, pz * inverse
        # Advance: follow the gap of this direction to its root.
        before = t
        closing1 = (px * one.vx + py * one.vy + pz * one.vz) * inverse
        closing2 = -(px * other.vx + py * other.vy + pz * other.vz) * inverse
        t, saturation1, saturation2 = follow(
            (px * x + py * y + pz * z) * inverse - contact_distance, length, t,
            Approach(closing1, margin1, top1, a1, inverse1, age1),
            Approach(closing2, margin2, top2, a2, inverse2, age2),
        )  # fmt: skip
        # Turn: to where the bodies are carried by then.
        if not before * SETTLED < t < LONGEST:
            break
        px, py, pz, inverse = _turn(
            one, carry_time(age1 + t, saturation1), other, carry_time(age2 + t, saturation2)
        )
    return t


@kernel(inline="always")  # type: ignore[untyped-decorator]  # it has options
def row_contact_time(
    ball: Ball,
    points: FloatArray,
    velocities: FloatArray,
    row: int,
    count: int,
    bounds: Bounds,
    contact_distance: float,
    advances: int,
    trace: Trace,
) -> float:
    """Earliest time at which a ball and the rounded hull of moving points could touch.

    Written out in its caller before that is compiled: to hand arrays over, and rows of them, takes
    as long, for counting references to them, as an advance of a ball.

    Args:
        ball: The one.
        points: Of several hulls, in [m]. Shape (n, k, 3).
        velocities: Of these points, in [m/s]. Shape (n, k, 3).
        row: Which of the hulls is meant.
        count: How many of its points count.
        bounds: Of each of them.
        contact_distance: Both radii, margin and position errors, in [m].
        advances: The most advances: more come closer, and every number is safe.
        trace: None, which costs nothing, or takes the separating directions: of shape
            (advances, 4), a row for the time from which on a direction is in charge, in [s], and
            the direction. Rows that were not needed stay as they were; one of a direction that did
            not bring the time forward has the time of the next.

    Returns:
        A time from now in [s] before which there is no contact; inf if never, 0 if contact is
        possible now or any input is NaN, negative or infinite where that means nothing.
    """
    if count == 1:
        other = Ball(
            points[row, 0, 0], points[row, 0, 1], points[row, 0, 2],
            velocities[row, 0, 0], velocities[row, 0, 1], velocities[row, 0, 2], bounds,
        )  # fmt: skip
        time = ball_contact_time(ball, other, contact_distance, advances, trace)
    else:
        hull = Hull(points[row], velocities[row], count, bounds)
        time = hull_contact_time(ball, hull, contact_distance, advances, trace)
    return time
