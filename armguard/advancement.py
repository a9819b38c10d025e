"""Earliest possible contact of two bounded bodies: the kernels that everything else rests on.

A unit vector n, the *witness*, proves that a sphere (body 1) and the rounded hull of up to eight
points (body 2) are apart at time t if, for every point of the hull,

    gap(n, t) = n.x - contact_distance - D1(t) - D2(t) > 0,

where D bounds how far a body comes along its side of n with its acceleration, speed, age and
velocity error. Every gap is concave in t, so it is followed piece by piece to its root in closed
form, then n is turned to where the bodies were carried meanwhile, and so on: *tangent
advancement*. Each time on the way is a proven lower bound; more advances come closer.

Rounding. With e = 2**-53 and any witness, whatever its direction:

- |n| is 1 to 4.5 e, a component of x is right to e, n.x adds 3 e: 8.5 e |x| in n.x. D is right to
  8 e of q s, with q the largest speed that occurs in it and s the time it covers; the five terms
  of the gap add 4 e of each. SLACK = 16 e of |x| + contact_distance + q1 s1 + q2 s2 is subtracted.
- A closing speed is inflated by SLACK of |v| + velocity_error, never of its own small value; a
  slope by SLACK of q; the step that solves `gap - slope h - accel h^2 / 2 = 0`, whose rounding is
  below 6 e, is shortened by 8 e, and the sum of times by 4 e. Between its two ends a step is safe
  because slope and acceleration bound the gap from below (Taylor, not approximation).
- A piece that is taken to be shorter or longer than it is stays safe: top speed and acceleration
  each bound the motion everywhere.
- Squares are formed only where they neither overflow nor lose bits; outside, direction and root
  are rescaled by powers of two. Non-zero accelerations below TINY count as TINY, lengths below
  TINY as contact, so that whatever underflows (2**-1074) is far below SLACK of something present.
  Overflow makes the gap -inf or NaN and ends the search where it stands.
"""

from __future__ import annotations

import math
import sys

from numba import njit

from armguard.hull import nearest_on_hull

SLACK = 2.0**-49
TINY = 1e-280
HUGE = sys.float_info.max
MAX_PIECES = 8  # seven with both ages negative, and one to stop


@njit(error_model="numpy", cache=True)
def _top_speed(vx, vy, vz, size, speed, velocity_error):  # type: ignore[no-untyped-def]
    """The speed bound that holds: `speed`, or what was measured where that breaks it.

    `size` is |vx| + |vy| + |vz|, no less than |v|, and mostly enough to decide.
    """
    allowed = speed + velocity_error
    if size * (1.0 + SLACK) <= allowed:
        return speed
    largest = max(abs(vx), abs(vy), abs(vz))
    if not (largest > 0.0):
        return largest + velocity_error  # NaN, or a zero that no bound can break
    scaled_x, scaled_y, scaled_z = vx / largest, vy / largest, vz / largest
    norm = largest * math.sqrt(scaled_x**2 + scaled_y**2 + scaled_z**2)
    norm *= 1.0 + SLACK
    norm += 5e-324
    if norm <= allowed * (1.0 - SLACK):
        return speed
    return (norm + velocity_error) * (1.0 + SLACK)


@njit(error_model="numpy", cache=True)
def _direction(x, y, z):  # type: ignore[no-untyped-def]
    """Unit vector along (x, y, z), to 4.5 * 2**-53; NaN for the zero vector."""
    square = x * x + y * y + z * z
    if not (1e-280 < square < 1e300):
        largest = max(abs(x), abs(y), abs(z))
        if not (0.0 < largest <= HUGE):
            return math.nan, math.nan, math.nan
        exponent = math.frexp(largest)[1]
        x, y, z = math.ldexp(x, -exponent), math.ldexp(y, -exponent), math.ldexp(z, -exponent)
        square = x * x + y * y + z * z
    inverse = 1.0 / math.sqrt(square)
    return x * inverse, y * inverse, z * inverse


