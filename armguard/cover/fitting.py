"""Spheres that cover triangles: a small tree of balls, fitted to stick out as little as possible.

Foam and cuRobo sample points and fit balls to them, so their sets leave surface uncovered. Here
the triangles are cut into small pieces, each piece lies wholly inside a leaf that owns it and
inside every ball above that leaf, so that each level of the tree, and each mixture of levels,
covers all of them. `armguard.cover` proves it again from the triangles alone.

Leaves: greedy set cover over a grid of candidate centres, where a ball of radius r at depth d
sticks out by r - d; then, in turns, every piece goes to the ball that needs to stick out least for
it, and every centre moves to where its own pieces need least. Upper levels: `sphere_tree`.
"""

from __future__ import annotations

import math

import numpy as np

from armguard.cover.miniball import enclose_points
from armguard.cover.patches import (
    bisect_pieces,
    compute_corners,
    compute_hull_points,
    measure_sides,
)
from armguard.cover.signed_distance import (
    Surface,
    arrange_surface,
    compute_signed_distances,
    is_inside,
    measure_distance,
)
from armguard.cover.sphere_tree import GRID, Node, SphereTree, build_tree, enclose
from armguard.jit.arrays import FloatArray
from armguard.jit.kernels import kernel

_PIECES = 2500  # about as many pieces a link: finer ones fit tighter, and cost in proportion
_ROUND_PIECES = 600  # these are smooth, and cost six times as much each
_FINE_PIECES = 8000  # where spheres are to be few; no finer than
_FINENESS = 0.25  # this share of the protrusion
_MOST = 4  # times as many there may be where triangles are slender: each would be dozens
_CANDIDATES = 1500  # about as many candidate centres a link
_SKIP = 4  # one piece in so many is enough to find where to start from
_SWAPS = 8  # tries to save a smaller set by moving one centre far away
_ROUNDS = 30  # of moving pieces and centres in turns


def fit_tree(
    surface: FloatArray, *, spheres: int | None = None, protrusion: float | None = None
) -> SphereTree:
    """Fit a tree of balls to a surface; the same input gives the same tree.

    Args:
        surface: Pieces as `patches` has them, in [m], finite; n > 0.
        spheres: At most so many leaves, which then stick out as little as possible, or
        protrusion: how far a leaf may stick out, in [m], with as few leaves as possible.
    """
    arranged = arrange_surface(compute_corners(surface))
    if spheres is not None:
        count = _PIECES if surface.shape[2] == 3 else _ROUND_PIECES
        pieces = compute_hull_points(cut_pieces(surface, count, most=_MOST * count))
        centers = _fit_count(pieces, arranged, spheres)
    else:
        limit = float(protrusion or 0.0)
        shortest, most = _FINENESS * limit, _MOST * _FINE_PIECES
        few, fine = (
            cut_pieces(surface, _FINE_PIECES, shortest, at_most) for at_most in (most, math.inf)
        )
        pieces = compute_hull_points(few)
        centers = _fit_protrusion(pieces, arranged, limit)
        if len(few) < len(fine) and not _measure_reach(pieces, arranged, centers) <= limit:
            pieces = compute_hull_points(fine)
            centers = _fit_protrusion(pieces, arranged, limit)
    return build_tree(_assign_pieces(pieces, arranged, centers))


def cut_pieces(
    pieces: FloatArray,
    count: int = _PIECES,
    shortest: float = 0.0,
    most: float = _MOST * _PIECES,
) -> FloatArray:
    """Bisect pieces until all edges are short.

    Args:
        pieces: As `patches` has them, in [m].
        count: About as many pieces would have edges of a common length, but
        shortest: edges no longer than this need not be cut, in [m], and
        most: edges are longer where there would be more pieces than this. There may be as many to
            begin with.

    Returns:
        Pieces of the same kind.
    """
    triangles = compute_corners(pieces)
    sides = triangles[:, 1:] - triangles[:, :1]
    area = 0.5 * np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1).sum()
    extent = np.ptp(triangles.reshape(-1, 3), axis=0).max()
    longest = max(2.0 * math.sqrt(area / count), extent / 200.0, shortest)
    most = max(most, len(pieces))
    while (cut := _cut_edges(pieces, longest, most)) is None:
        longest *= 1.1
    return cut


def _cut_edges(pieces: FloatArray, longest: float, most: float) -> FloatArray | None:
    """Bisect pieces until no edge is longer; None where that makes too many."""
    done, count = [], 0
    while len(pieces):
        is_short = measure_sides(pieces) <= longest**2
        done.append(pieces[is_short])
        pieces = bisect_pieces(pieces[~is_short])
        count += len(done[-1])
        if count + len(pieces) > most:
            return None
    return np.concatenate(done)


