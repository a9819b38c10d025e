"""Reports the progress of compilation and of other long work.

A first start compiles for many seconds, and fitting spheres to a new arm takes minutes. Who waits
at a terminal is told there; an application may tell it in its own way, or not at all.
"""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

from armguard.jit.collection import pause_collection

USUAL = 210
"""About how many kernels a first start compiles; `benchmarks/bench_start.py` counts them."""

COMPILING = "compiling kernel"
"""How a line of progress begins."""

PATIENCE, INTERVAL = 1.0, 0.1
"""How long kernels compile before anything is told, and between two tellings, in [s]."""


class Progress(NamedTuple):
    """Progress of the compilation in this process."""

    number: int
    """Of the kernel that is compiled now, from 1 on."""
    name: str
    """Its own."""
    duration: float
    """How long kernels were compiled so far, in [s]."""

    def __str__(self) -> str:
        return f"{COMPILING} {self.number} of about {max(USUAL, self.number)}"

    @property
    def is_kept(self) -> bool:
        """Whether the result is kept for the next start."""
        return True


class Work(NamedTuple):
    """Progress of a long piece of work with parts."""

    doing: str
    """What is done to each part, the kind of part last."""
    number: int
    """Of the part that is worked at now, from 1 on."""
    total: int
    """How many parts there are."""
    name: str
    """The part's own."""
    duration: float
    """How long it was worked so far, in [s]."""

    def __str__(self) -> str:
        return f"{self.doing} {self.number} of {self.total}: {self.name}"

    @property
    def is_kept(self) -> bool:
        """Whether the result is kept for the next start."""
        return False


Tell = Callable[[Progress | Work | None], None]
"""Is told the progress, and None where there is nothing to wait for any more."""


def show_on_terminal(progress: Progress | Work | None) -> None:
    """Show progress in one line on standard error if it is a terminal; remove it at the end."""
    with contextlib.suppress(OSError, ValueError, AttributeError):  # it may be gone
        if sys.stderr.isatty():
            text = "" if progress is None else f"armguard: {progress}"
            if progress is not None and progress.is_kept:
                text += ", once"
            sys.stderr.write(f"\r\x1b[K{text}")
            sys.stderr.flush()


class Compilation:
    """Counts the kernels that are compiled, and times them.

    Args:
        tell: Called with the progress.
        clock: In [s].

    Attributes:
        tell: Called with the progress; None: nothing is reported.
        count: Kernels that were compiled so far. A kernel that is read from a cache does not count.
    """

    def __init__(
        self, tell: Tell | None = show_on_terminal, clock: Callable[[], float] = time.perf_counter
    ) -> None:
        self.tell = tell
        self.count = 0
        self._clock = clock
        self._depth = 0
        self._before = 0.0
        """Duration of earlier compilations, in [s]."""
        self._since = self._told_at = 0.0
        self._has_told = False

    def begin(self, name: str) -> None:
        """Note that a kernel is compiled or read from a cache now, perhaps for another kernel."""
        now = self._clock()
        if self._depth == 0:
            self._since = now
        self._depth += 1
        duration = self._before + now - self._since
        if self.tell and duration >= PATIENCE and now >= self._told_at + INTERVAL:
            self.tell(Progress(self.count + self._depth, name, duration))
            self._has_told, self._told_at = True, now

    def end(self, is_compiled: bool) -> None:
        """Note that the kernel is there, or that its compilation has failed.

        Args:
            is_compiled: False: it was read from a cache.
        """
        self._depth -= 1
        self.count += is_compiled
        if self._depth == 0:
            if is_compiled:
                self._before += self._clock() - self._since
            if self._has_told and self.tell:
                self.tell(None)
            self._has_told = False


compilation = Compilation()
"""The compilation of this process."""


def follow(compiled: Any) -> None:
    """Count, report and time what Numba compiles of a function, and collect no garbage meanwhile.

    Args:
        compiled: Numba's dispatcher of the function.
    """
    compile_at_once = compiled.compile

    def compile_followed(kinds: Any) -> Any:
        if isinstance(kinds, tuple) and kinds in compiled.overloads:
            return compiled.overloads[kinds].entry_point
        before = _count_misses(compiled)
        compilation.begin(compiled.py_func.__name__)
        try:
            with pause_collection():
                return compile_at_once(kinds)
        finally:
            compilation.end(_count_misses(compiled) > before)

    compiled.compile = compile_followed


def _count_misses(compiled: Any) -> int:
    """How often a function was compiled because no cache had it."""
    return sum(compiled.stats.cache_misses.values())


@contextlib.contextmanager
def telling(tell: Tell | None) -> Iterator[None]:
    """Context in which `tell` is called with the progress of compilation and other long work."""
    before, compilation.tell = compilation.tell, tell
    try:
        yield
    finally:
        compilation.tell = before


@contextlib.contextmanager
def following(
    doing: str, total: int, clock: Callable[[], float] = time.perf_counter
) -> Iterator[Callable[[str], None]]:
    """Inside, the function that this hands out is called with each part's name before its turn.

    Args:
        doing: What is done to each part, the kind of part last.
        total: How many parts there are.
        clock: In [s].
    """
    start, number = clock(), 0

    def begin(name: str) -> None:
        nonlocal number
        number += 1
        if compilation.tell:
            compilation.tell(Work(doing, number, total, name, clock() - start))

    try:
        yield begin
    finally:
        if number and compilation.tell:
            compilation.tell(None)
