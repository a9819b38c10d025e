import os
import shutil
import subprocess
import sys

import numpy as np
import pytest

from armguard.jit import kernel
from armguard.jit.kernels import separate_kernel

PROGRAM = """
import sys
from numba.core import event
from armguard.jit import kernel
from armguard.jit.kernels import separate_kernel

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
def one(x):
    return part(x)

@kernel
def two(x):
    return 2.0 * part(x) + square(x)
"""


@separate_kernel
def scale(array, factor):
    if not factor >= 0.0:
        raise ValueError("factor is negative")
    for i in range(array.shape[0]):
        array[i] *= factor
    return array[0], np.int64(array.shape[0])


@kernel
def scale_twice(array, factor):
    first, count = scale(array, factor)
    second, _ = scale(array, 2)
    return first, second, count


def test_a_separate_kernel_is_called_as_any_other():
    array = np.array([1.0, 2.0])
    assert scale_twice(array, 3.0) == (3.0, 6.0, 2)
    assert array.tolist() == [6.0, 12.0]
    with pytest.raises(ValueError, match="factor is negative"):
        scale_twice(array, np.nan)
    assert scale(array, 0.5) == (3.0, 2)
    with pytest.raises(ValueError, match="factor is negative"):
        scale(array, -1.0)


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


def test_a_part_from_the_cache_brings_along_what_it_calls(run):
    assert run("one") == ["10.0 one part square"]
    assert run("two") == ["29.0 two"]
    assert run("two") == ["29.0"]


def test_what_calls_it_is_compiled_anew_where_its_symbol_has_changed(run):
    assert run("one") == ["10.0 one part square"]
    for folder in run.cache.glob("*/callees"):
        shutil.rmtree(folder)
    # Compiled earlier in its process, it has another symbol.
    assert run("two", "one") == ["29.0 two square part", "10.0 one"]
    assert run("one", "two") == ["10.0", "29.0"]
