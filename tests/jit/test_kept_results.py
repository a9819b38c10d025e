import threading

import numpy as np
import pytest

from armguard.jit.kept_results import keep_results


@pytest.fixture
def calls():
    return []


@pytest.fixture
def add(calls):
    @keep_results(2)
    def add(first, second):
        calls.append(1)
        return float(first.sum() + second.sum())

    return add


def test_the_same_numbers_are_computed_once(add, calls):
    one, two = np.array([1.0, 2.0]), np.array([3.0])
    assert add(one, two) == add(one.copy(), two.copy()) == 6.0
    assert len(calls) == 1


@pytest.mark.parametrize(
    "other",
    [
        np.array([1.0, 2.0 + 4e-16]),
        np.array([1.0, -0.0]),
        np.array([1.0, np.nan]),
        np.array([[1.0, 2.0]]),
        np.array([1.0, 2.0]).view(np.int64),
    ],
)
def test_anything_else_is_computed_anew(add, calls, other):
    add(np.array([1.0, 2.0]), np.zeros(1))
    add(np.array([1.0, 0.0]), np.zeros(1))
    add(other, np.zeros(1))
    assert len(calls) == 3


def test_numbers_count_with_their_kind():
    @keep_results(4)
    def describe(array, number):
        return repr(number)

    array = np.zeros(1)
    asked = (1, 1.0, True, None)
    for _ in range(2):
        assert [describe(array, one) for one in asked] == [repr(one) for one in asked]


def test_an_array_that_is_changed_in_place_is_another_one(add):
    array = np.array([1.0, 2.0])
    assert add(array, array) == 6.0
    array[0] = 5.0
    assert add(array, array) == 14.0


def test_what_was_asked_for_longest_ago_goes_first(add, calls):
    def ask(number):
        before = len(calls)
        add(np.array([number]), np.zeros(1))
        return len(calls) > before

    assert [ask(number) for number in (1.0, 2.0, 1.0, 3.0)] == [True, True, False, True]
    assert [ask(number) for number in (1.0, 2.0)] == [False, True]


def test_threads_get_the_same_answers(add):
    arrays, found = [np.array([float(k)]) for k in range(5)], []

    def ask():
        for _ in range(200):
            found.append([add(array, array) for array in arrays] == [0.0, 2.0, 4.0, 6.0, 8.0])

    threads = [threading.Thread(target=ask) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 800
    assert all(found)