def _fit_count(pieces: FloatArray, surface: Surface, count: int) -> FloatArray:
    """At most `count` centres, around which balls stick out as little as possible."""
    candidates = _find_candidates(pieces, surface)
    coarse = _compute_needed(np.ascontiguousarray(pieces[::_SKIP]), surface, candidates)
    starts = [candidates[_cover_with(coarse, count)], _spread(pieces, count)]
    improved = [_improve(pieces, surface, start) for start in starts]
    return min(improved, key=lambda end: end[1])[0]


def _fit_protrusion(pieces: FloatArray, surface: Surface, limit: float) -> FloatArray:
    """As few centres as will do for balls that stick out by `limit`."""
    candidates = _find_candidates(pieces, surface)
    needed = _compute_needed(pieces, surface, candidates)
    # Where the grid is too coarse for the limit (open shells), a looser one will have to do.
    chosen = _cover(needed, max(limit, float(needed.min(axis=0).max())))
    centers, _ = _improve(pieces, surface, candidates[chosen])
    coarse = np.ascontiguousarray(needed[:, ::_SKIP])
    too_few = 0
    while len(centers) - too_few > 1:
        count = (too_few + len(centers)) // 2
        for start in (candidates[_cover_with(coarse, count)], _spread(pieces, count)):
            fewer, reached = _improve(pieces, surface, start)
            if reached <= limit:
                centers = fewer
                break
        else:
            too_few = count
    while len(centers) > 1:
        fewer, reached = _improve(pieces, surface, _drop_one(pieces, surface, centers))
        for _ in range(_SWAPS):
            if reached <= limit or len(fewer) < 2:
                break
            swapped = _move_one(pieces, surface, fewer, candidates, needed)
            moved, then = _improve(pieces, surface, swapped)
            if not then < reached:
                break
            fewer, reached = moved, then
        if not reached <= limit:
            break
        centers = fewer
    return centers


def _spread(pieces: FloatArray, count: int) -> FloatArray:
    """Middles of pieces that are far from one another: each the farthest from those before."""
    middles = pieces.mean(axis=1)
    chosen = [int(np.argmax(((middles - middles.mean(axis=0)) ** 2).sum(axis=1)))]
    squared = np.full(len(middles), math.inf)
    while len(chosen) < min(count, len(middles)):
        squared = np.minimum(squared, ((middles - middles[chosen[-1]]) ** 2).sum(axis=1))
        chosen.append(int(np.argmax(squared)))
    spread: FloatArray = middles[chosen]
    return spread


