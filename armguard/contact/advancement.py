"""Conservative advancement: the earliest possible contact of a sphere and a moving rounded hull.

Begin with the separating direction that points at where the other body is now. Follow its gap to
its root; turn it to where the bodies have been carried by then along their velocities, each no
longer than until its saturation time, when it may have reached its speed bound; follow the new gap
from there, and so on. Each time on the way is a proven lower bound, and more
advances come closer: without speed bounds to the smallest root of the quartic, quadratically.
How the rounding is accounted for is told in `gap`.
"""

from __future__ import annotations

import math

import numpy as np

from armguard.contact.gap import (
    LARGE,
    LONGEST,
    NO_BOUND,
    TINY,
    are_bounds,
    direction,
    follow,
    later,
    limits,
    motion,
    usable_accel,
)
from armguard.contact.hull_advancement import (
    FAR,
    SETTLED,
    carry_time,
    far_contact_time,
    hull_contact_time,
    turn_hull,
)
from armguard.jit.kernels import kernel
from armguard.jit.numerics import GAP_ROUNDING


@kernel(forceinline=True)
def _turn(x, y, z, vx1, vy1, vz1, carry1, vx2, vy2, vz2, carry2):
    return direction(
        x + vx2 * carry2 - vx1 * carry1,
        y + vy2 * carry2 - vy1 * carry1,
        z + vz2 * carry2 - vz1 * carry1,
    )


@kernel
def _turn_aged(
    x, y, z,
    vx1, vy1, vz1, margin1, top1, accel1, age1,
    vx2, vy2, vz2, margin2, top2, accel2, age2,
):  # fmt: skip
    """The first direction where bodies have been carried on already.

    How far that is depends on the direction: first the one between their places at their stamps.
    """
    px, py, pz, inverse = direction(x, y, z)
    closing1 = (px * vx1 + py * vy1 + pz * vz1) * inverse
    closing2 = -(px * vx2 + py * vy2 + pz * vz2) * inverse
    carry1 = carry_time(age1, motion(closing1, margin1, top1, accel1, age1, age1)[5])
    carry2 = carry_time(age2, motion(closing2, margin2, top2, accel2, age2, age2)[5])
    cx, cy, cz, turned = _turn(x, y, z, vx1, vy1, vz1, carry1, vx2, vy2, vz2, carry2)
    if math.isnan(turned):
        return px, py, pz, inverse
    return cx, cy, cz, turned


@kernel
def ball_contact_time(
    x, y, z, contact_distance,
    vx1, vy1, vz1, accel1, speed1, velocity_error1, age1,
    vx2, vy2, vz2, accel2, speed2, velocity_error2, age2,
    advances, trace,
):  # fmt: skip
    """`trace_contact_time` for a single point at (x, y, z) relative to the sphere's centre."""
    length = abs(x) + abs(y) + abs(z) + contact_distance
    if not (
        are_bounds(accel1, speed1, velocity_error1, age1)
        and are_bounds(accel2, speed2, velocity_error2, age2)
        and TINY < length < LARGE
        and contact_distance >= 0.0
    ):
        return 0.0
    top1, margin1 = limits(vx1, vy1, vz1, accel1, speed1, velocity_error1)
    top2, margin2 = limits(vx2, vy2, vz2, accel2, speed2, velocity_error2)
    a1 = usable_accel(accel1)
    a2 = usable_accel(accel2)
    inverse1 = 1.0 / a1
    inverse2 = 1.0 / a2
    if age1 == 0.0 and age2 == 0.0:
        px, py, pz, inverse = direction(x, y, z)
    else:
        px, py, pz, inverse = _turn_aged(
            x, y, z, vx1, vy1, vz1, margin1, top1, a1, age1,
            vx2, vy2, vz2, margin2, top2, a2, age2,
        )  # fmt: skip
    # Invariant: there is no contact before `t`, and p is the direction to try from there.
    t = 0.0
    for k in range(advances):
        if trace is not None:
            trace[k, 0] = t
            trace[k, 1], trace[k, 2], trace[k, 3] = px * inverse, py * inverse, pz * inverse
        # Advance: follow the gap of this direction to its root.
        before = t
        t, saturation1, saturation2 = follow(
            (px * x + py * y + pz * z) * inverse - contact_distance, length, t,
            (px * vx1 + py * vy1 + pz * vz1) * inverse, margin1, inverse1, top1, a1, age1,
            -(px * vx2 + py * vy2 + pz * vz2) * inverse, margin2, inverse2, top2, a2, age2,
        )  # fmt: skip
        # Turn: to where the bodies are carried by then.
        if not before * SETTLED < t < LONGEST:
            break
        px, py, pz, inverse = _turn(
            x, y, z, vx1, vy1, vz1, carry_time(age1 + t, saturation1),
            vx2, vy2, vz2, carry_time(age2 + t, saturation2),
        )  # fmt: skip
    # Go on in other units where products with the time would overflow.
    if FAR < t < LONGEST:
        return _far_ball_contact_time(
            x, y, z, contact_distance,
            vx1, vy1, vz1, accel1, speed1, velocity_error1, age1,
            vx2, vy2, vz2, accel2, speed2, velocity_error2, age2,
            advances, trace, t,
        )  # fmt: skip
    return t


