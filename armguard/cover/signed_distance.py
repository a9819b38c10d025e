"""Signed distances of points from a surface of triangles, for fitting spheres.

Many meshes are shells, or have parts inside. Only distances from the outer surface matter. So
cavities are found by flooding a grid from outside, and triangles that the flood does not reach are
left out. A point is inside if it is in a cavity, or if the surface winds around it (generalised
winding number, which tolerates holes, duplicate faces and inverted winding). No proof uses these
distances: they determine only how tight a fit is, and the reported protrusion.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from armguard.contact.gjk import nearest_on_triangle, square_at
from armguard.cover.patches import bisect_pieces, measure_sides
from armguard.jit.arrays import FloatArray
from armguard.jit.kept_results import keep_results
from armguard.jit.kernels import kernel
from armguard.jit.numerics import PRUNING_SLACK

_BLOCK = 16  # triangles at most
_CELLS = 30_000  # about as many fill the box around a surface
_FINEST = 1e-4  # side of a cell at least, in [m]

MOST_KEPT = 64
"""Surfaces that are kept as they were arranged: those of the links of a few arms."""


class Surface(NamedTuple):
    """Triangles in blocks of neighbours, for compiled callers that ask for many distances."""

    triangles: FloatArray
    """Those that can be touched from outside, in [m]; a block's lie side by side. (m, 3, 3)."""
    starts: NDArray[np.int64]
    """Where each block starts, and the end of the last. Shape (blocks + 1,)."""
    balls: FloatArray
    """Centre and radius of a ball around each block, in [m]. Shape (blocks, 4)."""
    corner: FloatArray
    """Least corner of a grid of cells around the surface, in [m]. Shape (3,)."""
    step: float
    """Side of a cell, in [m]."""
    is_cavity: NDArray[np.bool_]
    """Cells apart from the surface that it closes off, but for openings smaller than a cell."""


def compute_signed_distances(points: FloatArray, surface: FloatArray | Surface) -> FloatArray:
    """Distance from each point to the nearest triangle, negative inside the surface.

    Args:
        points: In [m]. Shape (n, 3).
        surface: Triangles in [m], shape (m, 3, 3), or what `arrange_surface` made of them.

    Returns:
        In [m]. Shape (n,).
    """
    if not isinstance(surface, Surface):
        surface = arrange_surface(surface)
    distances = np.empty(len(points))
    _signed_distances(np.ascontiguousarray(points), surface, distances)
    return distances


@keep_results(MOST_KEPT)
def arrange_surface(triangles: FloatArray) -> Surface:
    """Find cavities and leave out what can be touched from within only."""
    whole = _sort_into_blocks(triangles)
    corners = triangles.reshape(-1, 3)
    extent = np.ptp(corners, axis=0)
    thinnest = 0.01 * float(extent.max())
    step = max((float(np.prod(np.maximum(extent, thinnest))) / _CELLS) ** (1 / 3), _FINEST)
    counts = np.ceil(extent / step).astype(np.int64) + 4
    corner = corners.min(axis=0) - 2.0 * step
    # A step that crosses the surface has an end within half a step of it.
    is_free = np.ones(tuple(counts), dtype=np.bool_)
    _mark_near(corner, step, whole, 0.55 * step, is_free)
    is_wet = _flood(is_free)
    is_outer = _touch(triangles, is_wet, corner, step)
    outer = _sort_into_blocks(triangles[is_outer]) if is_outer.any() else whole
    return outer._replace(corner=corner, step=step, is_cavity=is_free & ~is_wet)


def _sort_into_blocks(triangles: FloatArray) -> Surface:
    """Halves of halves, along the longest side each time; no cavities."""
    middles = triangles.mean(axis=1)
    waiting, blocks = [np.arange(len(triangles))], []
    while waiting:
        members = waiting.pop()
        if len(members) <= _BLOCK:
            blocks.append(members)
            continue
        axis = int(np.argmax(np.ptp(middles[members], axis=0)))
        members = members[np.argsort(middles[members, axis], kind="stable")]
        half = len(members) // 2
        waiting += [members[half:], members[:half]]
    balls = np.empty((len(blocks), 4))
    for ball, members in zip(balls, blocks, strict=True):
        corners = triangles[members].reshape(-1, 3)
        ball[:3] = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
        ball[3] = np.sqrt(((corners - ball[:3]) ** 2).sum(axis=1)).max()
    return Surface(
        np.ascontiguousarray(triangles[np.concatenate(blocks)]),
        np.cumsum([0, *map(len, blocks)]),
        balls,
        np.zeros(3),
        1.0,
        np.zeros((0, 0, 0), dtype=np.bool_),
    )


