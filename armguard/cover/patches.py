"""Pieces of surface, flat or round, and points whose convex hull contains them.

A ball is a point swollen by a radius, a capsule a segment. Its surface is cut into patches: each
is made of all sums of a point in the hull of three core corners and a vector of the swelling's
length in the cone of three such vectors. Halving the core or the cone halves the patch, without
gaps. A triangle is a patch that is not swollen.

With unit vectors u_i at most e apart, any mean w of them has |w|² >= 1 - e²/3. The unit vector
along w is w times at most s = 1 / sqrt(1 - e²/3), so it lies in the hull of all u_i and s u_i, and
the patch in that of their sums with the core's corners. The finer a patch, the closer its hull.

Pieces are arrays of shape (n, 3, 3) if all are flat: corners; and of shape (n, 3, 6) otherwise:
corners of the core, then swelling.
"""

from __future__ import annotations

import numpy as np

from armguard.jit.arrays import FloatArray
from armguard.jit.numerics import SUM_ROUNDING

ROUND_UP = 1.0 + SUM_ROUNDING  # widens a hull past the rounding of its construction
ON_SURFACE = 9  # the first so many of a round patch's hull points lie on it


def swell_nothing(triangles: FloatArray) -> FloatArray:
    """Triangles as patches; (n, 3, 3) to (n, 3, 6)."""
    return np.concatenate([triangles, np.zeros_like(triangles)], axis=2)


def drop_nothing(patches: FloatArray) -> FloatArray:
    """Patches as triangles, if that is all they are; (n, 3, 6) to (n, 3, 3) or as they were."""
    return patches if patches[:, :, 3:].any() else np.ascontiguousarray(patches[:, :, :3])


def place_patches(rotation: FloatArray, translation: FloatArray, patches: FloatArray) -> FloatArray:
    """Patches of one frame in another. Shape (n, 3, 6), in [m]."""
    core, swelling = patches[:, :, :3], patches[:, :, 3:]
    return np.concatenate([core @ rotation.T + translation, swelling @ rotation.T], axis=2)


def compute_corners(pieces: FloatArray) -> FloatArray:
    """Triangles whose corners lie on the surface. Shape (n, 3, 3)."""
    return pieces if pieces.shape[2] == 3 else pieces[:, :, :3] + pieces[:, :, 3:]


def measure_sides(pieces: FloatArray) -> FloatArray:
    """Square of the longest side of each, of core or swelling, in [m²]. Shape (n,)."""
    squared = _square_sides(pieces[:, :, :3])
    return squared if pieces.shape[2] == 3 else np.maximum(squared, _square_sides(pieces[:, :, 3:]))


def compute_hull_points(pieces: FloatArray) -> FloatArray:
    """Points whose convex hull contains each piece; (n, 3, 3) if flat, otherwise (n, 18, 3)."""
    if pieces.shape[2] == 3:
        return pieces
    core, swelling = pieces[:, :, :3], pieces[:, :, 3:]
    squared = (swelling**2).sum(axis=2).max(axis=1)
    share = np.divide(_square_sides(swelling), 3.0 * squared, where=squared > 0.0, out=squared * 0)
    outwards = ROUND_UP / np.sqrt(1.0 - share)
    near = core[:, :, None] + swelling[:, None]
    far = core[:, :, None] + (swelling * outwards[:, None, None])[:, None]
    return np.concatenate([near, far], axis=1).reshape(-1, 2 * ON_SURFACE, 3)


def bisect_pieces(pieces: FloatArray) -> FloatArray:
    """Cut each in two at its longest side; n become 2n."""
    if pieces.shape[2] == 3:
        return _bisect(pieces)
    core, swelling = pieces[:, :, :3], pieces[:, :, 3:]
    by_core = _square_sides(core) >= _square_sides(swelling)
    halves = _bisect(swelling[~by_core])
    length = np.sqrt((swelling[~by_core, :1] ** 2).sum(axis=2, keepdims=True))
    halves *= np.concatenate([length, length]) / np.sqrt((halves**2).sum(axis=2, keepdims=True))
    return np.concatenate(
        [
            np.concatenate([_bisect(core[by_core]), np.tile(swelling[by_core], (2, 1, 1))], axis=2),
            np.concatenate([np.tile(core[~by_core], (2, 1, 1)), halves], axis=2),
        ]
    )


def _square_sides(triangles: FloatArray) -> FloatArray:
    longest: FloatArray = (
        ((triangles - np.roll(triangles, -1, axis=1)) ** 2).sum(axis=2).max(axis=1)
    )
    return longest


def _bisect(triangles: FloatArray) -> FloatArray:
    """Cut each triangle in two at the middle of its longest edge; (n, 3, 3) to (2n, 3, 3)."""
    squared = ((triangles - np.roll(triangles, -1, axis=1)) ** 2).sum(axis=2)
    turn = (np.argmax(squared, axis=1)[:, None] + np.arange(3)) % 3
    a, b, c = np.take_along_axis(triangles, turn[:, :, None], axis=1).transpose(1, 0, 2)
    middle = 0.5 * (a + b)
    return np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
