"""The point of a hull of at most eight moving points that is nearest to the origin.

Gilbert, Johnson and Keerthi's walk over simplices [Gilbert1988]_. The answer serves as a separating
direction only, and any direction is safe, so nothing here has to be exact: it has to be quick, to
allocate nothing and to end. A point of the hull is computed anew whenever it is needed, from where
it is and how long it is carried along its velocity.
"""

from __future__ import annotations

import math

from armguard.jit.kernels import kernel, separate_kernel

MAX_STEPS = 20
TOLERANCE = 1e-13


@kernel
def nearest_on_segment(ax, ay, az, bx, by, bz):
    """Weight of b in the point of segment a-b nearest to the origin."""
    dx, dy, dz = bx - ax, by - ay, bz - az
    square = dx * dx + dy * dy + dz * dz
    if not square > 0.0:
        return 0.0
    return min(1.0, max(0.0, -(ax * dx + ay * dy + az * dz) / square))


@kernel
def square_at(ax, ay, az, bx, by, bz, cx, cy, cz, weights):
    """Squared distance from the origin to the point of a-b-c with these weights of b and c."""
    b, c = weights
    x = ax + b * (bx - ax) + c * (cx - ax)
    y = ay + b * (by - ay) + c * (cy - ay)
    z = az + b * (bz - az) + c * (cz - az)
    return x * x + y * y + z * z


@kernel
def nearest_on_triangle(ax, ay, az, bx, by, bz, cx, cy, cz):
    """Weights of b and c in the point of triangle a-b-c nearest to the origin."""
    px, py, pz = bx - ax, by - ay, bz - az
    qx, qy, qz = cx - ax, cy - ay, cz - az
    pp = px * px + py * py + pz * pz
    pq = px * qx + py * qy + pz * qz
    qq = qx * qx + qy * qy + qz * qz
    ap = -(ax * px + ay * py + az * pz)
    aq = -(ax * qx + ay * qy + az * qz)
    determinant = pp * qq - pq * pq
    if determinant > 0.0:
        b = (ap * qq - aq * pq) / determinant
        c = (aq * pp - ap * pq) / determinant
        if b >= 0.0 and c >= 0.0 and b + c <= 1.0:
            return b, c
    # On an edge then: the nearest of three.
    ab = nearest_on_segment(ax, ay, az, bx, by, bz)
    ac = nearest_on_segment(ax, ay, az, cx, cy, cz)
    bc = nearest_on_segment(bx, by, bz, cx, cy, cz)
    best_b, best_c = ab, 0.0
    best = square_at(ax, ay, az, bx, by, bz, cx, cy, cz, (ab, 0.0))
    square = square_at(ax, ay, az, bx, by, bz, cx, cy, cz, (0.0, ac))
    if square < best:
        best, best_b, best_c = square, 0.0, ac
    if square_at(bx, by, bz, cx, cy, cz, cx, cy, cz, (bc, 0.0)) < best:
        best_b, best_c = 1.0 - bc, bc
    return best_b, best_c


@kernel
def _carried(j, ox, oy, oz, points, velocities, carry):
    return (
        points[j, 0] - ox + velocities[j, 0] * carry,
        points[j, 1] - oy + velocities[j, 1] * carry,
        points[j, 2] - oz + velocities[j, 2] * carry,
    )


