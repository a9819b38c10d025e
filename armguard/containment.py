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

from armguard.fitting import bisect_triangles
from armguard.sphere_tree import GRID, MARGIN, SphereTree

Array = NDArray[np.float64]

ROUNDING = 1e-14  # relative: above what a distance and a bisected corner lose to rounding
MOST_PIECES = 2_000_000  # a proof that needs more has failed
BATCH = 2048  # pieces examined at once


def is_contained(triangles: Array, tree: SphereTree) -> bool:
    """Whether each triangle, or each part of it, is in a leaf and in all balls above that leaf.

    Args:
        triangles: In [m], finite. Shape (n, 3, 3).
        tree: Balls in breadth-first order.

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
        if examined > MOST_PIECES:
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


def tighten(triangles: Array, tree: SphereTree) -> SphereTree:
    """Make each radius as small as the proof allows while the others stay, leaves first.

    Shrinking one ball never allows another to shrink further, so one pass is enough: afterwards
    no ball could be smaller by more than a step of the grid.

    Args:
        triangles: In [m], finite. Shape (n, 3, 3).
        tree: Proved to contain them.
    """
    spheres = tree.spheres.copy()
    for node in reversed(range(len(spheres))):
        steps = round(spheres[node, 3] / GRID)
        enough, too_few = steps, 0
        trial = steps - 1
        while enough - too_few > 1:
            spheres[node, 3] = round(trial * GRID, 6)
            if is_contained(triangles, tree._replace(spheres=spheres)):
                enough = trial
            else:
                too_few = trial
            trial = (enough + too_few) // 2
        spheres[node, 3] = round(enough * GRID, 6)
    return tree._replace(spheres=spheres)


def compute_parents(tree: SphereTree) -> NDArray[np.int64]:
    """Index of each node's parent, the root's own for the root."""
    return np.concatenate([[0], np.repeat(np.arange(len(tree.spheres)), tree.child_count)])
