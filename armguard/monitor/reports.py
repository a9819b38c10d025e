"""Reports about a tick: single pairs for users, and whole snapshots for observers."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from armguard.jit.arrays import FloatArray, IntArray
from armguard.obstacles.possible_states import list_states
from armguard.pairs.evaluate import TickState
from armguard.pairs.scene import BOUND_NAMES
from armguard.scheduling.scheduler import Listing

if TYPE_CHECKING:
    from armguard.pairs.hull_distance import HullDistance

BUCKETS = 16
"""Grades of imminence: bucket k holds contact times of 2^k to 2^(k+1) periods."""


class PairReport(NamedTuple):
    """One pair as `Monitor.pairs` shows it."""

    link: str
    obstacle: str
    contact_time: float
    """[s] from the last tick."""
    bucket: int
    """Imminence, 0 (next tick) to 15 (far)."""
    age: float
    """Time since the last evaluation of the pair, in [s]; inf before the first one."""
    bound: str
    """The bound that decided: "reach", "isotropic" or "joint"; "unknown": the position is
    unknown."""
    point_on_link: NDArray[np.float64]
    """Closest point of the link in the world, in [m]; NaN if the obstacle's position is unknown.
    Shape (3,)."""
    point_on_obstacle: NDArray[np.float64]
    """Closest point of the obstacle in its last measured state, or in a refused sample if that is
    nearer, in [m]; NaN if unknown. Shape (3,)."""


def bucket_of(contact_time: float, period: float) -> int:
    """Imminence of a contact time: floor(log2(contact_time / period)), clipped to 0 … 15."""
    if not contact_time > period:
        return 0
    if not contact_time < math.ldexp(period, BUCKETS):
        return BUCKETS - 1
    return min(int(math.log2(contact_time / period)), BUCKETS - 1)


def report_pair(
    listing: Listing,
    index: int,
    time: float,
    period: float,
    names: tuple[str, str],
    state: TickState,
    exact: HullDistance,
) -> PairReport:
    """Make the report about a pair.

    Args:
        listing: Of imminent pairs.
        index: Index of the pair in the listing.
        time: Of the last tick, in [s] since the monitor's epoch.
        period: Of ticks, in [s].
        names: Names of link and obstacle.
        state: The last tick's numbers.
        exact: Measures distances to the links' geometry.
    """
    row, link = divmod(int(listing.pairs[index]), len(state.tree.root))
    on_link = on_obstacle = np.full(3, np.nan)
    nearest = math.inf
    for bodies, place, _ in list_states(
        state.bodies, state.refused_bodies, state.marks, row, state.now
    ):
        points = bodies.points[place, : int(bodies.point_count[place])]
        distance, *closest = exact.distance(link, points, float(bodies.radius[place]))
        if distance < nearest:
            nearest = distance
            on_link, on_obstacle = closest
    contact_time = max(0.0, float(listing.expiry[index]) - time)
    return PairReport(
        link=names[0],
        obstacle=names[1],
        contact_time=contact_time,
        bucket=bucket_of(contact_time, period),
        age=time - float(listing.evaluated_at[index]),
        bound=BOUND_NAMES[listing.bound[index]],
        point_on_link=on_link,
        point_on_obstacle=on_obstacle,
    )


class Snapshot(NamedTuple):
    """Data of one tick for observers; its arrays are copies."""

    q: FloatArray
    """Joint positions, [rad] or [m]. Shape (nv,)."""
    sphere_times: FloatArray
    """Least contact time of each finest sphere, in [s], in the order of the links' finest levels.
    Shape (s,)."""
    rows: IntArray
    """Obstacle rows, the most imminent first. Shape (o,)."""
    row_times: FloatArray
    """Least contact time of each of these rows, in [s]. Shape (o,)."""
    pairs: IntArray
    """Pair numbers, the most imminent first. Shape (m,)."""
    pair_times: FloatArray
    """Contact time of each of these pairs, in [s]. Shape (m,)."""
    pair_bounds: IntArray
    """The bound of each of these times, an index of `pairs.scene.BOUND_NAMES`. Shape (m,)."""
    all_times: FloatArray
    """Contact time of every pair of these obstacles, in [s], unordered. Shape (n,)."""


def take_snapshot(listing: Listing, q: FloatArray, time: float) -> Snapshot:
    """Copy the most imminent pairs and obstacles.

    Args:
        listing: What that is.
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
        pair_bounds=listing.bound,
        all_times=np.maximum(listing.all_expiry - time, 0.0),
    )
