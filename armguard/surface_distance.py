"""How far points are from a surface of triangles, and on which side of it: what makes spheres fit.

Inside is decided by the generalised winding number, which tolerates holes, duplicate faces and
inverted winding. Nothing that must be proved rests on it: a point taken to be outside by mistake
only makes a fit looser and its reported protrusion larger.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from armguard.compilation import kernel

Array = NDArray[np.float64]


def compute_signed_distances(points: Array, triangles: Array) -> Array:
    """Distance from each point to the nearest triangle, negative inside the surface.

    Args:
        points: In [m]. Shape (n, 3).
        triangles: In [m]. Shape (m, 3, 3).

    Returns:
        In [m]. Shape (n,).
    """
    distances = np.empty(len(points))
    _signed_distances(np.ascontiguousarray(points), np.ascontiguousarray(triangles), distances)
    return distances


@kernel
def _signed_distances(points, triangles, distances):  # type: ignore[no-untyped-def]
    for i in range(len(points)):
        distances[i] = signed_distance(points[i, 0], points[i, 1], points[i, 2], triangles)


@kernel
def signed_distance(px, py, pz, triangles):  # type: ignore[no-untyped-def]
    """One value of `compute_signed_distances`, for compiled callers."""
    nearest = math.inf
    solid_angle = 0.0
    for j in range(len(triangles)):
        ax, ay, az = triangles[j, 0, 0] - px, triangles[j, 0, 1] - py, triangles[j, 0, 2] - pz
        bx, by, bz = triangles[j, 1, 0] - px, triangles[j, 1, 1] - py, triangles[j, 1, 2] - pz
        cx, cy, cz = triangles[j, 2, 0] - px, triangles[j, 2, 1] - py, triangles[j, 2, 2] - pz
        nearest = min(nearest, _squared_distance(ax, ay, az, bx, by, bz, cx, cy, cz))
        a = math.sqrt(ax * ax + ay * ay + az * az)
        b = math.sqrt(bx * bx + by * by + bz * bz)
        c = math.sqrt(cx * cx + cy * cy + cz * cz)
        # The solid angle of a triangle, after van Oosterom and Strackee.
        solid_angle += 2.0 * math.atan2(
            ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx),
            a * b * c
            + (ax * bx + ay * by + az * bz) * c
            + (bx * cx + by * cy + bz * cz) * a
            + (cx * ax + cy * ay + cz * az) * b,
        )
    distance = math.sqrt(nearest)
    return -distance if abs(solid_angle) > 2.0 * math.pi else distance


@kernel(inline="always")
def _segment_squared(ax, ay, az, bx, by, bz):  # type: ignore[no-untyped-def]
    """Squared distance from the origin to segment ab."""
    ex, ey, ez = bx - ax, by - ay, bz - az
    length = ex * ex + ey * ey + ez * ez
    s = 0.0
    if length > 0.0:
        s = min(1.0, max(0.0, -(ax * ex + ay * ey + az * ez) / length))
    x, y, z = ax + s * ex, ay + s * ey, az + s * ez
    return x * x + y * y + z * z


@kernel(inline="always")
def _squared_distance(ax, ay, az, bx, by, bz, cx, cy, cz):  # type: ignore[no-untyped-def]
    """Squared distance from the origin to triangle abc, degenerate ones included."""
    ux, uy, uz = bx - ax, by - ay, bz - az
    wx, wy, wz = cx - ax, cy - ay, cz - az
    nx, ny, nz = uy * wz - uz * wy, uz * wx - ux * wz, ux * wy - uy * wx
    area = nx * nx + ny * ny + nz * nz
    if area > 0.0:
        height = ax * nx + ay * ny + az * nz
        px, py, pz = height * nx / area, height * ny / area, height * nz / area
        # Barycentric signs of the origin's foot on the plane.
        s = _side(ax - px, ay - py, az - pz, bx - px, by - py, bz - pz, nx, ny, nz)
        t = _side(bx - px, by - py, bz - pz, cx - px, cy - py, cz - pz, nx, ny, nz)
        u = _side(cx - px, cy - py, cz - pz, ax - px, ay - py, az - pz, nx, ny, nz)
        if s >= 0.0 and t >= 0.0 and u >= 0.0:
            return height * height / area
    return min(
        _segment_squared(ax, ay, az, bx, by, bz),
        _segment_squared(bx, by, bz, cx, cy, cz),
        _segment_squared(cx, cy, cz, ax, ay, az),
    )


@kernel(inline="always")
def _side(ax, ay, az, bx, by, bz, nx, ny, nz):  # type: ignore[no-untyped-def]
    return nx * (ay * bz - az * by) + ny * (az * bx - ax * bz) + nz * (ax * by - ay * bx)
