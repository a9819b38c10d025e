"""What the fast path does in its own way; `test_kernels` compares it with the plain one."""

import itertools
import math
import os
import shutil
import subprocess
import sys
from typing import NamedTuple

import numpy as np
import pytest
from numba.core.runtime import _nrt_python, rtsys

from armguard.jit import kernel, pack
from armguard.jit.kernels import IS_FAST, separate_kernel
from armguard.jit.progress import compilation
from support.kernel_program import Program

pytestmark = pytest.mark.skipif(not IS_FAST, reason="this process does not use it")


@separate_kernel
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


def test_an_entry_does_what_its_parts_and_separate_kernels_do():
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


@kernel
def report(value):
    print("value is", value)  # noqa: T201


@kernel
def report_twice(value):
    report(value)
    report(2.0 * value)


def test_a_part_finds_its_constants(capsys):
    report_twice(1.0)
    assert capsys.readouterr().out == "value is 1.0\nvalue is 2.0\n"


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
    before = compilation.count
    assert scale_variously(1.0, 6) == (2.0 - 3.0 - 4.0, -6.0)
    # Both are compiled, or none where they come from the cache.
    assert compilation.count - before in (0, 2)


PROGRAM = """
import sys
from numba.core import event

compiled = []

class Listener(event.Listener):
    def on_start(self, what):
        compiled.append(what.data["dispatcher"].py_func.__name__)
    def on_end(self, what):
        pass

event.register("numba:compile", Listener())
import lib
for name in sys.argv[1:]:
    print(getattr(lib, name)(3.0), *compiled)
    compiled.clear()
"""

LIBRARY = """
from armguard.jit import kernel
from armguard.jit.kernels import separate_kernel

@separate_kernel
def square(x):
    if x < 0.0:
        raise ValueError("negative")
    return x * x

@kernel
def part(x):
    return square(x) + 1.0

@kernel
def nothing(x):
    return x

@kernel
def one(x):
    return part(x)

@kernel
def two(x):
    return 2.0 * part(x) + square(x)
"""


@pytest.fixture
def run(tmp_path):
    """Runs kernels of a library in a process: what each gives, and what was compiled for it."""
    (tmp_path / "lib.py").write_text(LIBRARY)
    (tmp_path / "main.py").write_text(PROGRAM)

    def run(*names):
        result = subprocess.run(
            [sys.executable, str(tmp_path / "main.py"), *names],
            env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")},
            capture_output=True, text=True, check=True,
        )  # fmt: skip
        return result.stdout.split("\n")[:-1]

    run.cache = tmp_path / "cache"
    return run


def test_it_is_compiled_once_for_all_that_call_it_and_loaded_before_them(run):
    assert run("one", "two") == ["10.0 one part square", "29.0 two"]
    assert run("two", "one") == ["29.0", "10.0"]


def test_what_calls_it_is_compiled_anew_where_its_symbol_has_changed(run):
    assert run("one") == ["10.0 one part square"]
    for folder in run.cache.glob("*/callees"):
        shutil.rmtree(folder)
    # Compiled later in its process, it has another symbol.
    assert run("nothing", "one") == ["3.0 nothing", "10.0 square one part"]
    assert run("one", "two") == ["10.0", "29.0 two part"]


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


LAYOUTS = {
    "contiguous": np.ascontiguousarray,
    "by columns": np.asfortranarray,
    "strided": lambda array: np.repeat(array, 2, axis=-1)[..., ::2],
}


@pytest.mark.parametrize("lay_out", LAYOUTS.values(), ids=LAYOUTS)
@pytest.mark.parametrize("k", [1, 3, -1, -2])
def test_items_are_read_and_set_as_python_does_from_either_end(lay_out, k):
    results = []
    for read, write in ((sum_items, set_items), (sum_items.py_func, set_items.py_func)):
        numbers, pairs, table, counts = (
            lay_out(np.arange(size).reshape(shape).astype(kind))
            for size, shape, kind in (
                (4, 4, float), (8, (2, 4), float), (32, (4, 4, 2), float), (4, 4, int)
            )
        )  # fmt: skip
        flags = np.array([False, True, False, True])
        found = read(numbers, pairs, flags, table, k)
        write(numbers, counts, flags, pairs.T, k)
        results.append([found, *(one.tolist() for one in (numbers, counts, flags, pairs))])
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


@pytest.fixture
def program(tmp_path):
    return Program(tmp_path)


def test_a_cache_with_types_of_a_script_that_is_gone_is_an_empty_one(program, tmp_path):
    """One process packs a tuple of its own, the next knows nothing of where it came from."""
    (tmp_path / "script").mkdir()
    (tmp_path / "script" / "own.py").write_text(
        "from typing import NamedTuple\nclass Own(NamedTuple):\n    number: float\n"
    )
    own = {"content": "own.Own(2.0)", "before": "import own", "path": str(tmp_path / "script")}
    assert program.run(**own) == ["2.0", "0"]
    assert program.run(**own) == ["2.0", "1"]
    assert program.run() == ["3.0", "0"]
    assert program.run() == ["3.0", "1"]


def test_code_for_arguments_of_another_class_with_the_same_name_is_not_run(program, tmp_path):
    for place, fields in (("one", "x: float\n    y: float"), ("other", "y: float\n    x: float")):
        (tmp_path / place).mkdir()
        (tmp_path / place / f"{place}.py").write_text(
            f"from typing import NamedTuple\nclass Own(NamedTuple):\n    {fields}\n"
        )
    library = program.folder / "lib.py"
    library.write_text(library.read_text().replace("content[0]", "content.x"))
    for place, result in (("one", "1.0"), ("other", "2.0")):
        own = {"content": f"{place}.Own(1.0, 2.0)", "before": f"import {place}"}
        assert program.run(**own, path=str(tmp_path / place)) == [result, "0"]


def test_code_for_another_processor_is_not_run(program):
    assert program.run(NUMBA_CPU_NAME="generic", NUMBA_CPU_FEATURES="") == ["3.0", "0"]
    assert program.run() == ["3.0", "0"]
    assert program.run() == ["3.0", "1"]
    assert program.run(NUMBA_CPU_NAME="generic", NUMBA_CPU_FEATURES="") == ["3.0", "1"]
