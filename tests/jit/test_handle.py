import copy
import gc
import sys
import weakref
from typing import NamedTuple

import numba
import numpy as np
import pytest

from armguard.jit import kernel, pack
from armguard.jit.handle import machine_code


class Inner(NamedTuple):
    array: np.ndarray
    count: int
    flag: bool


class Rest(NamedTuple):
    added: np.ndarray
    square: np.ndarray


class Outer(NamedTuple):
    inner: Inner
    rest: Rest
    scale: float


@kernel
def add_up(handle, index):
    content = handle.content
    content.inner.array[index] += content.scale * content.rest.added[index]
    return content.inner.array.sum() if content.inner.flag else float(content.inner.count)


def make():
    return Outer(Inner(np.arange(3.0), 5, True), Rest(np.ones(3), np.zeros((2, 2))), 10.0)


def test_compiled_code_reads_and_writes_what_was_packed():
    content = make()
    handle = pack(content)
    assert add_up(handle, 1) == 13.0
    assert content.inner.array.tolist() == [0.0, 11.0, 2.0]
    content.inner.array[0] = 100.0
    assert add_up(handle, 2) == 100.0 + 11.0 + 12.0


def test_handles_of_equal_kinds_are_of_one_type():
    """Else kernels would compile anew in the tick that packs again."""
    add_up(pack(make()), 0)
    before = len(add_up.overloads)
    bigger = make()._replace(rest=Rest(np.ones(9), np.zeros((5, 5))))
    add_up(pack(bigger), 0)
    assert len(add_up.overloads) == before


@kernel
def sum_inner(inner):
    return inner.content.array.sum() if inner.content.flag else 0.0


@kernel
def sum_twice(handle):
    return sum_inner(handle.content.inner) + sum_inner(handle.content.inner)


def test_a_tuple_within_is_passed_on_as_if_it_was_packed_by_itself():
    content = make()
    assert sum_twice(pack(content)) == 6.0
    assert sum_inner(pack(content.inner)) == 3.0
    assert len(sum_inner.overloads) == 1


@kernel
def find_place(handle, i, j, k):
    cube = handle.content.cube
    return cube[i, j, k], cube[i].sum(), cube.size, cube.shape, cube.T.shape[0]


class Cube(NamedTuple):
    cube: np.ndarray


@pytest.mark.parametrize("kind", [float, np.int32, np.int8, np.bool_])
@pytest.mark.parametrize("layout", ["C", "F", "A"])
def test_arrays_of_any_layout_and_kind_are_read_as_they_are(kind, layout):
    cube = (np.arange(24).reshape(2, 3, 4) % 5).astype(kind)
    if layout == "A":
        cube = np.repeat(cube, 2, axis=1)[:, ::2]
    cube = np.asarray(cube, order=layout if layout != "A" else "K")
    found = find_place(pack(Cube(cube)), 1, 2, 3)
    assert found == (cube[1, 2, 3], cube[1].sum(), 24, (2, 3, 4), 4)


@kernel
def write(handle):
    handle.content.array[0] = 1.0


def test_arrays_that_must_not_be_written_are_not():
    array = np.zeros(3)
    array.flags.writeable = False
    with pytest.raises(numba.TypingError):
        write(pack(Inner(array, 0, False)))


@pytest.mark.parametrize("wrong", [None, "text", [1.0], (1.0, 2.0), np.zeros(()), 1j])
def test_what_cannot_be_held_is_named(wrong):
    with pytest.raises(TypeError, match=r"handle\.inner\.count is a"):
        pack(make()._replace(inner=make().inner._replace(count=wrong)))


def test_arrays_live_as_long_as_their_handle():
    array = np.arange(4.0)
    gone = weakref.ref(array)
    handle = pack(make()._replace(rest=Rest(array, np.zeros((1, 1)))))
    del array
    gc.collect()
    # The memory is compiled code's, whether or not Python's view on it still is.
    noise = [np.full(4, 9.0) for _ in range(100)]
    assert add_up(handle, 2) == 3.0 + 10.0 * 2.0
    del handle, noise
    gc.collect()
    assert gone() is None


@kernel
def measure(handle, array, factor):
    return factor * (array.sum() + handle.content.inner.array[0]), array.shape[0]


def test_a_copy_outlives_what_it_was_copied_from():
    handle = pack(make())
    copied = copy.deepcopy(handle)
    assert add_up(handle, 1) == 13.0
    assert copied.address != handle.address
    del handle
    gc.collect()
    kept = [np.full(size, -1) for size in range(1, 30) for _ in range(100)]
    assert add_up(copied, 2) == 13.0
    assert len(kept) == 2900


def test_machine_code_does_what_the_kernel_does_for_arrays_of_any_strides():
    content = make()
    handle, table = pack(content), np.arange(12.0).reshape(4, 3)
    run = machine_code(measure, handle, table[:, 0], 1.0)
    for array in (table[:, 1], table[::-2, 2], np.ones(5)):
        assert run(handle, array, 2.0) == (2.0 * array.sum(), len(array))
    assert run(handle, table[:, 0], np.float64(0.5)) == (9.0, 4)
    content.inner.array[0] = 3.0
    assert run(handle, np.zeros(1), 1.0) == (3.0, 1)


def test_what_is_borrowed_may_be_used_again_and_again():
    """References that are counted wrongly would free the arrays, or keep them for ever."""
    array = np.arange(3.0)
    content = make()
    handle = pack(content._replace(inner=content.inner._replace(array=array)))
    before = sys.getrefcount(array)
    for _ in range(1000):
        add_up(handle, 0)
    assert sys.getrefcount(array) == before
    assert array[0] == 10_000.0
