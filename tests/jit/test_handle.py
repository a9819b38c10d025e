import gc
import sys
import weakref
from typing import NamedTuple

import numpy as np

from armguard.jit import kernel, pack
from armguard.jit.handle import machine_code


class Inner(NamedTuple):
    array: np.ndarray
    count: int
    flag: bool


class Outer(NamedTuple):
    inner: Inner
    rest: tuple
    scale: float


@kernel
def add_up(handle, index):
    content = handle.content
    content.inner.array[index] += content.scale * content.rest[0][index]
    return content.inner.array.sum() if content.inner.flag else float(content.inner.count)


def make():
    return Outer(Inner(np.arange(3.0), 5, True), (np.ones(3), np.zeros((2, 2))), 10.0)


def test_compiled_code_reads_and_writes_what_was_packed():
    content = make()
    handle = pack(content)
    assert add_up(handle, 1) == 13.0
    assert content.inner.array.tolist() == [0.0, 11.0, 2.0]
    content.inner.array[0] = 100.0
    assert add_up(handle, 2) == 100.0 + 11.0 + 12.0


def test_numbers_are_as_they_were_when_packed():
    content = make()
    handle = pack(content._replace(inner=content.inner._replace(flag=False)))
    assert add_up(handle, 0) == 5.0
    handle = pack(content._replace(inner=content.inner._replace(flag=False, count=6)))
    assert add_up(handle, 0) == 6.0


def test_handles_of_equal_kinds_are_of_one_type():
    """Else kernels would compile anew in the tick that packs again."""
    add_up(pack(make()), 0)
    before = len(add_up.overloads)
    bigger = make()._replace(rest=(np.ones(9), np.zeros((5, 5))))
    add_up(pack(bigger), 0)
    assert len(add_up.overloads) == before


def test_arrays_live_as_long_as_their_handle():
    array = np.arange(4.0)
    gone = weakref.ref(array)
    handle = pack(make()._replace(rest=(array, np.zeros((1, 1)))))
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
