"""Kernels that a wheel carries, so that a start from it compiles none.

They are made by `armguard kernels --carry` for a common level of processors, x86-64-v3 (AVX2 and
FMA: Intel's since 2013, AMD's since 2015), and lie in the package, in folders that are named by the
digest of all sources that they were made from. Beside that they hold for one minor version of
Python, one version of Numba and one operating system. What does not fit in any of these is not
found, and kernels are compiled for the processor at hand as ever.
"""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any, NamedTuple

import llvmlite.binding
from numba.core import caching as numba_caching

# Numba's functions are untyped: they are called as anything is.
caching: Any = numba_caching

CARRIED = Path(__file__).resolve().parents[1] / "kernels"
"""Where a wheel has them."""

PROCESSOR = "x86-64-v3"
"""LLVM's name for what they are made for."""

NEEDED = ("avx", "avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe", "popcnt", "xsave")
"""What such a processor has, by LLVM's names (x86-64 psABI, table of microarchitecture levels)."""


class Target(NamedTuple):
    """Stands for what made a kernel, where Numba asks a code generator of its own."""

    triple: str
    """LLVM's name of architecture and operating system."""

    def magic_tuple(self) -> tuple[str, str, str]:
        """By which Numba's index knows code for this."""
        return self.triple, PROCESSOR, ""


def describe_environment() -> dict[str, str]:
    """Variables under which a process compiles for `PROCESSOR`, into `CARRIED`."""
    return {
        "NUMBA_CPU_NAME": PROCESSOR,
        "NUMBA_CPU_FEATURES": "",
        "NUMBA_CACHE_DIR": str(CARRIED),
    }


@functools.cache
def find_target() -> Target | None:
    """What carried kernels were made for, if this processor runs that; None: they do not fit."""
    triple = llvmlite.binding.get_process_triple()
    if not (CARRIED.is_dir() and triple.startswith("x86_64")):
        return None
    try:
        features = llvmlite.binding.get_host_cpu_features()
    except RuntimeError:  # LLVM does not know
        return None
    return Target(triple) if all(features.get(name, False) for name in NEEDED) else None


def open_carried(folder: Path, filename: str, stamp: str) -> Any:
    """Numba's interface to the carried files of one kernel, which need not exist.

    Args:
        folder: Of its module, within `CARRIED`.
        filename: How Numba calls the kernel's files.
        stamp: The one that they bear.
    """
    return caching.IndexDataCacheFile(str(CARRIED / folder), filename, stamp)
