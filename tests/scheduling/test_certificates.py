"""Books against plain dictionaries: who is watched, until when, and who is due."""

import math

import numpy as np
import pytest

from armguard.jit import pack
from armguard.obstacles.table import ObstacleTable, make_states, resize_states
from armguard.pairs.scene import UNKNOWN
from armguard.scheduling.certificates import (
    ACTIVE,
    admit,
    dismiss,
    doubt_all,
    find_soonest,
    first_link,
    grow_book,
    make_book,
)
from armguard.scheduling.timing_wheel import DUE, TURNING, WAITING, most_urgent, put_off
from armguard.scheduling.tournament import find_least, set_value

LINKS = 3
NEWS = ObstacleTable().changed_rows


def new_book(rows=8):
    book = grow_book(make_book(LINKS), NEWS, make_states(rows))
    return book, pack(book)


def look(book, row, expiry):
    """What a look leaves behind: the end of each link's certificate, and when it is due again."""
    book.pair_expiry[row] = expiry
    watched = book.watched[row]
    set_value(
        book.soonest, row, float(np.min(book.pair_expiry[row], where=watched, initial=np.inf))
    )
    put_off(book.wheel, row, 100, 0.0)


def rows_of(*rows):
    return np.array(rows, dtype=np.int64)


def soonest_of(handle, limit):
    rows = np.full(limit, -1, dtype=np.int64)
    return rows[: find_soonest(handle, rows)].tolist()


def count(book):
    return book.wheel.numbers[WAITING] + book.wheel.numbers[TURNING]


def test_who_is_admitted_is_due_and_knows_nothing():
    book, handle = new_book()
    look(book, 2, [4.0, 5.0, 6.0])
    book.reference_states.point_count[2] = 1
    masks = np.array([[True, False, True], [False, False, False]])
    admit(handle, rows_of(2, 5), masks)
    assert book.watched[[2, 5]].tolist() == masks.tolist()
    assert (book.pair_expiry[2] == -math.inf).all()
    assert (book.pair_bound[2] == UNKNOWN).all()
    assert (book.evaluated_at[2], book.reference_states.point_count[2]) == (-math.inf, 0)
    assert (book.soonest[1], find_least(book.soonest)) == (-math.inf, 2)
    assert (book.wheel.slot[2], most_urgent(book.wheel)) == (DUE, 2)
    # Nobody watches the other one, so it is in nobody's way.
    assert (book.numbers[ACTIVE], count(book)) == (1, 1)


def test_who_is_dismissed_is_gone():
    book, handle = new_book()
    admit(handle, rows_of(1, 3, 4), np.array([[True] * 3, [True] * 3, [False] * 3]))
    look(book, 3, [1.0, 2.0, 3.0])
    dismiss(handle, rows_of(3))
    assert soonest_of(handle, 9) == [1]
    assert (book.numbers[ACTIVE], count(book)) == (1, 1)
    dismiss(handle, rows_of(1, 4, 7))
    assert (book.numbers[ACTIVE], count(book), book.soonest[1]) == (0, 0, math.inf)
    assert soonest_of(handle, 9) == []


def test_doubt_makes_all_that_are_watched_due_once():
    book, handle = new_book()
    admit(handle, rows_of(0, 1, 6), np.array([[True] * 3, [False] * 3, [False, True, False]]))
    for row in (0, 6):
        look(book, row, [7.0] * 3)
    doubt_all(handle)
    waiting = book.wheel.heap[: book.wheel.numbers[WAITING]]
    assert sorted(waiting) == [0, 6]
    assert (count(book), book.soonest[1]) == (2, -math.inf)
    doubt_all(handle)
    assert (book.wheel.numbers[WAITING], count(book)) == (2, 2)


@pytest.mark.parametrize("seed", range(5))
def test_random_books_are_those_of_a_dictionary(seed):
    rng = np.random.default_rng(seed)
    book, handle = new_book(rows := 16)
    known = {}
    for _ in range(300):
        row, action = int(rng.integers(rows)), rng.random()
        if action < 0.3 and row not in known:
            mask = rng.random(LINKS) < 0.7
            admit(handle, rows_of(row), mask[None])
            if mask.any():
                known[row] = np.where(mask, -math.inf, math.nan)
        elif action < 0.4:
            dismiss(handle, rows_of(row))
            known.pop(row, None)
        elif row in known:
            expiry = rng.choice([1.0, 2.0, 3.0, 4.5, math.inf], LINKS)
            look(book, row, expiry)
            known[row] = np.where(np.isnan(known[row]), math.nan, expiry)
        if rng.random() < 0.02 and rows < 64:
            rows *= 2
            book = grow_book(book, NEWS, resize_states(book.reference_states, rows, 1))
            handle = pack(book)
        ends = {one: np.nanmin(links) for one, links in known.items()}
        assert book.numbers[ACTIVE] == len(known) == count(book)
        assert book.soonest[1] == min(ends.values(), default=math.inf)
        for limit in (0, 1, 5, 100):
            found = soonest_of(handle, limit)
            assert len(set(found)) == len(found) == min(limit, len(known))
            assert [ends[one] for one in found] == sorted(ends.values())[:limit]
        for one, links in known.items():
            if np.nanmin(links) < math.inf:
                assert first_link(book.watched, book.pair_expiry, one) == np.nanargmin(links)


def test_growing_keeps_what_is_known():
    book, handle = new_book(4)
    admit(handle, rows_of(0, 3), np.ones((2, LINKS), dtype=bool))
    look(book, 3, [3.0, 2.0, 9.0])
    book.reference_states.points[3, 0] = [1.0, 2.0, 3.0]
    book.reference_states.point_count[3] = 1
    grown = grow_book(book, NEWS, resize_states(book.reference_states, 100, 8))
    for name in ("watched", "pair_expiry", "pair_sphere", "pair_bound", "evaluated_at", "broken"):
        before, after = getattr(book, name), getattr(grown, name)
        assert np.array_equal(after[:4], before)
        assert len(after) == 100
    assert grown.reference_states.points.shape == (100, 8, 3)
    assert grown.reference_states.points[3, 0].tolist() == [1.0, 2.0, 3.0]
    assert soonest_of(pack(grown), 9) == [0, 3]
    assert not grown.watched[4:].any()
    assert grown.numbers is book.numbers
