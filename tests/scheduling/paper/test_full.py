import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from armguard.scheduling import FullSchedule, Schedule


def test_every_pair_is_due_in_every_tick_and_none_is_flagged():
    schedule: Schedule = FullSchedule()
    schedule.insert([30, 10, 20])
    for _ in range(3):
        assert schedule.due().tolist() == [30, 10, 20]
        schedule.settle([0.0, np.nan, np.inf], 1e9)
        assert schedule.flagged().size == 0


def test_ranking_is_by_time_with_doubtful_ones_first_and_ties_as_they_came():
    schedule = FullSchedule()
    schedule.insert([1, 2, 3, 4, 5])
    schedule.due()
    schedule.settle([np.inf, 0.5, np.nan, 0.5, 0.1], 0.0)
    assert schedule.ranking().tolist() == [3, 5, 2, 4, 1]


def test_ranking_after_a_change_keeps_what_is_known_and_puts_new_pairs_last():
    schedule = FullSchedule()
    schedule.insert([1, 2, 3])
    schedule.due()
    schedule.settle([3.0, 2.0, 1.0], 0.0)
    schedule.insert([0])
    schedule.remove([2])
    assert schedule.ranking().tolist() == [3, 1, 0]
    schedule.due()
    assert schedule.ranking().tolist() == [3, 1, 0]


def test_due_cannot_be_changed_by_the_caller():
    schedule = FullSchedule()
    schedule.insert([1, 2, 3])
    with pytest.raises(ValueError, match="read-only"):
        schedule.due()[0] = 7


@given(st.lists(st.lists(st.integers(0, 12), unique=True), max_size=20))
def test_what_is_due_is_what_was_inserted_and_not_removed(changes):
    schedule, members = FullSchedule(), set()
    for pairs in changes:
        leaving, coming = members & set(pairs), set(pairs) - members
        schedule.remove(sorted(leaving))
        schedule.insert(sorted(coming))
        schedule.touch(sorted(coming))
        members ^= set(pairs)
        due = schedule.due()
        assert sorted(due.tolist()) == sorted(members)
        schedule.settle(due * 1.0, 0.1)
        assert schedule.ranking().tolist() == sorted(members)
        assert len(schedule) == len(members)
