"""The least of very many values of which a few change: a tournament, kept up to date.

Each value plays against its neighbour, the winners against each other, up to the root. A change
replays one way up, and no farther than it matters; who won is found one way down.
"""

from __future__ import annotations

import numpy as np

from armguard.jit.arrays import FloatArray, IntArray
from armguard.jit.kernels import kernel


def make_tournament(capacity: int) -> FloatArray:
    """A tournament of values that are all inf, for entries 0 to `capacity`, a power of two.

    Returns:
        The root at 1, those who play for place k at 2 k and 2 k + 1, entries at the end. Shape
        (2 capacity,).
    """
    return np.full(2 * capacity, np.inf)


def grow_tournament(tournament: FloatArray, capacity: int) -> FloatArray:
    """The same entries with room for more."""
    grown = make_tournament(capacity)
    values = tournament[len(tournament) // 2 :]
    grown[capacity : capacity + len(values)] = values
    level = grown[capacity:]
    while len(level) > 1:
        level = level.reshape(-1, 2).min(axis=1)
        grown[len(level) : 2 * len(level)] = level
    return grown


@kernel
def set_value(tournament: FloatArray, entry: int, value: float) -> None:
    """Give an entry another value; NaN counts as the least there is."""
    if not value > -np.inf:
        value = -np.inf
    place = tournament.shape[0] // 2 + entry
    while place > 0:
        if tournament[place] == value:
            return
        tournament[place] = value
        value = min(value, tournament[place ^ 1]) if place > 1 else value
        place //= 2


@kernel
def find_least(tournament: FloatArray) -> int:
    """The first entry with the least value."""
    half = tournament.shape[0] // 2
    place = 1
    while place < half:
        place *= 2
        if tournament[place + 1] < tournament[place]:
            place += 1
    return place - half


@kernel
def find_below(tournament: FloatArray, value: float, entries: IntArray) -> int:
    """Fill `entries` with those whose value is `value` or less, in their order, as far as they fit.

    Returns:
        How many were found; more than fit end the search.
    """
    half = tournament.shape[0] // 2
    count = 0
    place = 1
    while place > 0:
        if tournament[place] <= value:
            if place < half:
                place *= 2
                continue
            if count == entries.shape[0]:
                return count
            entries[count] = place - half
            count += 1
        # On to the right: up as long as this was the right one of two.
        while place % 2 == 1:
            place //= 2
        if place > 0:
            place += 1
    return count