@kernel
def _far_ball_contact_time(
    x, y, z, contact_distance,
    vx1, vy1, vz1, accel1, speed1, velocity_error1, age1,
    vx2, vy2, vz2, accel2, speed2, velocity_error2, age2,
    advances, trace, t,
):  # fmt: skip
    # Every second row: of the layout that rows of states have, for which all this is compiled.
    points = np.zeros((2, 3))[::2]
    velocities = np.zeros((2, 3))[::2]
    points[0, 0], points[0, 1], points[0, 2] = x, y, z
    velocities[0, 0], velocities[0, 1], velocities[0, 2] = vx2, vy2, vz2
    return far_contact_time(
        0.0, 0.0, 0.0, vx1, vy1, vz1, accel1, speed1, velocity_error1, age1,
        points, velocities, np.int64(1), accel2, speed2, velocity_error2, age2,
        contact_distance, advances, trace, t,
    )  # fmt: skip


@kernel
def _any_contact_time(
    px, py, pz, vx, vy, vz, accel1, speed1, velocity_error1, age1,
    points, velocities, count, accel2, speed2, velocity_error2, age2,
    contact_distance, advances, trace,
):  # fmt: skip
    t = hull_contact_time(
        px, py, pz, vx, vy, vz, accel1, speed1, velocity_error1, age1,
        points, velocities, count, accel2, speed2, velocity_error2, age2,
        contact_distance, advances, trace, np.int64(0), 0.0, 0.0, LONGEST,
    )  # fmt: skip
    if FAR < t < LONGEST:
        return far_contact_time(
            px, py, pz, vx, vy, vz, accel1, speed1, velocity_error1, age1,
            points, velocities, count, accel2, speed2, velocity_error2, age2,
            contact_distance, advances, trace, t,
        )  # fmt: skip
    return t


@kernel(forceinline=True)
def trace_contact_time(
    px, py, pz, vx, vy, vz, accel1, speed1, velocity_error1, age1,
    points, velocities, count, accel2, speed2, velocity_error2, age2,
    contact_distance, advances, trace,
):  # fmt: skip
    """`pair_contact_time` that leaves its separating directions behind.

    `trace` is None, which costs nothing, or has the shape (2 advances, 4): a row takes the time
    from which on a direction is in charge, in [s], and the direction. Rows that were not needed
    stay as they were; one of a direction that did not bring the time forward has the time of the
    next.
    """
    if count == 1:
        return ball_contact_time(
            points[0, 0] - px, points[0, 1] - py, points[0, 2] - pz, contact_distance,
            vx, vy, vz, accel1, speed1, velocity_error1, age1,
            velocities[0, 0], velocities[0, 1], velocities[0, 2],
            accel2, speed2, velocity_error2, age2, advances, trace,
        )  # fmt: skip
    return _any_contact_time(
        px, py, pz, vx, vy, vz, accel1, speed1, velocity_error1, age1,
        points, velocities, count, accel2, speed2, velocity_error2, age2,
        contact_distance, advances, trace,
    )  # fmt: skip


