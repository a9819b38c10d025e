import json
import os
import re
import shutil
import subprocess
import sys

import numpy as np
import pytest

from armguard.exceptions import ArmguardError
from armguard.jit import kernel
from armguard.jit.kernel_folder import PACKAGE
from armguard.jit.kernels import IS_FAST, has_fast_path
from support.kernel_program import ALONE, Program

BOTH = pytest.mark.parametrize("jit", ["fast", "plain"])


@pytest.mark.parametrize(
    ("version", "tested"),
    [("0.62.1", False), ("0.63.0", True), ("0.68.1", True), ("0.99.0rc1", False), ("1.0", False)],
)
def test_the_fast_path_is_for_tested_versions_of_numba_that_nobody_has_forbidden(version, tested):
    assert has_fast_path(version, "") is tested
    assert not has_fast_path(version, "plain")
    for misspelt in ("Plain", "fast", " plain"):
        with pytest.raises(ArmguardError, match=f"ARMGUARD_JIT: is '{misspelt}'; expected plain"):
            has_fast_path(version, misspelt)


def test_one_module_has_private_parts_of_numba_and_every_kernel_is_compiled_by_this_room():
    private = re.compile(r"^\s*(from|import) (numba\.|llvmlite)", re.MULTILINE)
    by_attribute = re.compile(r"\bnumba\.core\.[\w.]+")
    found, reached = set(), []
    for path in PACKAGE.rglob("*.py"):
        text = path.read_text()
        reached += by_attribute.findall(text) if path.name != "fast_path.py" else []
        if private.search(text):
            found.add(path.name)
        if path.parent.name != "jit":
            assert "njit" not in text, f"{path}: use armguard.jit.kernel"
    assert found == {"fast_path.py"}
    assert sorted(reached) == [
        "numba.core.compiler_lock.global_compiler_lock",
        "numba.core.typing.templates.AttributeTemplate",
    ]


def test_kernels_divide_as_numpy_does_and_keep_nan():
    @kernel
    def divide(a, b):
        return a / b

    @kernel(inline="always")
    def subtract(a, b):
        return a - b

    assert divide(1.0, 0.0) == np.inf
    assert np.isnan(divide(0.0, 0.0))
    assert np.isnan(subtract(np.inf, np.inf))


def test_a_kernel_that_uses_variables_around_it_is_refused():
    factor = 2.0
    with pytest.raises(TypeError, match="scale uses factor"):

        @kernel
        def scale(number):
            return factor * number


ARITHMETIC = """
import json, math
from typing import NamedTuple
import numpy as np
from armguard.jit import kernel, pack
from armguard.jit.handle import machine_code
from armguard.jit.kernels import IS_FAST, merged_kernel, separate_kernel

class Inner(NamedTuple):
    values: np.ndarray
    flags: np.ndarray
    count: int

class Outer(NamedTuple):
    inner: Inner
    table: np.ndarray
    scale: float
    is_on: bool

@merged_kernel
def blend(x, y, share):
    return x * share + y * (1.0 - share)

@separate_kernel
def roots(inner, sums):
    if inner.content.count < 0:
        raise ValueError("count is negative")
    for k in range(inner.content.count):
        x = inner.content.values[k - inner.content.count]
        sums[k] += math.sqrt(abs(x)) ** 3 + math.atan2(x, 3.0) - x ** 0.3 % 7
        sums[0] = min(sums[0], max(sums[k], x, -0.5))

@kernel
def mix(handle, sums):
    outer = handle.content
    roots(outer.inner, sums)
    for i in range(outer.table.shape[0]):
        for j in range(outer.table.shape[1]):
            share = outer.scale if outer.inner.flags[i % 3] else math.exp(-outer.table[i, j])
            sums[j] += blend(outer.table[i, j], outer.table[i - 1, j] / (i + 0.1), share)
            outer.table[i, j] *= 1.0 + 1e-3 * sums[j]
    sums[-1] = sums[1:3].sum() if outer.is_on else np.nan
    return sums[0], len(sums)

random = np.random.default_rng(1)
inner = Inner(random.normal(size=8)[::2], np.array([True, False, True]), 4)
handle = pack(Outer(inner, random.normal(size=(5, 4)), 1 / 3, True))
sums, told = np.zeros(4), []
run = machine_code(mix, handle, sums)
for _ in range(100):
    told += [*run(handle, sums), *sums.view(np.int64).tolist()]
try:
    roots(pack(inner._replace(count=-1)), sums)
except ValueError as error:
    told.append(str(error))
print(json.dumps([IS_FAST, str(told)]))
"""