@njit(error_model="numpy", cache=True)
def _motion(closing, velocity_error, slop, top, accel, age, s):  # type: ignore[no-untyped-def]
    """One body's advance along a direction, `s` seconds from its stamp.

    Returns the advance, the largest speed in it, its slope and curvature in time, and the time
    from the stamp (either way) at which the speed bound bites, inf if that lies further out.
    """
    if s >= 0.0:
        start = closing + velocity_error + slop
        if start > top:
            start = top
        reached = start + accel * s
        if reached < top * (1.0 - SLACK):
            return s * (start + 0.5 * accel * s), abs(start) + accel * s, reached, accel, math.inf
        bite = (top - start) / accel if start < top else 0.0
        until = min(bite, s)
        return 0.5 * (start + top) * until + top * (s - until), top, top, 0.0, bite
    # The stamp is newer than the moment asked for: the same motion backwards.
    start = velocity_error - closing + slop
    if start > top:
        start = top
    span = -s
    reached = start + accel * span
    if reached < top * (1.0 - SLACK):
        advance = span * (start + 0.5 * accel * span)
        return advance, abs(start) + accel * span, -reached, accel, math.inf
    bite = (top - start) / accel if start < top else 0.0
    until = min(bite, span)
    advance = 0.5 * (start + top) * until + top * (span - until)
    # Too close to the end of its piece to step there: the next piece's curvature is safe in both.
    steppable = bite == 0.0 or span - bite > -2.0 * SLACK * age
    return advance, top, -top, 0.0 if steppable else accel, bite


@njit(error_model="numpy", cache=True)
def _piece_end(s, slope, curvature, top, age, bite, t):  # type: ignore[no-untyped-def]
    """Until when the slope and curvature that `_motion` gave at `t` describe the motion."""
    if s >= 0.0:
        end = t + (top - slope) / curvature
        return end if end > t else math.inf  # also without curvature, and where t cannot resolve it
    if curvature == 0.0 and 0.0 < bite < math.inf:
        return (-age - bite) * (1.0 - SLACK)
    return -age


@njit(error_model="numpy", cache=True)
def _step(gap, slope, accel):  # type: ignore[no-untyped-def]
    """Largest h up to which gap - slope h - accel h^2 / 2 stays positive, for gap > 0."""
    if accel == 0.0 and slope <= 0.0:
        return math.inf
    square = slope * slope + 2.0 * accel * gap
    if 1e-280 < square < 1e300:
        root = math.sqrt(square)
    else:
        root = math.hypot(slope, math.sqrt(accel) * math.sqrt(gap) * math.sqrt(2.0))
    step = 2.0 * gap / (slope + root) if slope >= 0.0 else (root - slope) / accel
    step *= 1.0 - SLACK
    return HUGE if step > HUGE else step  # only what never closes takes for ever; NaN stays


@njit(error_model="numpy", cache=True)
def _follow(  # type: ignore[no-untyped-def]
    along, length, t,
    closing1, velocity_error1, slop1, top1, accel1, age1,
    closing2, velocity_error2, slop2, top2, accel2, age2,
):  # fmt: skip
    """Follow one witness's gap from `t` to its root, piece by piece.

    `along` is n.x - contact_distance, `length` the magnitude that its rounding goes by. Returns
    the time reached, no earlier than `t`, and for both bodies the time from their stamps for which
    they are carried along their measured velocities when the next witness is chosen.
    """
    bite1 = 0.0
    bite2 = 0.0
    for _ in range(MAX_PIECES):
        s1 = age1 + t
        s2 = age2 + t
        advance1, fast1, slope1, curvature1, bite1 = _motion(
            closing1, velocity_error1, slop1, top1, accel1, age1, s1
        )
        advance2, fast2, slope2, curvature2, bite2 = _motion(
            closing2, velocity_error2, slop2, top2, accel2, age2, s2
        )
        slack = SLACK * (length + fast1 * abs(s1) + fast2 * abs(s2))
        gap = along - advance1 - advance2 - slack
        if not gap > 0.0:
            break
        slope = slope1 + slope2 + SLACK * (fast1 + fast2)
        step = _step(gap, slope, curvature1 + curvature2)
        if (
            s1 < 0.0
            or s2 < 0.0
            or slope1 + curvature1 * step > top1
            or slope2 + curvature2 * step > top2
        ):
            end1 = _piece_end(s1, slope1, curvature1, top1, age1, bite1, t)
            end2 = _piece_end(s2, slope2, curvature2, top2, age2, bite2, t)
            end = min(end1, end2)
            if not end >= t + step:
                if not end > t:
                    break
                t = end
                continue
        if step == math.inf:
            t = math.inf
        elif step > 0.0:
            t = max(t, min(t + step, HUGE) * (1.0 - SLACK))
        break
    return t, bite1, bite2


