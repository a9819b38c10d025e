"""Tethers as they are stated, and which rows they tie."""

import copy
import itertools

import numpy as np
import pytest

from armguard import ArmguardError, Obstacles
from armguard.obstacles.faults import FaultKind
from armguard.obstacles.tethers import MOST_STATED, MOST_TETHERS, TIED, TORN, Tether


def tied(obstacles):
    """Ids and length of each tether between rows."""
    obstacles.tie_rows()
    tethers, ids = obstacles.table.tethers, obstacles.ids
    return [
        (*(ids[row] for row in tethers.rows[number]), float(tethers.length[number]))
        for number in range(tethers.numbers[TIED])
    ]


def tell(obstacles, ids, stamp=0.0, source="camera"):
    places = np.arange(3.0 * len(ids)).reshape(-1, 3)
    obstacles.update(ids, stamp, places, radius=0.1, source=source)


def test_a_tether_ties_rows_once_both_are_reported_by_one_source():
    obstacles = Obstacles()
    obstacles.tether("elbow", "shoulder", 0.4, "measured")
    assert obstacles.tethers == (Tether("elbow", "shoulder", 0.4, "measured"),)
    assert obstacles.has_new_tethers
    assert tied(obstacles) == []
    assert not obstacles.has_new_tethers
    tell(obstacles, ["elbow"])
    tell(obstacles, ["shoulder"], source="other")
    assert tied(obstacles) == []
    tell(obstacles, ["shoulder"])
    assert obstacles.has_new_tethers
    assert tied(obstacles) == [("elbow", "shoulder", 0.4)]
    tell(obstacles, ["elbow"], source="other")
    assert len(tied(obstacles)) == 2, "each source has its own"
    obstacles.remove(["shoulder"], source="other")
    assert tied(obstacles) == [("elbow", "shoulder", 0.4)]
    obstacles.untether("shoulder", "elbow")
    assert tied(obstacles) == []
    assert obstacles.tethers == ()
    assert not obstacles.table.tethers.row_count.any()


def test_what_stands_still_is_not_tied():
    obstacles = Obstacles()
    for name in ("post", "hook"):
        obstacles.add_static(name, [0.0, 0.0, 0.0], 0.1)
    obstacles.tether("post", "hook", 0.4, "measured")
    assert tied(obstacles) == []


def test_a_tether_that_is_stated_anew_has_the_last_length():
    obstacles = Obstacles()
    tell(obstacles, ["a", "b"])
    obstacles.tether("a", "b", 0.4, "measured")
    obstacles.tether("b", "a", 0.5, "learned")
    assert obstacles.tethers == (Tether("b", "a", 0.5, "learned"),)
    changes = obstacles.table.changes
    obstacles.tether("b", "a", 0.5, "learned")
    assert obstacles.table.changes == changes, "nothing is new"
    assert tied(obstacles) == [("b", "a", 0.5)]


def test_rows_and_tethers_grow():
    obstacles = Obstacles()
    ids = [f"body {number}" for number in range(200)]
    for a, b in itertools.pairwise(ids):
        obstacles.tether(a, b, 0.4, "measured")
    tell(obstacles, ids)
    assert len(tied(obstacles)) == 199
    assert tied(copy.deepcopy(obstacles)) == tied(obstacles)
    assert obstacles.table.tethers.row_count.max() == 2


def test_a_broken_tether_stays_broken_when_others_come_and_go():
    obstacles = Obstacles()
    tell(obstacles, ["a", "b", "c"])
    obstacles.tether("a", "b", 0.4, "measured")
    obstacles.tether("b", "c", 0.4, "guessed")
    obstacles.tie_rows()
    tethers = obstacles.table.tethers
    tethers.is_broken[1], tethers.excess[1], tethers.numbers[TORN] = True, 0.123, 1
    obstacles.untether("a", "b")
    obstacles.tie_rows()
    assert obstacles.has_broken_tethers
    (told,) = obstacles.describe_broken_tethers()
    assert told == ("b and c", "123 mm farther apart than 0.4 m (guessed)")
    obstacles.remove(["c"])
    obstacles.tie_rows()
    assert not obstacles.has_broken_tethers, "there is nothing to be tethered"
    tell(obstacles, ["c"], 1.0)
    obstacles.tie_rows()
    assert obstacles.describe_broken_tethers() == [told]
    obstacles.tether("b", "c", 0.6, "guessed")
    obstacles.tie_rows()
    assert not obstacles.has_broken_tethers, "that is another premise"


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (("a", "a", 0.4, "measured"), "b: is 'a', as a is"),
        (("a", "", 0.4, "measured"), "b: is ''"),
        ((3, "b", 0.4, "measured"), "a: is 3"),
        (("a", "b\ud800", 0.4, "measured"), "b: is"),
        (("a", "b", -0.1, "measured"), "length: is -0.1"),
        (("a", "b", float("nan"), "measured"), "length: is nan"),
        (("a", "b", float("inf"), "measured"), "length: is inf"),
        (("a", "b", True, "measured"), "length: is True"),
        (("a", "b", "long", "measured"), "length: is 'long'"),
        (("a", "b", 101.0, "measured"), "length: is 101.0"),
        (("a", "b", 0.4, ""), "source: is ''"),
        (("a", "b", 0.4, "  "), "source: is '  '"),
        (("a", "b", 0.4, None), "source: is None"),
    ],
)
def test_malformed_tethers_are_refused_in_one_line(arguments, problem):
    obstacles = Obstacles()
    with pytest.raises(ArmguardError) as error:
        obstacles.tether(*arguments)
    assert problem in str(error.value)
    assert "\n" not in str(error.value)
    assert obstacles.tethers == ()
    assert [fault.kind for fault in obstacles.take_faults()] == [FaultKind.MALFORMED]


def test_an_obstacle_has_four_tethers_at_most_and_a_table_so_many():
    obstacles = Obstacles()
    for number in range(MOST_TETHERS):
        obstacles.tether("trunk", f"limb {number}", 0.4, "measured")
    with pytest.raises(ArmguardError, match="has 6 tethers; expected 6 at most"):
        obstacles.tether("another", "trunk", 0.4, "measured")
    obstacles.tether("limb 0", "trunk", 0.5, "learned")
    obstacles = Obstacles()
    for number in range(MOST_STATED):
        obstacles.tether(f"a {number}", f"b {number}", 0.4, "measured")
    with pytest.raises(ArmguardError, match="1024 at most"):
        obstacles.tether("a", "b", 0.4, "measured")


def test_what_was_not_tethered_is_not_tethered_any_more_either():
    obstacles = Obstacles()
    obstacles.untether("a", "b")
    with pytest.raises(ArmguardError):
        obstacles.untether("a", "a")
