"""Books against plain dictionaries: who is watched, until when, and who is due."""

import math

import numpy as np
import pytest

from armguard.jit import pack
from armguard.obstacles.table import ObstacleTable, make_states, resize_states
from armguard.pairs.scene import UNKNOWN
from armguard.scheduling.certificates import (
    ACTIVE,
    find_most_imminent,
    first_link,
    grow_certificates,
    insert,
    invalidate_all,
    make_certificates,
    remove,
)
from armguard.scheduling.timing_wheel import DUE, TURNING, WAITING, most_urgent, put_off
from armguard.scheduling.tournament import ROOT, find_least, set_value

LINKS = 3
NEWS = ObstacleTable().changed_rows


def new_certificates(rows=8):
    certificates = grow_certificates(
        make_certificates(LINKS, permits_contact=False), NEWS, make_states(rows)
    )
    return certificates, pack(certificates)


def look(certificates, row, expiry):
    """What a look leaves behind: the end of each link's certificate, and when it is due again."""
    certificates.pair_expiry[row] = expiry
    watched = certificates.watched[row]
    set_value(
        certificates.expiry_tree,
        row,
        float(np.min(certificates.pair_expiry[row], where=watched, initial=np.inf)),
    )
    put_off(certificates.wheel, row, 100, 0.0)


def rows_of(*rows):
    return np.array(rows, dtype=np.int64)


def soonest_of(handle, limit):
    rows = np.full(limit, -1, dtype=np.int64)
    return rows[: find_most_imminent(handle, rows)].tolist()


def count(certificates):
    return certificates.wheel.numbers[WAITING] + certificates.wheel.numbers[TURNING]


def test_who_is_admitted_is_due_and_knows_nothing():
    certificates, handle = new_certificates()
    look(certificates, 2, [4.0, 5.0, 6.0])
    certificates.reference_states.point_count[2] = 1
    masks = np.array([[True, False, True], [False, False, False]])
    insert(handle, rows_of(2, 5), masks)
    assert certificates.watched[[2, 5]].tolist() == masks.tolist()
    assert (certificates.pair_expiry[2] == -math.inf).all()
    assert (certificates.pair_bound[2] == UNKNOWN).all()
    assert (certificates.evaluated_at[2], certificates.reference_states.point_count[2]) == (
        -math.inf,
        0,
    )
    assert (certificates.expiry_tree[ROOT], find_least(certificates.expiry_tree)) == (-math.inf, 2)
    assert (certificates.wheel.slot[2], most_urgent(certificates.wheel)) == (DUE, 2)
    # Nobody watches the other one, so it is in nobody's way.
    assert (certificates.numbers[ACTIVE], count(certificates)) == (1, 1)


def test_doubt_makes_all_that_are_watched_due_once():
    certificates, handle = new_certificates()
    insert(handle, rows_of(0, 1, 6), np.array([[True] * 3, [False] * 3, [False, True, False]]))
    for row in (0, 6):
        look(certificates, row, [7.0] * 3)
    invalidate_all(handle)
    waiting = certificates.wheel.heap[: certificates.wheel.numbers[WAITING]]
    assert sorted(waiting) == [0, 6]
    assert (count(certificates), certificates.expiry_tree[ROOT]) == (2, -math.inf)
    invalidate_all(handle)
    assert (certificates.wheel.numbers[WAITING], count(certificates)) == (2, 2)


@pytest.mark.parametrize("seed", range(5))
def test_random_books_are_those_of_a_dictionary(seed):
    rng = np.random.default_rng(seed)
    certificates, handle = new_certificates(rows := 16)
    known = {}
    for _ in range(300):
        row, action = int(rng.integers(rows)), rng.random()
        if action < 0.3 and row not in known:
            mask = rng.random(LINKS) < 0.7
            insert(handle, rows_of(row), mask[None])
            if mask.any():
                known[row] = np.where(mask, -math.inf, math.nan)
        elif action < 0.4:
            remove(handle, rows_of(row))
            known.pop(row, None)
        elif row in known:
            expiry = rng.choice([1.0, 2.0, 3.0, 4.5, math.inf], LINKS)
            look(certificates, row, expiry)
            known[row] = np.where(np.isnan(known[row]), math.nan, expiry)
        if rng.random() < 0.02 and rows < 64:
            rows *= 2
            certificates = grow_certificates(
                certificates, NEWS, resize_states(certificates.reference_states, rows, 1)
            )
            handle = pack(certificates)
        ends = {one: np.nanmin(links) for one, links in known.items()}
        assert certificates.numbers[ACTIVE] == len(known) == count(certificates)
        assert certificates.expiry_tree[ROOT] == min(ends.values(), default=math.inf)
        for limit in (0, 1, 5, 100):
            found = soonest_of(handle, limit)
            assert len(set(found)) == len(found) == min(limit, len(known))
            assert [ends[one] for one in found] == sorted(ends.values())[:limit]
        for one, links in known.items():
            if np.nanmin(links) < math.inf:
                assert first_link(
                    certificates.watched, certificates.pair_expiry, one
                ) == np.nanargmin(links)


def test_growing_keeps_what_is_known():
    certificates, handle = new_certificates(4)
    insert(handle, rows_of(0, 3), np.ones((2, LINKS), dtype=bool))
    look(certificates, 3, [3.0, 2.0, 9.0])
    certificates.reference_states.points[3, 0] = [1.0, 2.0, 3.0]
    certificates.reference_states.point_count[3] = 1
    grown = grow_certificates(
        certificates, NEWS, resize_states(certificates.reference_states, 100, 8)
    )
    for name in ("watched", "pair_expiry", "pair_sphere", "pair_bound", "evaluated_at", "broken"):
        before, after = getattr(certificates, name), getattr(grown, name)
        assert np.array_equal(after[:4], before)
        assert len(after) == 100
    assert grown.reference_states.points.shape == (100, 8, 3)
    assert grown.reference_states.points[3, 0].tolist() == [1.0, 2.0, 3.0]
    assert soonest_of(pack(grown), 9) == [0, 3]
    assert not grown.watched[4:].any()
    assert grown.numbers is certificates.numbers
