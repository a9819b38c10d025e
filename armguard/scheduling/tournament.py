"""A tournament tree: the least of many values of which few change.

Eight values play against each other, the winners of eight such rounds again, up to the root. A
change replays one way up, and no farther than it matters; who won is found one way down. Eight
values are one line of cache, so that a way is three lines for 512 values and six for 262,144.
"""

from __future__ import annotations

import numpy as np

from armguard.jit.arrays import FloatArray, IntArray
from armguard.jit.kernels import kernel
from armguard.jit.layout import make_records

WIDTH = 8
"""Values that play against each other."""

ROOT = WIDTH - 1
"""Place of the least of all. Those that play for place k begin at `WIDTH * (k - ROOT + 1)`, so that
they share a line of cache."""


def make_tournament(capacity: int) -> FloatArray:
    """A tournament of values that are all inf, for `capacity` entries or more.

    Returns:
        The root at `ROOT`, `entries_of` at the end. Shape (ROOT + (8 entries - 1) / 7,).
    """
    entries = places = 1
    while entries < capacity:
        entries *= WIDTH
        places += entries
    (tournament,) = make_records(ROOT + places, value=(float, ()))
    tournament[:] = np.inf
    return tournament


def entries_of(tournament: FloatArray) -> FloatArray:
    """The values of all entries: a view."""
    return tournament[len(tournament) // WIDTH + ROOT - 1 :]


def grow_tournament(tournament: FloatArray, capacity: int) -> FloatArray:
    """The same entries with room for `capacity` of them."""
    values = entries_of(tournament)
    grown = make_tournament(max(capacity, len(values)))
    if len(grown) == len(tournament):
        grown[:] = tournament
        return grown
    level = entries_of(grown)
    level[: len(values)] = values
    place = len(grown)
    while len(level) > 1:
        place -= len(level)
        level = level.reshape(-1, WIDTH).min(axis=1)
        grown[place - len(level) : place] = level
    return grown


@kernel
def parent_of(place: int) -> int:
    """What a place plays for; where the entries begin, for the place behind the last."""
    return place // WIDTH + ROOT - 1


@kernel
def first_child_of(place: int) -> int:
    """The first of those that play for a place."""
    return WIDTH * (place - ROOT + 1)


@kernel
def set_value(tournament: FloatArray, entry: int, value: float) -> None:
    """Give an entry another value; NaN counts as the least there is."""
    if not value > -np.inf:
        value = -np.inf
    place = parent_of(tournament.shape[0]) + entry
    while tournament[place] != value:
        tournament[place] = value
        if place == ROOT:
            return
        place = parent_of(place)
        first = first_child_of(place)
        for rival in range(first, first + WIDTH):
            value = min(value, tournament[rival])


@kernel
def find_least(tournament: FloatArray) -> int:
    """The first entry with the least value."""
    entries = parent_of(tournament.shape[0])
    place = ROOT
    while place < entries:
        place = first_child_of(place)
        while tournament[place] != tournament[ROOT]:
            place += 1
    return place - entries


@kernel
def find_below(tournament: FloatArray, value: float, entries: IntArray) -> int:
    """Fill `entries` with those whose value is `value` or less, in their order, as far as they fit.

    Returns:
        How many were found; more than fit end the search.
    """
    first = parent_of(tournament.shape[0])
    count = 0
    place = ROOT
    while True:
        if tournament[place] <= value:
            if place < first:
                place = first_child_of(place)
                continue
            if count == entries.shape[0]:
                return count
            entries[count] = place - first
            count += 1
        # On to the right: up as long as this was the last of eight, as the root is.
        while place % WIDTH == WIDTH - 1:
            if place == ROOT:
                return count
            place = parent_of(place)
        place += 1
