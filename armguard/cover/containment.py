"""The proof that balls contain a surface: by subdivision, with rounding on the safe side.

A piece whose hull points are in a ball is inside it, balls being convex: a triangle by its corners,
a round patch by those of `patches`, or because the ball, shrunk by the swelling, holds its core.
One that is not in any leaf, together with all balls above that leaf, is bisected until its parts
are, or until a point of it is seen to be outside. Each part then belongs to one leaf and lies in
each ball above it, so every set of nodes that cuts all paths from the root contains every piece.

Radii are reduced by what rounding may cost, and by a margin above the diagonal of the grid on
which geometry is digested: what is proved for one surface holds for all of the same digest.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from armguard.cover.fitting import cut_pieces
from armguard.cover.patches import ON_SURFACE, bisect_pieces, compute_hull_points
from armguard.cover.sphere_tree import MARGIN, SphereTree, compute_parents
from armguard.jit.arrays import FloatArray
from armguard.jit.kernels import kernel
from armguard.jit.numerics import TERM_ROUNDING

MOST_PIECES = 2_000_000  # a proof that needs more has failed
BATCH = 2048  # pieces examined at once
STEP = 2e-5  # `tighten` leaves radii no more than this too large, in [m], and
FEW_PIECES = 20_000  # tries no harder than this: balls that barely meet need very many


def is_contained(surface: FloatArray, tree: SphereTree, most_pieces: int = MOST_PIECES) -> bool:
    """Whether each piece, or each part of it, is in a leaf and in all balls above that leaf.

    Args:
        surface: Pieces as `patches` has them, in [m], finite.
        tree: Balls in breadth-first order.
        most_pieces: When to give up.

    Returns:
        True only if it is proved. False: a corner of a part is outside, or no proof was found.
    """
    parents, is_leaf = compute_parents(tree), tree.child_count == 0
    scale = 2.0 * np.abs(surface).max(initial=0.0) + np.abs(tree.spheres).max()
    centers, radii = tree.spheres[:, :3], tree.spheres[:, 3] - MARGIN - TERM_ROUNDING * scale
    # Invariant: each part of the surface waits, or is proved to be in one leaf and all above it.
    waiting, examined = [surface], 0
    while waiting:
        pieces, rest = waiting[-1][:BATCH], waiting[-1][BATCH:]
        waiting[-1:] = [rest] if len(rest) else []
        examined += len(pieces)
        if examined > most_pieces:
            return False
        # Which hull points are in which balls; round pieces also by their core in a shrunk ball.
        points, nothing = compute_hull_points(pieces), np.zeros(len(pieces))
        inside = _find_inside(points, nothing, centers, radii)
        if pieces.shape[2] > 3:
            swelling = np.sqrt((pieces[:, :, 3:] ** 2).sum(axis=2).max(axis=1))
            core = np.ascontiguousarray(pieces[:, :, :3])
            whole = _find_inside(core, swelling, centers, radii)
            np.logical_or(inside, np.all(whole, axis=1, keepdims=True), out=inside)
        # A point counts as in a leaf only if it is in all balls above that leaf, too.
        for node in range(1, len(parents)):
            inside[:, :, node] &= inside[:, :, parents[node]]
        in_leaf: NDArray[np.bool_] = inside[:, :, is_leaf]
        if not in_leaf[:, :ON_SURFACE].any(axis=2).all():
            return False  # this very point of the surface is outside
        # A piece all of whose hull points are in one leaf is proved; the others are bisected.
        is_open = ~np.any(np.all(in_leaf, axis=1), axis=1)
        if is_open.any():
            waiting.append(bisect_pieces(pieces[is_open]))
    return True


def tighten(surface: FloatArray, tree: SphereTree, least: FloatArray | None = None) -> SphereTree:
    """Make each radius as small as the proof allows while the others stay, leaves first.

    Shrinking one ball never allows another to shrink further, so one pass is enough.

    Args:
        surface: Pieces as `patches` has them, in [m], finite.
        tree: Proved to contain them.
        least: Radii that need not be undercut, in [m]; None: zero. Shape (n,).
    """
    spheres = tree.spheres.copy()
    pieces = cut_pieces(surface)
    points = compute_hull_points(pieces)
    middles = points.mean(axis=1)
    sizes = np.sqrt(((points - middles[:, None]) ** 2).sum(axis=2)).max(axis=1)
    for node in reversed(range(len(spheres))):
        # The proof of a piece that this ball does not reach stays as it is.
        distances = np.sqrt(((middles - spheres[node, :3]) ** 2).sum(axis=1))
        near = pieces[distances <= spheres[node, 3] + sizes + MARGIN]
        enough = 0.0 if least is None else float(least[node])
        too_small, radius = enough, float(spheres[node, 3])
        trial = max(round(radius - STEP, 6), enough)
        while too_small < trial < radius:
            spheres[node, 3] = trial
            if is_contained(near, tree._replace(spheres=spheres), FEW_PIECES):
                radius = trial
            else:
                too_small = trial
            trial = round(0.5 * (too_small + radius), 6) if radius - too_small > STEP else -1.0
        spheres[node, 3] = radius
    return tree._replace(spheres=spheres)


def _find_inside(
    points: FloatArray, less: FloatArray, centers: FloatArray, radii: FloatArray
) -> NDArray[np.bool_]:
    """Which points (n, k, 3) are in which balls shrunk by `less` (n,). Shape (n, k, balls)."""
    inside = np.empty((*points.shape[:2], len(radii)), dtype=np.bool_)
    _compare(points, less, centers, radii, inside)
    return inside


@kernel
def _compare(points, less, centers, radii, inside):
    for i in range(points.shape[0]):
        for k in range(points.shape[1]):
            for node in range(len(radii)):
                x = points[i, k, 0] - centers[node, 0]
                y = points[i, k, 1] - centers[node, 1]
                z = points[i, k, 2] - centers[node, 2]
                reach = math.sqrt(x * x + y * y + z * z) + less[i]
                inside[i, k, node] = reach <= radii[node]
