"""What can be told about single pairs of link and obstacle, for people who ask.

Never part of a tick: closest points cost a distance each.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from armguard.pairs.evaluate import TickState
from armguard.pairs.hull_distance import ExactGeometry
from armguard.pairs.scene import BOUND_NAMES
from armguard.scheduling.scheduler import Listing

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
    """Since the pair was last evaluated, in [s]; inf before the first time."""
    bound: str
    """What decided: "reach", "isotropic", "joint" or "distance"; "unknown": nothing could."""
    point_on_link: NDArray[np.float64]
    """Closest point of the link, [m], world; NaN where the obstacle is nowhere. Shape (3,)."""
    point_on_obstacle: NDArray[np.float64]
    """Closest point of the obstacle as last measured, alike. Shape (3,)."""


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
    exact: ExactGeometry,
) -> PairReport:
    """Tell what is known about a pair.

    Args:
        listing: Of imminent pairs.
        index: Which of them.
        time: Of the last tick, in [s] since the monitor's epoch.
        period: Of ticks, in [s].
        names: Of link and obstacle.
        state: The last tick's numbers.
        exact: Measures the links where they are.
    """
    row, link = divmod(int(listing.pairs[index]), len(state.tree.root))
    bodies = state.bodies if state.marks.has_state[row] else state.refused_bodies
    points = bodies.points[row, : int(bodies.point_count[row])]
    radius = float(bodies.radius[row])
    on_link = on_obstacle = np.full(3, np.nan)
    if np.isfinite(points).all() and 0.0 <= radius < math.inf:
        _, on_link, on_obstacle = exact.distance(link, points, radius)
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