def _find_candidates(pieces: FloatArray, surface: Surface) -> FloatArray:
    """Candidate centres: a grid within, places on the surface, and a middle. Shape (c, 3)."""
    corners = pieces.reshape(-1, 3)
    lower, extent = corners.min(axis=0), np.ptp(corners, axis=0)
    step = max((float(np.prod(extent)) / _CANDIDATES) ** (1 / 3), float(extent.max()) / 40.0, GRID)
    axes = [lower[i] + step * np.arange(int(extent[i] / step) + 1) for i in range(3)]
    axes = [axis + 0.5 * (lower[i] + extent[i] - axis[-1]) for i, axis in enumerate(axes)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    near = compute_signed_distances(grid, surface) < 0.5 * step
    on_surface = pieces[:: max(1, 4 * len(pieces) // _CANDIDATES)].mean(axis=1)
    center, _ = enclose_points(corners)
    candidates: FloatArray = np.concatenate([grid[near], on_surface, center[None]])
    return candidates


def _compute_needed(pieces: FloatArray, surface: Surface, centers: FloatArray) -> FloatArray:
    """How far balls at `centers` must stick out to reach each piece, in [m]. Shape (c, m)."""
    needed = np.empty((len(centers), len(pieces)))
    _farthest_corners(centers, pieces, needed)
    needed += compute_signed_distances(centers, surface)[:, None]
    return needed


def _measure_reach(pieces: FloatArray, surface: Surface, centers: FloatArray) -> float:
    """How far balls at `centers` must stick out to reach all pieces together, in [m]."""
    return float(_compute_needed(pieces, surface, centers).min(axis=0).max())


def _cover(needed: FloatArray, limit: float) -> list[int]:
    """Greedy set cover: rows that together reach every column within the limit."""
    within = needed <= limit
    gains, is_open = within.sum(axis=1), np.ones(needed.shape[1], dtype=np.bool_)
    chosen: list[int] = []
    # Invariant: a row's gain is the number of columns within its limit that no chosen row reaches.
    while gains.any():
        chosen.append(int(np.argmax(gains)))
        taken = is_open & within[chosen[-1]]
        is_open &= ~taken
        gains -= within[:, taken].sum(axis=1)
    return chosen


def _cover_with(needed: FloatArray, count: int) -> list[int]:
    """The greedy cover of at most `count` rows with the least limit that bisection finds."""
    low, high = float(needed.min(axis=0).max()), float(needed.max(axis=1).min())
    chosen = [int(np.argmin(needed.max(axis=1)))]
    for _ in range(12):
        middle = 0.5 * (low + high)
        attempt = _cover(needed, middle)
        if len(attempt) <= count:
            chosen, high = attempt, middle
        else:
            low = middle
    return chosen


def _drop_one(pieces: FloatArray, surface: Surface, centers: FloatArray) -> FloatArray:
    """Leave out the centre whose pieces the others reach most easily."""
    needed = _compute_needed(pieces, surface, centers)
    owners, second = np.argmin(needed, axis=0), np.partition(needed, 1, axis=0)[1]
    least = needed.min(axis=0).max()
    without = [second[owners == i].max(initial=least) for i in range(len(centers))]
    return np.delete(centers, int(np.argmin(without)), axis=0)


def _move_one(
    pieces: FloatArray,
    surface: Surface,
    centers: FloatArray,
    candidates: FloatArray,
    needed: FloatArray,
) -> FloatArray:
    """Leave out the centre that is missed least, and put one where it is needed most."""
    worst = int(np.argmax(_compute_needed(pieces, surface, centers).min(axis=0)))
    added = candidates[int(np.argmin(needed[:, worst]))]
    return np.concatenate([_drop_one(pieces, surface, centers), added[None]])


def _improve(pieces: FloatArray, surface: Surface, centers: FloatArray) -> tuple[FloatArray, float]:
    """Move pieces and centres in turns; return the centres and how far the balls stick out."""
    best, best_reached = centers, math.inf
    for _ in range(_ROUNDS):
        needed = _compute_needed(pieces, surface, centers)
        owners = np.argmin(needed, axis=0)
        reached = float(needed.min(axis=0).max())
        if not (reached < best_reached - 1e-5):
            break
        best, best_reached = centers, reached
        used = np.unique(owners)
        centers = centers[used].copy()
        for i, owner in enumerate(used):
            corners = np.unique(pieces[owners == owner].reshape(-1, 3), axis=0)
            _move_center(centers[i], corners, surface)
    return best, best_reached


def _assign_pieces(pieces: FloatArray, surface: Surface, centers: FloatArray) -> list[Node]:
    """Give each piece to a ball, so that no ball is larger than its own pieces make it."""
    needed = _compute_needed(pieces, surface, centers)
    distances = np.empty_like(needed)
    _farthest_corners(centers, pieces, distances)
    owners = np.argmin(needed, axis=0)
    radii = np.array([distances[i, owners == i].max(initial=-1.0) for i in range(len(centers))])
    for i in np.argsort(-radii, kind="stable"):
        inside = distances <= radii[:, None]
        inside[i] = False
        given = (owners == i) & inside.any(axis=0)
        owners[given] = np.argmin(np.where(inside, needed, math.inf)[:, given], axis=0)
        radii[i] = distances[i, owners == i].max(initial=-1.0)
    return [
        Node(enclose(centers[i], corners), corners, [])
        for i in np.unique(owners)
        for corners in [np.unique(pieces[owners == i].reshape(-1, 3), axis=0)]
    ]


@kernel
def _farthest_corners(centers, pieces, distances):
    for i in range(len(centers)):
        for j in range(len(pieces)):
            distances[i, j] = _reach(centers[i], pieces[j])


@kernel
def _reach(center, corners):
    farthest = 0.0
    for i in range(len(corners)):
        x, y, z = corners[i, 0] - center[0], corners[i, 1] - center[1], corners[i, 2] - center[2]
        farthest = max(farthest, x * x + y * y + z * z)
    return math.sqrt(farthest)


@kernel
def _move_center(center, corners, surface):
    """Pattern search for the centre from which a ball around the corners sticks out least."""
    extent = 0.0
    for k in range(3):
        extent = max(extent, corners[:, k].max() - corners[:, k].min())
    step = 0.1 * extent
    distance = measure_distance(center[0], center[1], center[2], surface)
    inside = is_inside(center[0], center[1], center[2], surface)
    best = _reach(center, corners) + (-distance if inside else distance)
    # Invariant: `best` is how far the ball sticks out at `center`; it never grows.
    while step > 2e-3 * extent:
        moved = False
        for direction in range(6):
            sign = step if direction < 3 else -step
            center[direction % 3] += sign
            there = measure_distance(center[0], center[1], center[2], surface)
            # A point that moves less than its distance to the surface stays on its side.
            inside_there = inside
            if not step < distance:
                inside_there = is_inside(center[0], center[1], center[2], surface)
            value = _reach(center, corners) + (-there if inside_there else there)
            # Keep a better place, else go back; halve the step where no direction is better.
            if value < best:
                best, distance, inside, moved = value, there, inside_there, True
            else:
                center[direction % 3] -= sign
        if not moved:
            step *= 0.5
