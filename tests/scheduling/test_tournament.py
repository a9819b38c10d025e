"""A tournament against the plain array of its values."""

import math

import numpy as np
import pytest

from armguard.scheduling.tournament import (
    ROOT,
    WIDTH,
    entries_of,
    find_below,
    find_least,
    grow_tournament,
    make_tournament,
    set_value,
)

VALUES = np.array([-math.inf, -1.0, 0.0, 0.5, 0.5, 3.0, 1e300, math.inf])


def agree(tournament, values, rng):
    assert tournament[ROOT] == values.min()
    entries = entries_of(tournament)
    assert entries[: len(values)].tolist() == values.tolist()
    assert np.isinf(entries[len(values) :]).all()
    assert find_least(tournament) == np.argmin(values)
    for bound in (*rng.choice(VALUES, 2), float(rng.choice(values)), -math.inf, math.nan):
        below = np.flatnonzero(entries <= bound)
        for room in (0, 1, int(rng.integers(0, len(values) + 1)), len(values) + 3):
            found = np.full(room, -1)
            assert find_below(tournament, bound, found) == min(len(below), room)
            assert found[: len(below)].tolist() == below[:room].tolist()


@pytest.mark.parametrize("capacity", [1, 2, 8, 9, 64, 100])
def test_random_changes(capacity):
    rng = np.random.default_rng(capacity)
    tournament, values = make_tournament(capacity), np.full(capacity, math.inf)
    for _ in range(400):
        entry, value = int(rng.integers(capacity)), float(rng.choice(VALUES))
        set_value(tournament, entry, value)
        values[entry] = value
        agree(tournament, values, rng)


def test_everything_above_the_entries_is_the_least_of_its_eight():
    """So that no change can leave an older winner behind."""
    rng = np.random.default_rng(0)
    tournament = make_tournament(64)
    players = tournament[ROOT + 1 :].reshape(-1, WIDTH)
    for _ in range(500):
        set_value(tournament, int(rng.integers(64)), round(rng.normal(), 1))
        assert tournament[ROOT : ROOT + len(players)].tolist() == players.min(axis=1).tolist()


def test_what_is_no_number_counts_as_least():
    tournament = make_tournament(4)
    set_value(tournament, 0, -5.0)
    set_value(tournament, 2, math.nan)
    assert (tournament[ROOT], find_least(tournament)) == (-math.inf, 2)
    set_value(tournament, 2, 7.0)
    assert (tournament[ROOT], find_least(tournament)) == (-5.0, 0)


@pytest.mark.parametrize("capacity", [1, 4, 32])
def test_growing_keeps_all_values(capacity):
    rng = np.random.default_rng(capacity)
    tournament, values = make_tournament(capacity), rng.normal(size=capacity)
    for entry, value in enumerate(values):
        set_value(tournament, entry, value)
    for larger in (capacity, 2 * capacity, 8 * capacity):
        grown = grow_tournament(tournament, larger)
        agree(grown, np.append(values, np.full(larger - capacity, math.inf)), rng)
        set_value(grown, larger - 1, -9.0)
        assert find_least(grown) == larger - 1
