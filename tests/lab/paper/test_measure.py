import math

import numpy as np
import pytest

from armguard.lab.paper import measure
from armguard.lab.paper.measure import (
    DAA,
    FULL,
    count_comparisons,
    measure_claims,
)
from armguard.lab.paper.world import World
from armguard.scheduling import DaaSchedule


@pytest.fixture(scope="module")
def rows():
    told = []
    found = [
        row
        for some in measure_claims(
            (0.05,), (3, 15), 4000, 0, lambda text, share: told.append(share)
        )
        for row in some
    ]
    assert told == sorted(told)
    assert 0.0 <= told[0] <= told[-1] <= 1.0
    return found


def test_each_schedule_sees_each_world(rows):
    names = [name for name, _, _ in DAA] + [FULL, "full-DF"]
    assert [(row.pairs, row.schedule) for row in rows] == [
        (pairs, name) for pairs in (3, 105) for name in names
    ]
    assert {row.ticks for row in rows if row.pairs == 105} == {4000 // 105}
    assert all(row.tick > 0.0 for row in rows)


def test_full_evaluates_all_and_is_always_right_and_never_late(rows):
    for row in rows:
        if row.schedule == FULL:
            assert row.evaluations == row.pairs
            assert row.agreement == row.rank_max == 1.0
            assert row.unseen == row.flagged == 0
            assert row.late_max == 0.0 or math.isnan(row.late_max)


def test_daa_evaluates_a_pair_a_bucket_and_leaves_nothing_unwatched(rows):
    for row in rows:
        assert row.unwatched == 0
        if row.schedule.startswith("daa, powers"):
            assert row.pairs > 3 or row.evaluations == 2.0
            assert row.evaluations <= math.floor(math.log2(row.pairs)) + 1


def test_rounds_are_those_of_the_last_bucket(rows):
    rounds = {(row.pairs, row.schedule): row.ticks / row.rounds for row in rows}
    # Places of the last bucket: of 2 that begin at 2, of 64 that begin at 64; of 2, of 34.
    assert rounds[3, "daa, powers"] == rounds[3, "daa, Fibonacci"] == 2
    assert rounds[105, "daa, powers"] == 64
    assert rounds[105, "daa, Fibonacci"] == 55
    assert rounds[105, FULL] == 1


def test_a_pair_that_is_neither_in_turn_nor_flagged_is_found(monkeypatch):
    """The control: a schedule that flags nothing has to be seen through."""
    monkeypatch.setattr(DaaSchedule, "flagged", lambda self: np.empty(0, dtype=np.int64))
    monkeypatch.setattr(measure, "STOP_TIME", 2.0)
    (some,) = measure_claims((0.05,), (25,), 60_000, 0, lambda text, share: None)
    by_name = {row.schedule: row for row in some}
    assert by_name["daa, powers"].alarms > 0
    assert by_name["daa, powers"].unwatched > 0
    assert by_name[FULL].unwatched == 0


def test_lateness_is_counted_from_the_alarm_to_the_turn(monkeypatch):
    """One pair comes near in tick 2; its turn is in tick 5, or never."""
    monkeypatch.setattr(measure, "STOP_TIME", 1.0)

    class Rota:
        def __init__(self, turns):
            self.turns, self.tick = turns, 0

        def insert(self, pairs):
            self.pairs = pairs

        def due(self):
            self.tick += 1
            return np.array([1] if self.tick in self.turns else [0])

        def settle(self, contact_times, stop_time):
            pass

        def flagged(self):
            return np.array([1])

        def ranking(self):
            return self.pairs

    def play(turns):
        one = measure._Contestant("a", Rota(turns), World(3, 0.05, 0))
        for near in (5.0, 0.9, 0.8, 0.9, 0.9, 5.0):
            exact = np.array([4.0, near, 9.0])
            one.tick(lambda due, exact=exact: exact[due], exact)
        return one.summarise(3, 5)

    seen = play({5})
    assert (seen.alarms, seen.late_p50, seen.late_max, seen.unseen) == (1, 3.0, 3.0, 0)
    assert seen.unwatched == 0
    # Ticks 2 to 5 name a pair that is second, tick 6 the right one.
    assert (seen.agreement, seen.rank_max) == (0.2, 2.0)
    gone = play(set())
    assert (gone.alarms, gone.late_max, gone.unseen) == (1, 4.0, 1)


def test_comparisons_are_those_of_a_merge_sort():
    assert count_comparisons(np.array([])) == count_comparisons(np.array([1.0])) == 0
    assert count_comparisons(np.arange(100.0)) == 99
    mixed = np.random.default_rng(0).random(1024)
    assert math.log2(math.factorial(1024)) * 0.98 < count_comparisons(mixed) < 1024 * 10
