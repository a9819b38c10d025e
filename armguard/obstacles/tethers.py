"""Tethers: pairs of obstacles that are stated never to be farther apart than a length.

The possible region of a hidden elbow grows with its age. But its upper arm has a length, so the
elbow is near a visible shoulder. A tether of length L between bodies a and b states: no centre
point of either is ever farther than L from the hull of the other's centre points. That hull, grown
by L, is convex; so all of b lies within the hull of a's centre points, grown by L and by b's
radius. An arm that keeps out of this touches nothing of b, and b is judged by a's state where that
says more than its own.

The arrays here say which rows are tethered. Each row has `MOST_TETHERS` places, so that a tick
needs no memory. `partners` says which tether is of use when, `scheduling.tether_uses` when one is
broken.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from armguard.jit.arrays import BoolArray, FloatArray, IntArray

MOST_TETHERS = 6
"""Tethers of one obstacle."""

MOST_STATED = 1024
"""Tethers of a table."""

TIED, TORN = 0, 1
"""Places in `Tethers.numbers`."""


class Tether(NamedTuple):
    """A tether, as it was stated."""

    a: str
    """Id of one obstacle."""
    b: str
    """Id of the other one, reported by the same source."""
    length: float
    """No centre point of either is ever farther from the hull of the other's, in [m]."""
    source: str
    """Where the length comes from."""


class Tethers(NamedTuple):
    """Tethers between rows of the obstacle table, by number."""

    rows: IntArray
    """Both rows. Shape (tethers, 2)."""
    length: FloatArray
    """[m]. Shape (tethers,)."""
    is_broken: BoolArray
    """Whether states contradicted it lately, so that nothing is proved by it. Shape (tethers,)."""
    excess: FloatArray
    """By how much they were too far apart when they were last, in [m]. Shape (tethers,)."""
    agrees_since: FloatArray
    """Since when states agree with one that is broken, in [s]; inf: they do not. Shape (tethers,).
    """
    revision: IntArray
    """Revisions of both rows that were compared last. Shape (tethers, 2)."""
    of_row: IntArray
    """Numbers of each row's tethers. Shape (rows, MOST_TETHERS)."""
    row_count: IntArray
    """How many of these are in use. Shape (rows,)."""
    numbers: IntArray
    """How many tethers there are, and how many are broken. Shape (2,)."""


def make_tethers(rows: int, tethers: int) -> Tethers:
    """Room for so many tethers between so many rows; there is none as yet."""
    return Tethers(
        np.zeros((tethers, 2), dtype=np.int64),
        np.zeros(tethers),
        np.zeros(tethers, dtype=np.bool_),
        np.zeros(tethers),
        np.zeros(tethers),
        np.zeros((tethers, 2), dtype=np.int64),
        np.zeros((rows, MOST_TETHERS), dtype=np.int64),
        np.zeros(rows, dtype=np.int64),
        np.zeros(2, dtype=np.int64),
    )


def resize_tethers(tethers: Tethers, rows: int, room: int) -> Tethers:
    """The same tethers with room for more rows, or for more tethers."""
    resized = make_tethers(rows, room)
    for before, after in zip(tethers, resized, strict=True):
        after[: len(before)] = before
    return resized


class Tie(NamedTuple):
    """A tether between two rows."""

    a: int
    b: int
    length: float
    """[m]."""
    broken: tuple[float, float] | None
    """By how much they were too far apart, in [m], and since when they agree, in [s]; None: it is
    not broken."""


def tie(tethers: Tethers, ties: Iterable[Tie], revision: IntArray) -> None:
    """Fill in which rows are tethered now.

    Args:
        tethers: Written, with room for all of them.
        ties: What there is.
        revision: Of the rows. Shape (rows,).
    """
    count = int(tethers.numbers[TIED])
    compared = dict(
        zip(map(tuple, tethers.rows[:count].tolist()), tethers.revision.copy(), strict=False)
    )
    tethers.row_count[tethers.rows[:count].ravel()] = 0
    tethers.numbers[:] = 0
    for number, (a, b, length, broken) in enumerate(ties):
        tethers.rows[number] = a, b
        tethers.length[number] = length
        tethers.is_broken[number] = broken is not None
        tethers.excess[number], tethers.agrees_since[number] = broken or (0.0, math.inf)
        # What is new is compared in the next tick.
        tethers.revision[number] = compared.get((a, b), (revision[a] - 1, revision[b] - 1))
        for row in (a, b):
            tethers.of_row[row, tethers.row_count[row]] = number
            tethers.row_count[row] += 1
        tethers.numbers[TIED] += 1
        tethers.numbers[TORN] += broken is not None


def find_length(tethers: Tethers, row: int, partner: int) -> float:
    """Length of the tether between two rows, in [m]; inf where there is none."""
    for number in tethers.of_row[row, : tethers.row_count[row]]:
        if partner in tethers.rows[number]:
            return float(tethers.length[number])
    return math.inf
