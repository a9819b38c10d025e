"""The proof that balls contain triangles: by subdivision, with rounding on the safe side.

A triangle whose corners are in a ball is inside it, balls being convex. One that is not in any
leaf, together with all balls above that leaf, is bisected until its parts are, or until a corner
is seen to be outside. Each part then belongs to one leaf and lies in each ball above it, so every
set of nodes that cuts all paths from the root contains every triangle.

Radii are reduced by what rounding may cost, and by a margin above the diagonal of the grid on
which geometry is digested: what is proved for one surface holds for all of the same digest.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armguard.fitting import bisect_triangles, cut_triangles
from armguard.sphere_tree import MARGIN, SphereTree

Array = NDArray[np.float64]

ROUNDING = 1e-14  # relative: above what a distance and a bisected corner lose to rounding
MOST_PIECES = 2_000_000  # a proof that needs more has failed
BATCH = 2048  # pieces examined at once
STEP = 2e-5  # `tighten` leaves radii no more than this too large, in [m], and
FEW_PIECES = 20_000  # tries no harder than this: balls that barely meet need very many


def is_contained(triangles: Array, tree: SphereTree, most_pieces: int = MOST_PIECES) -> bool:
    """Whether each triangle, or each part of it, is in a leaf and in all balls above that leaf.

    Args:
        triangles: In [m], finite. Shape (n, 3, 3).
        tree: Balls in breadth-first order.
        most_pieces: When to give up.

    Returns:
        True only if it is proved. False: a corner of a part is outside, or no proof was found.
    """
    parents, is_leaf = compute_parents(tree), tree.child_count == 0
    scale = np.abs(triangles).max(initial=0.0) + np.abs(tree.spheres).max()
    centers, radii = tree.spheres[:, :3], tree.spheres[:, 3] - MARGIN - ROUNDING * scale
    waiting, examined = [triangles], 0
    while waiting:
        pieces, rest = waiting[-1][:BATCH], waiting[-1][BATCH:]
        waiting[-1:] = [rest] if len(rest) else []
        examined += len(pieces)
        if examined > most_pieces:
            return False
        offsets = pieces[:, :, None, :] - centers
        inside = np.sqrt((offsets**2).sum(axis=3)) <= radii
        for node in range(1, len(parents)):
            inside[:, :, node] &= inside[:, :, parents[node]]
        inside = inside[:, :, is_leaf]
        if not inside.any(axis=2).all():
            return False  # this very corner is outside
        is_open = ~inside.all(axis=1).any(axis=1)
        if is_open.any():
            waiting.append(bisect_triangles(pieces[is_open]))
    return True


def tighten(triangles: Array, tree: SphereTree, least: Array | None = None) -> SphereTree:
    """Make each radius as small as the proof allows while the others stay, leaves first.

    Shrinking one ball never allows another to shrink further, so one pass is enough.

    Args:
        triangles: In [m], finite. Shape (n, 3, 3).
        tree: Proved to contain them.
        least: Radii that need not be undercut, in [m]; None: zero. Shape (n,).
    """
    spheres = tree.spheres.copy()
    pieces = cut_triangles(triangles)
    middles = pieces.mean(axis=1)
    sizes = np.sqrt(((pieces - middles[:, None]) ** 2).sum(axis=2)).max(axis=1)
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


def compute_parents(tree: SphereTree) -> NDArray[np.int64]:
    """Index of each node's parent, the root's own for the root."""
    return np.concatenate([[0], np.repeat(np.arange(len(tree.spheres)), tree.child_count)])
