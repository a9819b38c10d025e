"""What there is to see of a tick: copied out for observers, who draw and record beside the loop.

An observer must not slow a tick, so everything here is a handful of array operations, and closest
points are those of spheres and hulls as the monitor saw them, not of meshes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from armguard.pairs.evaluate import TickState
from armguard.pairs.scene import FloatArray, IntArray
from armguard.scheduling.scheduler import Listing


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


def take_snapshot(listing: Listing, state: TickState, q: FloatArray, time: float) -> Snapshot:
    """Copy out what is most imminent.

    Args:
        listing: What that is.
        state: Numbers of the tick, the arm's spheres placed for it.
        q: Joint positions, [rad] or [m]. Shape (nv,).
        time: Of the tick, in [s] since the monitor's epoch.
    """
    return Snapshot(
        q=q.copy(),
        sphere_times=np.maximum(listing.sphere_expiry - time, 0.0),
        rows=listing.rows,
        row_times=np.maximum(listing.row_expiry - time, 0.0),
        pairs=listing.pairs,
        pair_times=np.maximum(listing.expiry - time, 0.0),
        segments=_segments(listing, state),
    )


def _segments(listing: Listing, state: TickState) -> FloatArray:
    """From the deciding sphere's centre to the nearest point of the obstacle's axis or corners."""
    pairs = listing.pairs
    rows = pairs // len(state.tree.root)
    centers = state.arm.centers[listing.sphere]
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
