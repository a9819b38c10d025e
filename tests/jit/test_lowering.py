import itertools
import math
from typing import NamedTuple

import numpy as np
import pytest
from numba.core.runtime import _nrt_python, rtsys

from armguard.jit import kernel, pack


@kernel
def sum_items(numbers, pairs, flags, table, k):
    total = numbers[k] + pairs[0, k] * table[k, k - 1, 0]
    if flags[k] and not flags[0]:
        total += 0.5
    return total


@kernel
def set_items(numbers, counts, flags, table, k):
    numbers[k] = k
    counts[0] = counts[k] // 3
    flags[k] = numbers[k] < 0.0
    table[k, 0] += 0.25


def lay_out(kind):
    """Arrays of 1, 2 and 3 axes, in one of the layouts that kernels are handed."""
    numbers, pairs = np.arange(4.0), np.arange(8.0).reshape(2, 4)
    table = np.arange(32.0).reshape(4, 4, 2)
    flags = np.array([False, True, False, True])
    if kind == "strided":
        return (
            np.repeat(numbers, 2)[::2],
            np.repeat(pairs, 3, axis=1)[:, ::3],
            flags,
            table[:, ::-1],
        )
    if kind == "by columns":
        return numbers, np.asfortranarray(pairs), flags, np.asfortranarray(table)
    return numbers, pairs, flags, table


@pytest.mark.parametrize("kind", ["contiguous", "strided", "by columns"])
def test_items_are_read_and_set_as_python_does_from_either_end(kind):
    for k in (1, 3, -1, -2):
        numbers, pairs, flags, table = lay_out(kind)
        assert sum_items(numbers, pairs, flags, table, k) == sum_items.py_func(
            numbers, pairs, flags, table, k
        )
        results = []
        for function in (set_items, set_items.py_func):
            numbers, pairs, flags, _ = lay_out(kind)
            counts = np.array([7, 8, 9, 10])
            function(numbers, counts, flags, pairs.T, k)
            results.append([array.tolist() for array in (numbers, counts, flags, pairs)])
        assert results[0] == results[1]


@kernel
def find_extremes(x, y, z, count):
    return (
        min(x, y), max(x, y), min(x, y, z), max(x, y, z),
        min(x, count), max(count, x), min(count, 2), max(3, count), max((x, y, z)),
    )  # fmt: skip


def test_extremes_of_numbers_are_those_of_python_to_the_bit():
    numbers = (0.0, -0.0, 1.5, -2.0, math.inf, -math.inf, math.nan)
    for x, y, z in itertools.product(numbers, repeat=3):
        for count in (-1, 2, 5):
            found = np.array(find_extremes(x, y, z, count), dtype=float)
            told = np.array(find_extremes.py_func(x, y, z, count), dtype=float)
            assert found.tobytes() == told.tobytes()


class Lent(NamedTuple):
    values: np.ndarray
    scale: float


@kernel
def make_arrays(handle, given, take_given):
    content = handle.content
    values = content.values
    made = np.zeros(values.shape[0])
    for i in range(values.shape[0]):
        made[i] = content.scale * content.values[i] + given[i]
    pair = (made, given)
    chosen = given[1:] if take_given else made
    return pair, chosen


@pytest.fixture
def count_living():
    """Says how many arrays that compiled code made are alive."""
    _nrt_python.memsys_enable_stats()

    def count():
        counts = rtsys.get_allocation_stats()
        return counts.alloc - counts.free, counts.mi_alloc - counts.mi_free

    yield count
    _nrt_python.memsys_disable_stats()


def test_arrays_that_kernels_make_live_as_long_as_they_are_held(count_living):
    values, given = np.arange(4.0), np.ones(4)
    handle = pack(Lent(values, 2.0))
    make_arrays(handle, given, True)  # compiled
    before = count_living()
    kept = [make_arrays(handle, given, bool(k % 2)) for k in range(50)]
    for k, ((made, same), chosen) in enumerate(kept):
        assert made.tolist() == [1.0, 3.0, 5.0, 7.0]
        assert same.tolist() == given.tolist()
        assert chosen.tolist() == ([1.0, 1.0, 1.0] if k % 2 else made.tolist())
    del kept, made, same, chosen
    assert count_living() == before
    assert values.tolist() == [0.0, 1.0, 2.0, 3.0]
