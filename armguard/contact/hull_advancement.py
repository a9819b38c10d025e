"""Conservative advancement against the rounded hull of several moving points, and out of range.

For one separating direction the gap of a hull is the least of its points' gaps: that is safe
because every point of the hull is a convex combination of them, and concave because each of them
is. The direction joins the nearest points.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

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
    usable_accel,
)
from armguard.contact.gjk import nearest_on_hull
from armguard.jit.arrays import FloatArray
from armguard.jit.kernels import kernel, merged_kernel

SETTLED = 1.0 + 2.0**-44  # a smaller gain is nothing but rounding
FAR = 1e100  # beyond, in [s], products with time may overflow


class Begin(NamedTuple):
    """Where an advancement begins, and in which units."""

    row: int
    """Of the trace, for the first direction."""
    time: float
    """Before which there is no contact, in [s]."""
    shortest: float
    """The least magnitude that rounding of lengths goes by, in [m]."""
    longest: float
    """Beyond this, in [s], directions are not turned any more."""


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


@kernel
def hull_contact_time(
    ball: Ball,
    hull: Hull,
    contact_distance: float,
    advances: int,
    trace: FloatArray | None,
    begin: Begin,
) -> float:
    """`trace_contact_time` from the time of `begin` on.

    Invariant of the loop: there is no contact before `t`, and n is the direction to try from there.
    """
    row, t, shortest, longest = begin
    points, velocities, count, bounds = hull
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
    refine = age1 + t != 0.0 or age2 + t != 0.0
    carry1 = age1 + t if t > 0.0 else 0.0
    carry2 = age2 + t if t > 0.0 else 0.0
    nx, ny, nz, inverse = turn_hull(ball, carry1, hull, carry2)
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
            length = max(abs(x) + abs(y) + abs(z) + contact_distance, shortest)
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
            trace[row + k, 0] = t
            trace[row + k, 1] = nx * inverse
            trace[row + k, 2] = ny * inverse
            trace[row + k, 3] = nz * inverse
        # Turn: from the new time on, along the nearest points of where the bodies are carried to.
        if not t * SETTLED < reached < longest:
            return max(t, reached)
        t = reached
        nx, ny, nz, inverse = turn_hull(
            ball, carry_time(age1 + t, saturation1), hull, carry_time(age2 + t, saturation2)
        )
        k += 1
    return t


@kernel
def _scale(bounds: Bounds, time_exponent: int, length_exponent: int, floor: float) -> Bounds:
    """Bounds in units of other powers of two, speeds no less than `floor`."""
    speed_exponent = time_exponent - length_exponent
    accel_exponent = 2 * time_exponent - length_exponent
    return Bounds(
        _scaled_bound(bounds.accel, accel_exponent),
        max(_scaled_bound(bounds.speed, speed_exponent), floor),
        max(_scaled_bound(bounds.velocity_error, speed_exponent), floor),
        math.ldexp(bounds.age, -time_exponent),
    )


@kernel
def _scaled_bound(bound: float, exponent: int) -> float:
    return bound if bound == 0.0 else max(math.ldexp(bound, exponent), 2.0 * TINY)


@kernel
def far_contact_time(
    ball: Ball,
    hull: Hull,
    contact_distance: float,
    advances: int,
    trace: FloatArray | None,
    t: float,
) -> float:
    """Go on from a `t` so far that products with it overflow, in units in which they do not.

    The new units are powers of two, so that only underflow rounds: it is far below what the
    shortest length, velocity error and speed that are then assumed make up for.
    """
    points, velocities, count, bounds = hull
    size = abs(ball.vx) + abs(ball.vy) + abs(ball.vz)
    length = contact_distance
    for j in range(count):
        size = max(size, abs(velocities[j, 0]) + abs(velocities[j, 1]) + abs(velocities[j, 2]))
        x, y, z = points[j, 0] - ball.x, points[j, 1] - ball.y, points[j, 2] - ball.z
        length = max(length, abs(x) + abs(y) + abs(z))
    time_exponent = math.frexp(t)[1]
    length_exponent = max(math.frexp(length)[1], math.frexp(size)[1] + time_exponent)
    speed_exponent = time_exponent - length_exponent
    floor = 2.0 * TINY if size > 0.0 else 0.0
    # Every second row: of the layout that rows of states have, for which all this is compiled.
    corners = np.zeros((2 * count, 3))[::2]
    motions = np.zeros((2 * count, 3))[::2]
    for j in range(count):
        corners[j, 0] = math.ldexp(points[j, 0] - ball.x, -length_exponent)
        corners[j, 1] = math.ldexp(points[j, 1] - ball.y, -length_exponent)
        corners[j, 2] = math.ldexp(points[j, 2] - ball.z, -length_exponent)
        for i in range(3):
            motions[j, i] = math.ldexp(velocities[j, i], speed_exponent)
    scaled = Ball(
        0.0, 0.0, 0.0,
        math.ldexp(ball.vx, speed_exponent),
        math.ldexp(ball.vy, speed_exponent),
        math.ldexp(ball.vz, speed_exponent),
        _scale(ball.bounds, time_exponent, length_exponent, floor),
    )  # fmt: skip
    reached = hull_contact_time(
        scaled,
        Hull(corners, motions, count, _scale(bounds, time_exponent, length_exponent, floor)),
        math.ldexp(contact_distance, -length_exponent),
        advances,
        trace,
        Begin(
            advances,
            math.ldexp(t, -time_exponent),
            2.0 * TINY,
            math.ldexp(LONGEST, -time_exponent),
        ),
    )
    if trace is not None:
        for k in range(advances, 2 * advances):
            trace[k, 0] = math.ldexp(trace[k, 0], time_exponent)
    if reached == math.inf:
        return math.inf
    return max(t, min(math.ldexp(reached, time_exponent), LONGEST))