@kernel(forceinline=True)
def pair_contact_time(
    px, py, pz, vx, vy, vz, accel1, speed1, velocity_error1, age1,
    points, velocities, count, accel2, speed2, velocity_error2, age2,
    contact_distance, advances,
):  # fmt: skip
    """Earliest time at which a sphere and the rounded hull of points[:count] could touch.

    (px, py, pz) is the centre of the sphere at its stamp in [m], (vx, vy, vz) its velocity in
    [m/s]; accel1 [m/s^2] and speed1 [m/s] are its bounds, inf where there is none; velocity_error1
    [m/s] is what the velocity may be off by; age1 [s] is now minus its stamp, negative where that
    is newer than now. `points` and `velocities`, shape (k, 3), float64, [m] and [m/s], are the
    corners of the hull: count 1 is a ball, 2 a capsule, 8 a box; their bounds, error and age hold
    for each corner. contact_distance [m] is both radii, margin and position errors. `advances` is
    the most advances: more come closer, and every number is safe.

    Returns:
        A time from now in [s] before which there is no contact; inf if never, 0 if contact is
        possible now or any input is NaN, negative or infinite where that means nothing.
    """
    return trace_contact_time(
        px, py, pz, vx, vy, vz, accel1, speed1, velocity_error1, age1,
        points, velocities, count, accel2, speed2, velocity_error2, age2,
        contact_distance, advances, None,
    )  # fmt: skip


@kernel(inline="always")
def row_contact_time(
    px, py, pz, vx, vy, vz, accel1, speed1, velocity_error1, age1,
    points, velocities, row, count, accel2, speed2, velocity_error2, age2,
    contact_distance, advances,
):  # fmt: skip
    """`pair_contact_time` for one row of arrays of the shape (n, k, 3).

    Written out in its caller before that is compiled: to hand arrays over, and rows of them, takes
    as long, for counting references to them, as an advance of a ball.
    """
    if count == 1:
        time = ball_contact_time(
            points[row, 0, 0] - px, points[row, 0, 1] - py, points[row, 0, 2] - pz,
            contact_distance, vx, vy, vz, accel1, speed1, velocity_error1, age1,
            velocities[row, 0, 0], velocities[row, 0, 1], velocities[row, 0, 2],
            accel2, speed2, velocity_error2, age2, advances, None,
        )  # fmt: skip
    else:
        time = _any_contact_time(
            px, py, pz, vx, vy, vz, accel1, speed1, velocity_error1, age1,
            points[row], velocities[row], count, accel2, speed2, velocity_error2, age2,
            contact_distance, advances, None,
        )  # fmt: skip
    return time


@kernel
def pair_distance_time(
    px, py, pz, vx, vy, vz, accel1, speed1, velocity_error1, age1,
    points, velocities, count, accel2, speed2, velocity_error2, age2,
    contact_distance,
):  # fmt: skip
    """The rung below the first advance: distance over the closing speed that bounds allow.

    Arguments and result as for `pair_contact_time`; the accelerations do not matter.
    """
    if not (
        count >= 1
        and are_bounds(accel1, speed1, velocity_error1, age1)
        and are_bounds(accel2, speed2, velocity_error2, age2)
        and contact_distance >= 0.0
    ):
        return 0.0
    if count == 1:
        nx, ny, nz, inverse = direction(points[0, 0] - px, points[0, 1] - py, points[0, 2] - pz)
    else:
        nx, ny, nz, inverse = turn_hull(
            px, py, pz, 0.0, 0.0, 0.0, 0.0, points, velocities, count, 0.0
        )
    top1 = limits(vx, vy, vz, accel1, speed1, velocity_error1)[0]
    distance = math.inf
    length = contact_distance
    top2 = 0.0
    for j in range(count):
        x = points[j, 0] - px
        y = points[j, 1] - py
        z = points[j, 2] - pz
        ux, uy, uz = velocities[j, 0], velocities[j, 1], velocities[j, 2]
        top = limits(ux, uy, uz, accel2, speed2, velocity_error2)[0]
        along = (nx * x + ny * y + nz * z) * inverse
        if not (along >= 0.0 and top >= 0.0):
            return 0.0
        distance = min(distance, along)
        length = max(length, abs(x) + abs(y) + abs(z))
        top2 = max(top2, top)
    grown = top1 * abs(age1) + top2 * abs(age2)
    gap = distance - contact_distance - grown - GAP_ROUNDING * (2.0 * length + grown)
    if not (gap > 0.0 and TINY < length < LARGE and top1 + top2 < NO_BOUND):
        return 0.0
    if top1 + top2 == 0.0:
        return math.inf
    return later(0.0, min(gap / (top1 + top2), LONGEST))
