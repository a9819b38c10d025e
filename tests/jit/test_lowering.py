import numpy as np
import pytest

from armguard.jit import kernel


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
