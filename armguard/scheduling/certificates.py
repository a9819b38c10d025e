"""What is known of every obstacle: until when, by what, and when it must be looked at again."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from armguard.jit.arrays import FloatArray, IntArray
from armguard.jit.kernels import kernel
from armguard.jit.layout import make_records
from armguard.obstacles.table import ChangedRows, States, extend_rows, make_states
from armguard.pairs.scene import UNKNOWN
from armguard.scheduling.timing_wheel import Wheel, grow_wheel, make_due, make_wheel, take_out
from armguard.scheduling.tournament import find_least, grow_tournament, make_tournament, set_value

UNSEEN, UNPLACED = -3, -2
"""In place of a row, where nothing was looked at yet, or the arm must be placed first."""

ACTIVE, PREPARED, STALE, LOOKS, SPENT, BROKEN = range(6)
"""Places in `Book.numbers`."""


class Book(NamedTuple):
    """What is known of each row of the obstacle table, and what it rests on."""

    wheel: Wheel
    soonest: FloatArray
    """Tournament of the ends of their certificates, in [s] since the monitor's epoch."""
    reference_states: States
    """The table's: the states that certificates rest on; no points where there was none."""
    news: ChangedRows
    watched: NDArray[np.bool_]
    """Which links are watched against it. Shape (rows, links)."""
    evaluated_at: FloatArray
    """Time of the last look, in [s] since the epoch. Shape (rows,)."""
    pair_expiry: FloatArray
    """End of each pair's certificate, alike: at least this. Shape (rows, links)."""
    pair_sphere: NDArray[np.int32]
    """Sphere that decided each pair. Shape (rows, links)."""
    pair_bound: NDArray[np.int8]
    """What that rests on, an index of `BOUND_NAMES`. Shape (rows, links)."""
    broken: IntArray
    """Rows whose news broke the bounds behind their certificates. Shape (rows,)."""
    numbers: IntArray
    """Rows that are watched, the tick that the arm was last prepared for, how many looks came later
    than max_staleness asked for, and of late, looks at rows and evaluations spent on them; and
    how many of `broken` are in use. Shape (6,)."""


def make_book(links: int) -> Book:
    """A book without rows, for an arm of so many links."""
    return Book(
        wheel=make_wheel(0),
        soonest=make_tournament(1),
        reference_states=make_states(0),
        news=ChangedRows(
            np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.bool_), np.zeros(1, dtype=np.int64)
        ),
        **_make_rows(0, links),
        broken=np.zeros(0, dtype=np.int64),
        numbers=np.array([0, -1, 0, 0, 0, 0]),
    )


def _make_rows(rows: int, links: int) -> dict[str, NDArray[Any]]:
    """The fields of a book that are read together, without anything in them."""
    fields: dict[str, tuple[type, tuple[int, ...]]] = {
        "evaluated_at": (float, ()),
        "pair_expiry": (float, (links,)),
        "pair_sphere": (np.int32, (links,)),
        "pair_bound": (np.int8, (links,)),
        "watched": (np.bool_, (links,)),
    }
    return dict(zip(fields, make_records(rows, **fields), strict=True))


def grow_book(book: Book, news: ChangedRows, reference_states: States) -> Book:
    """The same book for an obstacle table whose arrays are these, and may have more rows."""
    rows = len(reference_states.stamp)
    leaves = len(book.soonest) // 2
    grown = _make_rows(rows, book.watched.shape[1])
    for name, array in grown.items():
        before = getattr(book, name)
        array[: len(before)] = before
    return book._replace(
        wheel=grow_wheel(book.wheel, rows),
        soonest=grow_tournament(book.soonest, max(leaves, 1 << (rows - 1).bit_length())),
        reference_states=reference_states,
        news=news,
        **grown,
        broken=extend_rows(book.broken, rows),
    )


@kernel
def void(book: Book, row: int) -> None:
    """Let no certificate of a row hold: it is to be looked at at once."""
    for link in range(book.watched.shape[1]):
        book.pair_expiry[row, link] = -np.inf
    make_due(book.wheel, row, -np.inf)
    set_value(book.soonest, row, -np.inf)


@kernel
def admit(handle: Any, rows: IntArray, masks: NDArray[np.bool_]) -> None:
    """Take in rows, to be looked at in the next tick; masks, (n, links), say which links watch."""
    book = handle.content
    for i in range(rows.shape[0]):
        row = rows[i]
        some = False
        for link in range(masks.shape[1]):
            book.watched[row, link] = masks[i, link]
            book.pair_bound[row, link] = UNKNOWN
            some = some or masks[i, link]
        book.reference_states.point_count[row] = 0
        book.evaluated_at[row] = -np.inf
        if some:
            book.numbers[ACTIVE] += 1
            void(book, row)


@kernel
def dismiss(handle: Any, rows: IntArray) -> None:
    """Let go of rows."""
    book = handle.content
    for row in rows:
        if book.watched[row].any():
            book.numbers[ACTIVE] -= 1
        book.watched[row] = False
        take_out(book.wheel, row)
        set_value(book.soonest, row, np.inf)


@kernel
def doubt_all(handle: Any) -> None:
    """Let no certificate hold: everything is to be looked at."""
    book = handle.content
    for row in range(book.watched.shape[0]):
        if book.watched[row].any():
            void(book, row)


@kernel
def first_link(watched: NDArray[np.bool_], pair_expiry: FloatArray, row: int) -> int:
    """The watched link whose certificate against an obstacle ends first; both (rows, links)."""
    first = -1
    for link in range(watched.shape[1]):
        if not watched[row, link]:
            continue
        if first < 0 or pair_expiry[row, link] < pair_expiry[row, first]:
            first = link
    return first


@kernel
def find_soonest(book_handle: Any, rows: IntArray) -> int:
    """Fill `rows` with those whose certificates end first, soonest first; how many there are."""
    book = book_handle.content
    wanted = min(rows.shape[0], book.numbers[ACTIVE])
    values = np.empty(wanted)
    count = 0
    while count < wanted and book.soonest[1] < np.inf:
        # Each is taken out of the tournament until all are found.
        values[count] = book.soonest[1]
        rows[count] = find_least(book.soonest)
        set_value(book.soonest, rows[count], np.inf)
        count += 1
    for i in range(count):
        set_value(book.soonest, rows[i], values[i])
    half = book.soonest.shape[0] // 2
    for row in range(book.watched.shape[0]):
        if count == wanted:
            break
        if book.soonest[half + row] == np.inf and book.watched[row].any():
            rows[count] = row
            count += 1
    return count