@njit(error_model="numpy", cache=True)
def _carry(s, bite):  # type: ignore[no-untyped-def]
    """How long a body is carried along its velocity until `s`, given when its speed bound bites."""
    return min(s, bite) if s >= 0.0 else max(s, -bite)


@njit(error_model="numpy", cache=True)
def _slop(size, velocity_error):  # type: ignore[no-untyped-def]
    """What rounding may take from a closing speed: a few ulp of the velocity it is taken from."""
    return SLACK * (max(size, TINY) + velocity_error) if size > 0.0 else 0.0


@njit(error_model="numpy", cache=True)
def _are_bounds(accel, speed, velocity_error, age):  # type: ignore[no-untyped-def]
    return accel >= 0.0 and speed >= 0.0 and velocity_error >= 0.0 and abs(age) < math.inf


@njit(error_model="numpy", cache=True)
def ball_contact_time(  # type: ignore[no-untyped-def]
    x, y, z, contact_distance,
    vx1, vy1, vz1, accel1, speed1, velocity_error1, age1,
    vx2, vy2, vz2, accel2, speed2, velocity_error2, age2,
    advances, trace,
):  # fmt: skip
    """`trace_contact_time` for a single point at (x, y, z) relative to the sphere's centre."""
    if not (
        _are_bounds(accel1, speed1, velocity_error1, age1)
        and _are_bounds(accel2, speed2, velocity_error2, age2)
    ):
        return 0.0
    length = abs(x) + abs(y) + abs(z) + contact_distance
    if not (length > TINY and contact_distance >= 0.0):
        return 0.0
    if 0.0 < accel1 < TINY:
        accel1 = TINY
    if 0.0 < accel2 < TINY:
        accel2 = TINY
    size1 = abs(vx1) + abs(vy1) + abs(vz1)
    size2 = abs(vx2) + abs(vy2) + abs(vz2)
    top1 = _top_speed(vx1, vy1, vz1, size1, speed1, velocity_error1)
    top2 = _top_speed(vx2, vy2, vz2, size2, speed2, velocity_error2)
    slop1 = _slop(size1, velocity_error1)
    slop2 = _slop(size2, velocity_error2)

    nx, ny, nz = _direction(x, y, z)
    if age1 != 0.0 or age2 != 0.0:
        # Aged bodies have been carried on already; how far depends on where one looks from.
        closing1 = nx * vx1 + ny * vy1 + nz * vz1
        closing2 = -(nx * vx2 + ny * vy2 + nz * vz2)
        bite1 = _motion(closing1, velocity_error1, slop1, top1, accel1, age1, age1)[4]
        bite2 = _motion(closing2, velocity_error2, slop2, top2, accel2, age2, age2)[4]
        carry1 = _carry(age1, bite1)
        carry2 = _carry(age2, bite2)
        cx, cy, cz = _direction(
            x + vx2 * carry2 - vx1 * carry1,
            y + vy2 * carry2 - vy1 * carry1,
            z + vz2 * carry2 - vz1 * carry1,
        )
        if not math.isnan(cx):
            nx, ny, nz = cx, cy, cz

    t = 0.0
    for k in range(advances):
        if trace is not None:
            trace[k, 0], trace[k, 1], trace[k, 2], trace[k, 3] = t, nx, ny, nz
        before = t
        t, bite1, bite2 = _follow(
            nx * x + ny * y + nz * z - contact_distance, length, t,
            nx * vx1 + ny * vy1 + nz * vz1, velocity_error1, slop1, top1, accel1, age1,
            -(nx * vx2 + ny * vy2 + nz * vz2), velocity_error2, slop2, top2, accel2, age2,
        )  # fmt: skip
        if not before < t < math.inf:
            break
        carry1 = _carry(age1 + t, bite1)
        carry2 = _carry(age2 + t, bite2)
        nx, ny, nz = _direction(
            x + vx2 * carry2 - vx1 * carry1,
            y + vy2 * carry2 - vy1 * carry1,
            z + vz2 * carry2 - vz1 * carry1,
        )
    return t


