"""Predictions for people: how much more a monitor could watch, and what to measure next.

Never part of a tick.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from armguard.monitor.what_if import Change, WhatIf
from armguard.pairs.evaluate import TickState
from armguard.scheduling.scheduler import Listing, Tick


class Headroom(NamedTuple):
    """Load of a monitor, and how much more it could watch within its budget.

    The prediction assumes more obstacles with the present distribution of contact times. Beyond it,
    answers get older than the settings allow, so contact times get shorter than necessary. If a
    certificate expires before its evaluation, the stop decision is made about its pair. If the
    budget does not suffice for that, the verdict is a STOP: see `ReasonKind.OVERDUE`.
    """

    obstacles: int
    """Watched now."""
    evaluations: float
    """Expected evaluations in a tick at present."""
    budget: float
    """Permitted evaluations in a tick; inf without a limit."""
    most_obstacles: float
    """Number of obstacles at which the budget is exceeded; inf without a limit."""
    slowest_rate: float
    """Rate of ticks below which the budget is exceeded, in [Hz]; 0 without a limit."""


def predict_headroom(
    obstacles: int, evaluations: float, period: float, budget: int | None
) -> Headroom:
    """Compute the headroom from the expected load.

    Args:
        obstacles: Watched now.
        evaluations: Expected in a tick.
        period: Of ticks, in [s].
        budget: Evaluations allowed in a tick; None: no limit.
    """
    if budget is None:
        return Headroom(obstacles, evaluations, math.inf, math.inf, 0.0)
    most = obstacles * budget / evaluations if evaluations > 0.0 else math.inf
    return Headroom(obstacles, evaluations, budget, most, evaluations / period / budget)


class Attention(NamedTuple):
    """An obstacle that a sensor should measure next."""

    obstacle: str
    contact_time: float
    """Its least contact time, in [s]."""
    age: float
    """Age of its last state, in [s]."""
    gain: float
    """How much longer the verdict's contact time would be with fresh states of this obstacle and of
    those listed before it, in [s]. A fresh state is predicted with the obstacle's velocity."""


def rank_attention(
    listing: Listing,
    state: TickState,
    watched: NDArray[np.bool_],
    tick: Tick,
    ids: list[str],
    limit: int,
) -> list[Attention]:
    """Rank obstacles by how much their fresh states would raise the verdict's contact time.

    The obstacle with the least contact time alone limits the verdict's contact time. With a fresh
    state of it, the next obstacle limits it, and so on: this gives the order.

    Args:
        listing: Listing of imminent obstacles; one more than `limit`, to compute the last gain.
        state: The last tick's numbers, with the arm prepared.
        watched: Which pairs are watched, by row × links + link. Shape (n,).
        tick: The last one.
        ids: Of the rows.
        limit: At most so many.
    """
    known = np.maximum(listing.row_expiry - tick.time, 0.0)
    rows, links = listing.rows.tolist(), len(state.tree.root)
    fresh = np.zeros(len(rows[:limit]))
    for index in range(len(fresh)):
        row = rows[index]
        times = WhatIf(state, row).contact_times(Change(fresh=True), tick.refinement_threshold)
        fresh[index] = times[watched[row * links : (row + 1) * links]].min(initial=math.inf)
    fresh = np.maximum(fresh, known[: len(fresh)])
    ranked = []
    seen = np.inf
    for index, row in enumerate(rows[:limit]):
        before = min(seen, float(known[index]))
        seen = min(seen, float(fresh[index]))
        beyond = float(known[index + 1]) if index + 1 < len(known) else math.inf
        age = 0.0 if state.marks.static[row] else state.now - float(state.bodies.stamp[row])
        gain = max(min(seen, beyond) - before, 0.0) if before < math.inf else 0.0
        ranked.append(Attention(ids[row], float(known[index]), age, gain))
    return ranked
