"""Conservative advancement against the rounded hull of several moving points, and out of range.

For one separating direction the gap of a hull is the least of its points' gaps: that is safe
because every point of the hull is a convex combination of them, and concave because each of them
is. The direction joins the nearest points.
"""

from __future__ import annotations

import math

import numpy as np

from armguard.contact.gap import (
    LARGE,
    LONGEST,
    TINY,
    are_bounds,
    direction,
    follow,
    limits,
    usable_accel,
)
from armguard.contact.gjk import nearest_on_hull
from armguard.jit.kernels import kernel

SETTLED = 1.0 + 2.0**-44  # a smaller gain is nothing but rounding
FAR = 1e100  # beyond, in [s], products with time may overflow


@kernel(forceinline=True)
def carry_time(s, saturation):
    """How long a body is carried along its velocity until `s`, but not past its saturation time."""
    return min(s, saturation) if s >= 0.0 else max(s, -saturation)


@kernel(forceinline=True)
def turn_hull(
    px, py, pz, vx, vy, vz, carry1, points, velocities, count, carry2
):  # fmt: skip
    """From the sphere to the hull, both carried along their velocities."""
    x, y, z = nearest_on_hull(
        px + vx * carry1, py + vy * carry1, pz + vz * carry1, points, velocities, count, carry2
    )
    return direction(x, y, z)


@kernel
def hull_contact_time(
    px, py, pz, vx, vy, vz, accel1, speed1, velocity_error1, age1,
    points, velocities, count, accel2, speed2, velocity_error2, age2,
    contact_distance, advances, trace, row, t, shortest, longest,
):  # fmt: skip
    """`trace_contact_time` from `t` on, with rows of the trace from `row` on.

    `shortest` is the least magnitude that rounding of lengths goes by, `longest` the time beyond
    which directions are not turned any more.

    Invariant of the loop: there is no contact before `t`, and n is the direction to try from there.
    """
    if not (
        count > 0
        and are_bounds(accel1, speed1, velocity_error1, age1)
        and are_bounds(accel2, speed2, velocity_error2, age2)
        and contact_distance >= 0.0
    ):
        return t
    top1, margin1 = limits(vx, vy, vz, accel1, speed1, velocity_error1)
    a1 = usable_accel(accel1)
    a2 = usable_accel(accel2)
    # Bodies that are aged have been carried on already; how far depends on the direction:
    # a first round with the direction of the measured places only finds the saturation times.
    refine = age1 + t != 0.0 or age2 + t != 0.0
    carry1 = age1 + t if t > 0.0 else 0.0
    carry2 = age2 + t if t > 0.0 else 0.0
    nx, ny, nz, inverse = turn_hull(
        px, py, pz, vx, vy, vz, carry1, points, velocities, count, carry2
    )
    k = 0
    while k < advances:
        # Advance: the soonest root of all corners' gaps is the time that this direction reaches.
        closing1 = (nx * vx + ny * vy + nz * vz) * inverse
        reached = math.inf
        saturation1 = math.inf
        saturation2 = math.inf
        for j in range(count):
            x = points[j, 0] - px
            y = points[j, 1] - py
            z = points[j, 2] - pz
            ux, uy, uz = velocities[j, 0], velocities[j, 1], velocities[j, 2]
            length = max(abs(x) + abs(y) + abs(z) + contact_distance, shortest)
            if not TINY < length < LARGE:
                return t
            top2, margin2 = limits(ux, uy, uz, accel2, speed2, velocity_error2)
            root, until1, until2 = follow(
                (nx * x + ny * y + nz * z) * inverse - contact_distance, length, t,
                closing1, margin1, 1.0 / a1, top1, a1, age1,
                -(nx * ux + ny * uy + nz * uz) * inverse, margin2, 1.0 / a2, top2, a2, age2,
            )  # fmt: skip
            if root < reached or j == 0:
                reached, saturation1, saturation2 = root, until1, until2
            if not root > t:
                break
        # Refine, once: turn to where bodies that are aged are now, and advance from `t` again.
        if refine:
            refine = False
            cx, cy, cz, turned = turn_hull(
                px, py, pz, vx, vy, vz, carry_time(age1 + t, saturation1),
                points, velocities, count, carry_time(age2 + t, saturation2),
            )  # fmt: skip
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
            px, py, pz, vx, vy, vz, carry_time(age1 + t, saturation1),
            points, velocities, count, carry_time(age2 + t, saturation2),
        )  # fmt: skip
        k += 1
    return t


@kernel
def _scaled_bound(bound, exponent):
    return bound if bound == 0.0 else max(math.ldexp(bound, exponent), 2.0 * TINY)


@kernel
def far_contact_time(
    px, py, pz, vx, vy, vz, accel1, speed1, velocity_error1, age1,
    points, velocities, count, accel2, speed2, velocity_error2, age2,
    contact_distance, advances, trace, t,
):  # fmt: skip
    """Go on from a `t` so far that products with it overflow, in units in which they do not.

    The new units are powers of two, so that only underflow rounds: it is far below what the
    shortest length, velocity error and speed that are then assumed make up for.
    """
    size = abs(vx) + abs(vy) + abs(vz)
    length = contact_distance
    for j in range(count):
        size = max(size, abs(velocities[j, 0]) + abs(velocities[j, 1]) + abs(velocities[j, 2]))
        x, y, z = points[j, 0] - px, points[j, 1] - py, points[j, 2] - pz
        length = max(length, abs(x) + abs(y) + abs(z))
    time_exponent = math.frexp(t)[1]
    length_exponent = max(math.frexp(length)[1], math.frexp(size)[1] + time_exponent)
    speed_exponent = time_exponent - length_exponent
    accel_exponent = 2 * time_exponent - length_exponent
    floor = 2.0 * TINY if size > 0.0 else 0.0
    # Every second row: of the layout that rows of states have, for which all this is compiled.
    corners = np.zeros((2 * count, 3))[::2]
    motions = np.zeros((2 * count, 3))[::2]
    for j in range(count):
        corners[j, 0] = math.ldexp(points[j, 0] - px, -length_exponent)
        corners[j, 1] = math.ldexp(points[j, 1] - py, -length_exponent)
        corners[j, 2] = math.ldexp(points[j, 2] - pz, -length_exponent)
        for i in range(3):
            motions[j, i] = math.ldexp(velocities[j, i], speed_exponent)
    reached = hull_contact_time(
        0.0, 0.0, 0.0,
        math.ldexp(vx, speed_exponent),
        math.ldexp(vy, speed_exponent),
        math.ldexp(vz, speed_exponent),
        _scaled_bound(accel1, accel_exponent),
        max(_scaled_bound(speed1, speed_exponent), floor),
        max(_scaled_bound(velocity_error1, speed_exponent), floor),
        math.ldexp(age1, -time_exponent),
        corners, motions, count,
        _scaled_bound(accel2, accel_exponent),
        max(_scaled_bound(speed2, speed_exponent), floor),
        max(_scaled_bound(velocity_error2, speed_exponent), floor),
        math.ldexp(age2, -time_exponent),
        math.ldexp(contact_distance, -length_exponent),
        advances, trace, advances, math.ldexp(t, -time_exponent), 2.0 * TINY,
        math.ldexp(LONGEST, -time_exponent),
    )  # fmt: skip
    if trace is not None:
        for k in range(advances, 2 * advances):
            trace[k, 0] = math.ldexp(trace[k, 0], time_exponent)
    if reached == math.inf:
        return math.inf
    return max(t, min(math.ldexp(reached, time_exponent), LONGEST))
