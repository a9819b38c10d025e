import math
import subprocess
import sys

import numpy as np
import pytest
from numba.core import event

from armguard.jit import kernel
from support.kernel_program import ALONE


@kernel
def check(value):
    if not value >= 0.0:
        raise ValueError("value is negative")
    return math.sqrt(value)


@kernel
def fill(array, other):
    array[:] = other
    return check(array[0])


@kernel
def both(array, other):
    return fill(array, other) + check(array[1])


def test_an_entry_does_what_its_parts_do_each_compiled_once():
    array = np.zeros(2)
    assert both(array, np.array([4.0, 9.0])) == 5.0
    assert array.tolist() == [4.0, 9.0]
    assert not check.signatures
    assert check(16.0) == 4.0
    assert len(check.signatures) == 1


def test_what_a_part_raises_reaches_who_called_the_entry():
    with pytest.raises(ValueError, match="value is negative"):
        both(np.zeros(2), np.array([4.0, -9.0]))
    # Its words are made when it is raised.
    with pytest.raises(ValueError, match="3"):
        both(np.zeros(2), np.zeros(3))
    with pytest.raises(ValueError, match="value is negative"):
        check(np.nan)


def test_it_is_the_same_from_the_cache():
    code = (
        "sys.path.insert(0, {!r})\n"
        "import numpy as np, test_parts as these\n"
        "assert these.both(np.zeros(2), np.array([4.0, 9.0])) == 5.0\n"
        "these.test_what_a_part_raises_reaches_who_called_the_entry()\n"
        "print(sum(these.both.stats.cache_hits.values()))\n"
    ).format(__file__.rpartition("/")[0])
    told = []
    for _ in range(2):
        result = subprocess.run(
            [sys.executable, "-c", f"{ALONE}{code}"], capture_output=True, text=True, check=True
        )
        told.append(result.stdout)
    assert told[1] == "1\n"


@kernel
def scale(number, factor, negative):
    return -factor * number if negative else factor * number


@kernel
def scale_variously(number, factor):
    return (
        scale(number, 2, False) + scale(number, 3, True) + scale(number, negative=True, factor=4),
        scale(number, factor, factor > 5),
    )


def test_a_constant_is_no_other_kind_of_argument():
    names = []

    class Listener(event.Listener):
        def on_start(self, what):
            names.append(what.data["dispatcher"].py_func.__name__)

        def on_end(self, what):
            pass

    with event.install_listener("numba:compile", Listener()):
        assert scale_variously(1.0, 6) == (2.0 - 3.0 - 4.0, -6.0)
    # None where it comes from the cache.
    assert names.count("scale") <= 1
