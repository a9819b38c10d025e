"""Looking ahead for people: how much more a monitor could watch, and where a fresh look would help.

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
    """What a monitor spends, and what it could still take on before its budget breaks.

    Predicted from how imminent all obstacles are now: as many times as many of them, spread alike.
    Beyond that, answers get staler than the settings allow, and so contact times shorter than
    they need be. Where a certificate ends before its turn comes, the stop decision is made about
    it, and where that has no budget left either, the verdict is a STOP: see `ReasonKind.OVERDUE`.
    """

    obstacles: int
    """Watched now."""
    evaluations: float
    """Expected in a tick as things are."""
    budget: float
    """Allowed in a tick; inf without a limit."""
    most_obstacles: float
    """At which the budget breaks; inf without a limit."""
    slowest_rate: float
    """Ticks a second below which it breaks, in [Hz]; 0 without a limit."""


def predict_headroom(
    obstacles: int, evaluations: float, period: float, budget: int | None
) -> Headroom:
    """Headroom from what is expected.

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
    """An obstacle that a sensor had better look at next."""

    obstacle: str
    contact_time: float
    """As the monitor knows it, in [s]."""
    age: float
    """Of its last state, in [s]."""
    gain: float
    """By how much later the verdict's contact time would be with a fresh state of this obstacle,
    where its velocity has carried it, and of those named before it, in [s]."""


def rank_attention(
    listing: Listing,
    state: TickState,
    watched: NDArray[np.bool_],
    tick: Tick,
    ids: list[str],
    limit: int,
) -> list[Attention]:
    """Obstacles whose fresh states would raise the verdict's contact time most, first things first.

    The soonest obstacle alone holds the verdict's time down. With it seen anew the next one does,
    and so on: the order is that in which they stand in each other's way.

    Args:
        listing: Of imminent obstacles; one more than `limit` tells what the last would gain.
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