@njit(error_model="numpy", cache=True)
def _hull_direction(  # type: ignore[no-untyped-def]
    px, py, pz, vx, vy, vz, carry1, points, velocities, count, carry2
):  # fmt: skip
    """From the sphere to the hull, both carried along their velocities."""
    x, y, z = nearest_on_hull(
        px + vx * carry1, py + vy * carry1, pz + vz * carry1, points, velocities, count, carry2
    )
    return _direction(x, y, z)


@njit(error_model="numpy", cache=True)
def trace_contact_time(  # type: ignore[no-untyped-def]
    px, py, pz, vx, vy, vz, accel1, speed1, velocity_error1, age1,
    points, velocities, count, accel2, speed2, velocity_error2, age2,
    contact_distance, advances, trace,
):  # fmt: skip
    """`pair_contact_time` that leaves its witnesses behind.

    `trace` is None, which costs nothing, or has the shape (advances, 4): row k takes the time from
    which on the k-th witness is in charge, in [s], and the witness. Rows that were not needed stay
    as they were; the last one written may be of a witness that did not bring the time forward.
    """
    if count == 1:
        return ball_contact_time(
            points[0, 0] - px, points[0, 1] - py, points[0, 2] - pz, contact_distance,
            vx, vy, vz, accel1, speed1, velocity_error1, age1,
            velocities[0, 0], velocities[0, 1], velocities[0, 2],
            accel2, speed2, velocity_error2, age2, advances, trace,
        )  # fmt: skip
    if not (
        count > 1
        and _are_bounds(accel1, speed1, velocity_error1, age1)
        and _are_bounds(accel2, speed2, velocity_error2, age2)
        and contact_distance >= 0.0
    ):
        return 0.0
    if 0.0 < accel1 < TINY:
        accel1 = TINY
    if 0.0 < accel2 < TINY:
        accel2 = TINY
    size1 = abs(vx) + abs(vy) + abs(vz)
    top1 = _top_speed(vx, vy, vz, size1, speed1, velocity_error1)
    slop1 = _slop(size1, velocity_error1)

    nx, ny, nz = _hull_direction(px, py, pz, vx, vy, vz, 0.0, points, velocities, count, 0.0)
    t = 0.0
    refine = age1 != 0.0 or age2 != 0.0
    k = 0
    while k < advances:
        closing1 = nx * vx + ny * vy + nz * vz
        reached = math.inf
        bite1 = math.inf
        bite2 = math.inf
        for j in range(count):
            x = points[j, 0] - px
            y = points[j, 1] - py
            z = points[j, 2] - pz
            length = abs(x) + abs(y) + abs(z) + contact_distance
            if not length > TINY:
                return t
            ux, uy, uz = velocities[j, 0], velocities[j, 1], velocities[j, 2]
            size2 = abs(ux) + abs(uy) + abs(uz)
            root, b1, b2 = _follow(
                nx * x + ny * y + nz * z - contact_distance, length, t,
                closing1, velocity_error1, slop1, top1, accel1, age1,
                -(nx * ux + ny * uy + nz * uz), velocity_error2, _slop(size2, velocity_error2),
                _top_speed(ux, uy, uz, size2, speed2, velocity_error2), accel2, age2,
            )  # fmt: skip
            if root < reached or j == 0:
                reached, bite1, bite2 = root, b1, b2
            if not root > t:
                break
        if refine:
            # Aged bodies have been carried on already; how far depends on where one looks from.
            refine = False
            cx, cy, cz = _hull_direction(
                px, py, pz, vx, vy, vz, _carry(age1, bite1),
                points, velocities, count, _carry(age2, bite2),
            )  # fmt: skip
            if not math.isnan(cx):
                nx, ny, nz = cx, cy, cz
                continue
        if trace is not None:
            trace[k, 0], trace[k, 1], trace[k, 2], trace[k, 3] = t, nx, ny, nz
        if not t < reached < math.inf:
            return max(t, reached)
        t = reached
        nx, ny, nz = _hull_direction(
            px, py, pz, vx, vy, vz, _carry(age1 + t, bite1),
            points, velocities, count, _carry(age2 + t, bite2),
        )  # fmt: skip
        k += 1
    return t


