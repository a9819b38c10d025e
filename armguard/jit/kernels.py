"""Compiled kernels: serial functions with NumPy's error model, cached on disk.

Numba's public interface compiles all of them. Two names in `numba.core` are used beside it, because
no public name leads to them: the lock of Numba's compiler here, and a class in `handle`.

With versions of Numba that it was tested with, the module `fast_path` compiles them instead: its
machine code gives the same results to the bit, but is made in less than half the time.
`ARMGUARD_JIT=plain` in the environment turns that off.
"""

from __future__ import annotations

import contextlib
import functools
import os
import re
import shutil
from pathlib import Path
from typing import Any

import numba

from armguard.exceptions import ArmguardError
from armguard.jit.compile_lock import hold_compile_lock
from armguard.jit.kernel_folder import find_cache
from armguard.jit.progress import follow

# Numba's functions are untyped: they are called as anything is.
config: Any = numba.config
njit: Any = numba.njit
# What Numba holds while it compiles; no public name leads to it.
global_compiler_lock: Any = numba.core.compiler_lock.global_compiler_lock

OLDEST_TESTED, NEWEST_TESTED = (0, 63), (0, 68)
"""Versions of Numba that the fast path was tested with. It uses private parts of Numba, and another
version may not have them, or may end the process when they are used."""


def has_fast_path(version: str, choice: str) -> bool:
    """Whether kernels are compiled by the fast path.

    Args:
        version: Of Numba.
        choice: The environment's `ARMGUARD_JIT`.

    Raises:
        ArmguardError: The choice is neither empty nor `plain`.
    """
    if choice not in ("", "plain"):
        raise ArmguardError(
            "ARMGUARD_JIT", f"is {choice!r}", expected="plain", remedy="correct it, or unset it"
        )
    numbers = tuple(int(part) for part in re.findall(r"\d+", version)[:2])
    return not choice and OLDEST_TESTED <= numbers <= NEWEST_TESTED


IS_FAST = has_fast_path(numba.__version__, os.environ.get("ARMGUARD_JIT", ""))
"""Whether this process uses the fast path."""

if IS_FAST:
    from armguard.jit import fast_path


def kernel(function: Any = None, **options: Any) -> Any:
    """Compile a function with NumPy's error model and strict floating point, and cache it.

    It is compiled when it is called first, for each kind of arguments.

    Args:
        function: What to compile.
        options: Those of `numba.njit` for how it is inlined. Kernels are serial: `parallel` rests
            on steps of Numba's compiler that the fast path leaves out.

    Raises:
        TypeError: It uses variables of a function around it, which no cache would know.
    """
    if function is None:
        return functools.partial(kernel, **options)
    if outer := function.__code__.co_freevars:
        raise TypeError(
            f"{function.__name__} uses {', '.join(outer)} of the function around it; "
            "expected arguments and globals alone: pass it as an argument"
        )
    return fast_path.make_entry(function, options) if IS_FAST else _make_plain(function, options)


def merged_kernel(function: Any) -> Any:
    """A kernel whose machine code becomes part of that of each kernel that calls it.

    For what a loop over rows calls for each of them: to hand over a few groups of arrays, seven
    words each, takes longer than what is done with one row of them.

    Args:
        function: What to compile.
    """
    return kernel(function, forceinline=True)


def separate_kernel(function: Any) -> Any:
    """A kernel that the fast path compiles once for all kernels that call it.

    For what is long and called by several entries: otherwise it would be optimised and translated
    within each. A call costs what one of a kernel does that was too long to be merged.

    Args:
        function: What to compile.
    """
    return fast_path.make_separate_entry(function) if IS_FAST else kernel(function)


def _make_plain(function: Any, options: dict[str, Any]) -> Any:
    """A kernel by Numba's public interface, with Numba's own cache, in a folder for it alone.

    Args:
        function: What to compile.
        options: Further options of `numba.njit`.
    """
    place = find_cache(Path(function.__code__.co_filename)) / "plain"
    name = f"{function.__name__}-{function.__code__.co_firstlineno}"
    folder, lock = place / name, place / f"{name}.lock"
    with contextlib.suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
    before = config.CACHE_DIR
    config.CACHE_DIR = str(folder)
    try:
        # Python's error model costs two to four times as much, and fastmath would drop NaN. Where
        # Numba cannot write, it would cache elsewhere, and know a kernel by its own file alone.
        compiled = njit(error_model="numpy", cache=os.access(folder, os.W_OK), **options)(function)
    finally:
        config.CACHE_DIR = before
    compile_at_once = compiled.compile

    def compile_alone(kinds: Any) -> Any:
        # Numba's lock first: then no thread waits for a file that another one has locked.
        with global_compiler_lock, hold_compile_lock(lock):
            try:
                compile_at_once(kinds)
            except numba.TypingError:
                raise
            except Exception:  # a damaged file can raise anything, and so can a disk that is full
                pass
            if kinds in compiled.overloads:
                return compiled.overloads[kinds].entry_point
            # Nothing was read, or code for other arguments: two processes that save at once without
            # a lock can leave an index that names each other's files.
            shutil.rmtree(folder, ignore_errors=True)
            return compile_at_once(kinds)

    compiled.compile = compile_alone
    follow(compiled)
    return compiled