@pytest.mark.skipif(not IS_FAST, reason="this process does not use the fast path")
def test_both_paths_compute_the_same_to_the_bit(tmp_path):
    source = tmp_path / "arithmetic.py"
    source.write_text(ALONE + ARITHMETIC)
    told = []
    for jit in ("", "plain", "plain"):
        environment = {"ARMGUARD_JIT": jit, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
        result = subprocess.run(
            [sys.executable, str(source)], env={**os.environ, **environment},
            capture_output=True, text=True, check=True,
        )  # fmt: skip
        told.append(json.loads(result.stdout))
    assert [is_fast for is_fast, _ in told] == [True, False, False]
    assert "count is negative" in told[0][1]
    assert len({numbers for _, numbers in told}) == 1


def run(program, jit, **more):
    """By the fast path a process is forked, which is quicker."""
    if jit == "fast" and not IS_FAST:
        pytest.skip("this process does not use the fast path")
    return program.run(**more, **({"ARMGUARD_JIT": jit} if jit == "plain" else {}))


@pytest.fixture
def program(tmp_path):
    return Program(tmp_path)


def test_a_program_that_dies_is_a_failure(program):
    """As one does that calls machine code which is not there."""
    with pytest.raises(AssertionError, match="ended with status 9"):
        program.run(before="import os, signal\nos.kill(os.getpid(), signal.SIGKILL)\n")
    assert program.run() == ["3.0", "0"]


@BOTH
def test_a_changed_source_has_another_folder_of_kernels(program, jit):
    assert run(program, jit) == ["3.0", "0"]
    assert run(program, jit) == ["3.0", "1"]
    source = program.folder / "lib.py"
    source.write_text(source.read_text().replace("content[0]", "content[0] + 1.0"))
    assert run(program, jit) == ["4.0", "0"]
    folders = {path.relative_to(program.cache).parts[0] for path in program.kept()}
    assert len(folders) == 2
    assert all(name.startswith("kernels-") for name in folders)


@BOTH
@pytest.mark.parametrize("length", [0, 10, 200])
def test_files_that_are_cut_short_are_written_anew(program, jit, length):
    run(program, jit)
    damaged = [path for path in program.kept() if path.suffix != ".lock"]
    for path in damaged:
        path.write_bytes(path.read_bytes()[:length])
    assert damaged
    assert run(program, jit) == ["3.0", "0"]
    assert run(program, jit) == ["3.0", "1"]


@pytest.mark.parametrize("call", ["lib.first", "machine_code(lib.first, (3.0, 1))"])
def test_code_for_other_arguments_in_the_files_of_these_is_not_run(program, call):
    """So two processes leave Numba's files that save a kernel's first code at once."""
    other = program.folder / "other"
    assert run(program, "plain") == ["3.0", "0"]
    assert run(program, "plain", content="(3, 1)", NUMBA_CACHE_DIR=str(other)) == ["3", "0"]
    swapped = list(other.rglob("*first*.nbc"))
    assert swapped
    for path in swapped:
        shutil.copy(path, program.cache / path.relative_to(other))
    before = f"import lib\nfrom armguard.jit.handle import machine_code\nlib.run = {call}\n"
    assert run(program, "plain", before=before + "print(lib.run((3.0, 1)))")[0] == "3.0"
    assert run(program, "plain") == ["3.0", "1"]


@BOTH
def test_kernels_run_where_no_cache_can_be_written_and_leave_nothing_elsewhere(program, jit):
    """Numba would put them beside their source, and know them by its content alone."""
    program.cache.write_text("not a folder")
    for _ in range(2):
        assert run(program, jit) == ["3.0", "0"]
    assert not [path for path in program.folder.rglob("*") if path.suffix in (".nbi", ".kernel")]


@BOTH
def test_kernels_run_where_the_disk_is_full(program, jit):
    full = (
        "import builtins, io\n"
        "def refuse(file, mode='r', *more, **options):\n"
        "    if mode == 'wb':\n"
        "        raise OSError(28, 'No space left on device')\n"
        "    return usual(file, mode, *more, **options)\n"
        "usual, builtins.open, io.open = io.open, refuse, refuse\n"
    )
    assert run(program, jit, before=full) == ["3.0", "0"]