@njit(error_model="numpy", cache=True)
def pair_contact_time(  # type: ignore[no-untyped-def]
    px, py, pz, vx, vy, vz, accel1, speed1, velocity_error1, age1,
    points, velocities, count, accel2, speed2, velocity_error2, age2,
    contact_distance, advances,
):  # fmt: skip
    """Earliest time at which a sphere and the rounded hull of points[:count] could touch.

    (px, py, pz) is the centre of the sphere at its stamp in [m], (vx, vy, vz) its velocity in
    [m/s]; accel1 [m/s^2] and speed1 [m/s] are its bounds, inf where there is none; velocity_error1
    [m/s] is what the velocity may be off by; age1 [s] is now minus its stamp, negative where that
    is newer than now. `points` and `velocities`, shape (8, 3), float64, [m] and [m/s], are the
    corners of the hull: count 1 is a ball, 2 a capsule, 8 a box; their bounds, error and age hold
    for each corner. contact_distance [m] is both radii, margin and position errors. `advances` is
    the most tangent advances: more come closer, and every number is safe.

    Returns:
        A time from now in [s] before which there is no contact; inf if never, 0 if contact is
        possible now or any input is NaN, negative or infinite where that means nothing.
    """
    return trace_contact_time(
        px, py, pz, vx, vy, vz, accel1, speed1, velocity_error1, age1,
        points, velocities, count, accel2, speed2, velocity_error2, age2,
        contact_distance, advances, None,
    )  # fmt: skip


@njit(error_model="numpy", cache=True)
def pair_distance_time(  # type: ignore[no-untyped-def]
    px, py, pz, vx, vy, vz, accel1, speed1, velocity_error1, age1,
    points, velocities, count, accel2, speed2, velocity_error2, age2,
    contact_distance,
):  # fmt: skip
    """The rung below the first advance: distance over the closing speed that bounds allow.

    Arguments and result as for `pair_contact_time`; the accelerations do not matter.
    """
    if not (
        count >= 1
        and _are_bounds(accel1, speed1, velocity_error1, age1)
        and _are_bounds(accel2, speed2, velocity_error2, age2)
        and contact_distance >= 0.0
    ):
        return 0.0
    nx, ny, nz = _hull_direction(px, py, pz, vx, vy, vz, 0.0, points, velocities, count, 0.0)
    top1 = _top_speed(vx, vy, vz, abs(vx) + abs(vy) + abs(vz), speed1, velocity_error1)
    distance = math.inf
    length = contact_distance
    top2 = 0.0
    for j in range(count):
        x = points[j, 0] - px
        y = points[j, 1] - py
        z = points[j, 2] - pz
        ux, uy, uz = velocities[j, 0], velocities[j, 1], velocities[j, 2]
        size2 = abs(ux) + abs(uy) + abs(uz)
        top = _top_speed(ux, uy, uz, size2, speed2, velocity_error2)
        along = nx * x + ny * y + nz * z
        if not (along >= 0.0 and top >= 0.0):
            return 0.0
        distance = min(distance, along)
        length = max(length, abs(x) + abs(y) + abs(z))
        top2 = max(top2, top)
    grown = top1 * abs(age1) + top2 * abs(age2)
    gap = distance - contact_distance - grown - SLACK * (2.0 * length + grown)
    if not (gap > 0.0 and length > TINY):
        return 0.0
    return min(gap / (top1 + top2), HUGE) * (1.0 - SLACK) if top1 + top2 > 0.0 else math.inf