def _flood(is_free: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Cells that can be reached from the first layer by steps between free neighbours."""
    is_wet = np.zeros_like(is_free)
    is_wet[0] = is_free[0]
    flooded = 0
    while flooded < (flooded := int(is_wet.sum())):
        for axis in range(3):
            wet, free = np.moveaxis(is_wet, axis, 0), np.moveaxis(is_free, axis, 0)
            for i in range(1, len(wet)):
                wet[i] |= wet[i - 1] & free[i]
            for i in range(len(wet) - 1, 0, -1):
                wet[i - 1] |= wet[i] & free[i - 1]
    return is_wet


def _touch(
    triangles: FloatArray, is_wet: NDArray[np.bool_], corner: FloatArray, step: float
) -> NDArray[np.bool_]:
    """Which triangles have a wet cell next to one of their own. Shape (n,)."""
    near = is_wet.copy()
    for axis in range(3):
        wide, narrow = np.moveaxis(near, axis, 0), np.moveaxis(near.copy(), axis, 0)
        wide[1:] |= narrow[:-1]
        wide[:-1] |= narrow[1:]
    touched = np.zeros(len(triangles), dtype=np.bool_)
    pieces, owners = triangles, np.arange(len(triangles))
    while len(pieces):
        x, y, z = np.floor((pieces.mean(axis=1) - corner) / step).astype(np.int64).T
        touched[owners[near[x, y, z]]] = True
        keep = (measure_sides(pieces) > step**2) & ~touched[owners]
        pieces, owners = bisect_pieces(pieces[keep]), np.tile(owners[keep], 2)
    return touched


@kernel
def _mark_near(corner, step, surface, limit, is_free):
    """Mark as not free all cells whose middles are no farther from the surface than `limit`."""
    for i in range(is_free.shape[0]):
        x = corner[0] + step * (i + 0.5)
        for j in range(is_free.shape[1]):
            y = corner[1] + step * (j + 0.5)
            k = 0
            # Invariant: all cells of this row before k are marked as they should be.
            while k < is_free.shape[2]:
                room = measure_distance(x, y, corner[2] + step * (k + 0.5), surface)
                if room > limit:
                    # Each cell on the way is nearer by no more than a step.
                    k += 1 + int(min((room - limit) / (step * (1.0 + PRUNING_SLACK)), 1e6))
                else:
                    is_free[i, j, k] = False
                    k += 1


@kernel
def _signed_distances(points, surface, distances):
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        distance = measure_distance(x, y, z, surface)
        distances[i] = -distance if is_inside(x, y, z, surface) else distance


@kernel
def measure_distance(px, py, pz, surface):
    """Distance to the nearest triangle, for compiled callers."""
    triangles, starts, balls = surface.triangles, surface.starts, surface.balls
    # Upper bound: some triangle is no farther than the far side of its block's ball.
    farthest = math.inf
    for block in range(len(balls)):
        x, y, z = balls[block, 0] - px, balls[block, 1] - py, balls[block, 2] - pz
        farthest = min(farthest, math.sqrt(x * x + y * y + z * z) + balls[block, 3])
    farthest *= 1.0 + PRUNING_SLACK
    # Invariant: some triangle is no farther than `farthest`, so a block whose ball is all beyond
    # cannot hold the nearest one.
    nearest = math.inf
    for block in range(len(balls)):
        x, y, z = balls[block, 0] - px, balls[block, 1] - py, balls[block, 2] - pz
        if not (math.sqrt(x * x + y * y + z * z) - balls[block, 3] <= farthest):
            continue
        for j in range(starts[block], starts[block + 1]):
            nearest = min(nearest, _triangle_squared(triangles[j], px, py, pz))
        farthest = min(farthest, math.sqrt(nearest))
    return math.sqrt(nearest)


@kernel
def is_inside(px, py, pz, surface):
    """Whether the surface winds around a point or closes it off, for compiled callers."""
    triangles, cells = surface.triangles, surface.is_cavity
    x = math.floor((px - surface.corner[0]) / surface.step)
    y = math.floor((py - surface.corner[1]) / surface.step)
    z = math.floor((pz - surface.corner[2]) / surface.step)
    # A cell of a cavity is inside, though what lines the cavity is left out of the triangles.
    is_near = 0 <= x < cells.shape[0] and 0 <= y < cells.shape[1] and 0 <= z < cells.shape[2]
    if is_near and cells[x, y, z]:
        return True
    # Elsewhere the winding number decides: the solid angle of all triangles, over 4 pi.
    solid_angle = 0.0
    for j in range(len(triangles)):
        ax, ay, az = triangles[j, 0, 0] - px, triangles[j, 0, 1] - py, triangles[j, 0, 2] - pz
        bx, by, bz = triangles[j, 1, 0] - px, triangles[j, 1, 1] - py, triangles[j, 1, 2] - pz
        cx, cy, cz = triangles[j, 2, 0] - px, triangles[j, 2, 1] - py, triangles[j, 2, 2] - pz
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
    return abs(solid_angle) > 2.0 * math.pi


@kernel
def _triangle_squared(triangle, px, py, pz):
    """Squared distance from a point to a triangle, degenerate ones included."""
    ax, ay, az = triangle[0, 0] - px, triangle[0, 1] - py, triangle[0, 2] - pz
    bx, by, bz = triangle[1, 0] - px, triangle[1, 1] - py, triangle[1, 2] - pz
    cx, cy, cz = triangle[2, 0] - px, triangle[2, 1] - py, triangle[2, 2] - pz
    weights = nearest_on_triangle(ax, ay, az, bx, by, bz, cx, cy, cz)
    return square_at(ax, ay, az, bx, by, bz, cx, cy, cz, weights)