@separate_kernel
def nearest_on_hull(ox, oy, oz, points, velocities, count, carry):
    """Vector from (ox, oy, oz) to the hull of points[:count], each carried for `carry` seconds.

    Arrays have the shape (k, 3), in [m] and [m/s]. The zero vector or a poor one where the origin
    is inside the hull or the hull is beyond what squares can hold.
    """
    # Invariant: (x, y, z) is the point of the simplex a, b, c, of which the first `size` count,
    # that is nearest to the origin; i0, i1, i2 are the numbers of its corners.
    i0 = 0
    i1 = 0
    i2 = 0
    size = 1
    ax, ay, az = _carried(i0, ox, oy, oz, points, velocities, carry)
    bx, by, bz = ax, ay, az
    cx, cy, cz = ax, ay, az
    x, y, z = ax, ay, az
    for _ in range(MAX_STEPS):
        # Support: the corner of the hull that is farthest towards the origin.
        square = x * x + y * y + z * z
        found = 0
        least = math.inf
        for j in range(count):
            px, py, pz = _carried(j, ox, oy, oz, points, velocities, carry)
            along = x * px + y * py + z * pz
            if along < least:
                least = along
                found = j
        # End: no corner is nearer by more than the tolerance, or the walk goes in a circle.
        if not square - least > TOLERANCE * square:
            break
        if found == i0 or (size > 1 and found == i1) or (size > 2 and found == i2):
            break
        # Subproblem: weights b and c of the nearest point of the simplex with the new corner.
        px, py, pz = _carried(found, ox, oy, oz, points, velocities, carry)
        if size == 1:
            i1, bx, by, bz = found, px, py, pz
            c = 0.0
            b = nearest_on_segment(ax, ay, az, bx, by, bz)
        elif size == 2:
            i2, cx, cy, cz = found, px, py, pz
            b, c = nearest_on_triangle(ax, ay, az, bx, by, bz, cx, cy, cz)
        else:
            # The new point with each edge of the triangle: the nearest of three faces.
            b, c = nearest_on_triangle(px, py, pz, ax, ay, az, bx, by, bz)
            best = square_at(px, py, pz, ax, ay, az, bx, by, bz, (b, c))
            out = 2
            b1, c1 = nearest_on_triangle(px, py, pz, ax, ay, az, cx, cy, cz)
            square = square_at(px, py, pz, ax, ay, az, cx, cy, cz, (b1, c1))
            if square < best:
                best, out, b, c = square, 1, b1, c1
            b1, c1 = nearest_on_triangle(px, py, pz, bx, by, bz, cx, cy, cz)
            if square_at(px, py, pz, bx, by, bz, cx, cy, cz, (b1, c1)) < best:
                out, b, c = 0, b1, c1
            # Now a is the new point, b and c the two that stay, in the order of the weights.
            if out == 2:
                i2, cx, cy, cz = i1, bx, by, bz
                i1, bx, by, bz = i0, ax, ay, az
            elif out == 1:
                i1, bx, by, bz = i0, ax, ay, az
            i0, ax, ay, az = found, px, py, pz
        x = ax + b * (bx - ax) + c * (cx - ax)
        y = ay + b * (by - ay) + c * (cy - ay)
        z = az + b * (bz - az) + c * (cz - az)
        # Corners without weight leave the simplex.
        size = 3
        if c == 0.0:
            size = 2
            if b == 0.0:
                size = 1
            elif b == 1.0:
                i0, ax, ay, az = i1, bx, by, bz
                size = 1
        elif b == 0.0 or b + c == 1.0:
            if b + c == 1.0:
                i0, ax, ay, az = i1, bx, by, bz
                b = 1.0 - c
            i1, bx, by, bz = i2, cx, cy, cz
            size = 2
            if c == 1.0:
                i0, ax, ay, az = i1, bx, by, bz
                size = 1
        if size < 3:
            cx, cy, cz = ax, ay, az
        if size < 2:
            bx, by, bz = ax, ay, az
    return x, y, z


@kernel
def distance_to_hull(ox, oy, oz, points, velocities, count):
    """Distance of a point from a hull of moving points where they are, at most; and the way there.

    By the direction of the nearest point: what lies beyond a plane across it is no nearer than the
    plane, so that the answer is never too much, however far the walk got.
    """
    x, y, z = nearest_on_hull(ox, oy, oz, points, velocities, count, 0.0)
    size = math.sqrt(x * x + y * y + z * z)
    if not size > 0.0:
        return 0.0, x, y, z
    least = math.inf
    for k in range(count):
        along = (points[k, 0] - ox) * x + (points[k, 1] - oy) * y + (points[k, 2] - oz) * z
        least = min(least, along / size)
    return max(least, 0.0), x, y, z
