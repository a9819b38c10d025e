"""What there is to see of a tick: copied out for observers, who draw and record beside the loop.

An observer must not slow a tick, so everything here is a handful of array operations, and closest
points are those of spheres and hulls as the monitor saw them, not of meshes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from armguard.ledger import PairLedger
from armguard.pairs import FloatArray, IntArray, TickState


class Snapshot(NamedTuple):
    """One tick, seen from outside; arrays are the observer's own."""

    q: FloatArray
    """Joint positions, [rad] or [m]. Shape (nv,)."""
    sphere_times: FloatArray
    """Soonest contact of each finest sphere, in [s]; spheres in the order of the links' finest
    levels. Shape (s,)."""
    rows: IntArray
    """Obstacle rows, the most imminent first. Shape (o,)."""
    row_times: FloatArray
    """Soonest contact of each of these rows, in [s]. Shape (o,)."""
    pairs: IntArray
    """Pair numbers, the most imminent first. Shape (m,)."""
    pair_times: FloatArray
    """Contact time of each of these pairs, in [s]. Shape (m,)."""
    segments: FloatArray
    """Centre of the deciding sphere, and the obstacle's nearest point, in [m]. Shape (m, 2, 3)."""


def take_snapshot(
    ledger: PairLedger,
    state: TickState,
    q: FloatArray,
    time: float,
    tick: int,
    *,
    pair_limit: int,
    row_limit: int,
) -> Snapshot:
    """Copy out what is most imminent.

    Args:
        ledger: Certificates of all pairs.
        state: Numbers of the tick.
        q: Joint positions, [rad] or [m]. Shape (nv,).
        time: Of the tick, in [s] since the ledger's epoch.
        tick: Its number.
        pair_limit: At most so many pairs.
        row_limit: At most so many obstacles.
    """
    times = np.maximum(ledger.expiry[ledger.pairs] - time, 0.0)
    order = _soonest(times, pair_limit)
    pairs = ledger.pairs[order]
    rows, row_times = _row_times(ledger, times)
    order_of_rows = _soonest(row_times, row_limit)
    return Snapshot(
        q=q.copy(),
        sphere_times=_sphere_times(ledger, state, times, tick),
        rows=rows[order_of_rows],
        row_times=row_times[order_of_rows],
        pairs=pairs,
        pair_times=times[order],
        segments=_segments(ledger, state, pairs),
    )


def _soonest(times: FloatArray, limit: int) -> IntArray:
    """Indices of the smallest `limit` times, ascending. Shape (min(limit, n),)."""
    if limit < len(times):
        chosen = np.argpartition(times, limit)[:limit]
        return chosen[np.argsort(times[chosen], kind="stable")]
    return np.argsort(times, kind="stable")


def _row_times(ledger: PairLedger, times: FloatArray) -> tuple[IntArray, FloatArray]:
    """Rows that have pairs, and the soonest time of each. Pairs are ascending, so rows are too."""
    if not len(times):
        return np.zeros(0, dtype=np.int64), np.zeros(0)
    rows = ledger.pairs // ledger.link_count
    starts = np.flatnonzero(np.diff(rows, prepend=-1))
    return rows[starts], np.minimum.reduceat(times, starts)


def _sphere_times(ledger: PairLedger, state: TickState, times: FloatArray, tick: int) -> FloatArray:
    """Soonest contact of each finest sphere; what was not looked at has its link's time."""
    tree = state.tree
    seen = state.sphere_time.copy()
    # Parents stand before their children: a sphere that was not opened shares its parent's time.
    for node in np.flatnonzero((tree.parent >= 0) & np.isinf(seen)):
        seen[node] = seen[tree.parent[node]]
    waiting = ledger.tick[ledger.pairs] != tick
    if waiting.any():
        link_times = np.full(ledger.link_count, np.inf)
        np.minimum.at(link_times, ledger.pairs[waiting] % ledger.link_count, times[waiting])
        seen = np.minimum(seen, link_times[state.link_of])
    return seen[tree.first_child < 0]


def _segments(ledger: PairLedger, state: TickState, pairs: IntArray) -> FloatArray:
    """From the deciding sphere's centre to the nearest point of the obstacle's axis or corners."""
    rows = pairs // ledger.link_count
    centers = state.arm.centers[ledger.sphere[pairs]]
    points = state.bodies.points[rows]
    last = state.bodies.point_count[rows] - 1
    distances = np.linalg.norm(points - centers[:, None, :], axis=2)
    distances[np.arange(points.shape[1]) > last[:, None]] = np.inf
    index = np.arange(len(pairs))
    nearest = points[index, np.argmin(distances, axis=1)]
    start, along = points[:, 0], points[index, last] - points[:, 0]
    length2 = np.einsum("ij,ij->i", along, along)
    share = np.einsum("ij,ij->i", centers - start, along) / np.where(length2 > 0.0, length2, 1.0)
    on_axis = start + np.clip(share, 0.0, 1.0)[:, None] * along
    return np.stack([centers, np.where((last == 1)[:, None], on_axis, nearest)], axis=1)
