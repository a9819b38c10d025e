"""What every schedule refuses, and the protocol that all of them keep."""

import numpy as np
import pytest

from armguard.exceptions import ArmguardError
from armguard.scheduling import SCHEDULES, Schedule, make_schedule


@pytest.fixture(params=SCHEDULES)
def schedule(request) -> Schedule:
    return make_schedule(request.param, 0.001)


def test_results_must_match_what_was_due(schedule):
    schedule.insert([5, 9])
    schedule.due()
    for wrong in ([], [1.0], [1.0, 2.0, 3.0], [[1.0, 2.0]]):
        with pytest.raises(ArmguardError, match=r"expected \(2,\)"):
            schedule.settle(wrong, 0.1)
    schedule.settle([1.0, 2.0], 0.1)
    with pytest.raises(ArmguardError, match="due"):
        schedule.settle([1.0, 2.0], 0.1)


def test_a_refused_change_changes_nothing(schedule):
    schedule.insert([5, 9])
    for change, pairs, words in [
        (schedule.insert, [7, 9], "pair 9: is already"),
        (schedule.remove, [5, 7], "pair 7: is not"),
        (schedule.touch, [5, 7], "pair 7: is not"),
        (schedule.insert, [-3], "-3"),
    ]:
        with pytest.raises(ArmguardError, match=words):
            change(pairs)
        assert sorted(schedule.ranking().tolist()) == [5, 9]
    assert sorted(schedule.due().tolist()) == [5, 9]


def test_no_pairs_are_no_trouble(schedule):
    for change in (schedule.insert, schedule.remove, schedule.touch):
        change([])
    for _ in range(3):
        assert schedule.due().size == 0
        schedule.settle([], 0.1)
    assert schedule.flagged().size == schedule.ranking().size == 0
    assert schedule.due().dtype == schedule.flagged().dtype == schedule.ranking().dtype == np.int64


def test_pairs_that_were_due_and_never_settled_are_due_again(schedule):
    schedule.insert(np.arange(20))
    for change in (
        lambda: None,
        lambda: schedule.touch([3]),
        lambda: schedule.remove([19]),
        lambda: schedule.insert([77]),
    ):
        assert set(range(19)) <= set(schedule.due().tolist())
        change()
    assert set(schedule.due().tolist()) == {*range(19), 77}


def test_a_pair_may_leave_and_come_back(schedule):
    largest = 2**63 - 1
    for _ in range(3):
        schedule.insert([largest, 0])
        due = schedule.due()
        assert set(due.tolist()) == {largest, 0}
        schedule.settle(np.where(due == largest, 1.0, 2.0), 0.1)
        assert schedule.ranking().tolist() == [largest, 0]
        schedule.remove([0, largest])
        assert schedule.due().size == 0
        schedule.settle([], 0.1)


def test_an_unknown_schedule_is_named():
    with pytest.raises(ArmguardError, match=r"dda.*full, daa"):
        make_schedule("dda", 0.001)
