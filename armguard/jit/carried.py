"""Compiled kernels in a wheel, so that a start from it compiles nothing.

They are made by `armguard kernels --carry` for a common level of processors, x86-64-v3 (AVX2 and
FMA: Intel's since 2013, AMD's since 2015), and lie in the package, in folders that are named by the
digest of all sources that they were made from. Beside that they hold for one minor version of
Python, one version of Numba and one operating system. What does not fit in any of these is not
found, and kernels are compiled for the processor at hand as ever.
"""

from __future__ import annotations

from pathlib import Path

CARRIED = Path(__file__).resolve().parents[1] / "kernels"
"""Where a wheel has them."""

PROCESSOR = "x86-64-v3"
"""LLVM's name for what they are made for."""

NEEDED = ("avx", "avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe", "popcnt", "xsave")
"""What such a processor has, by LLVM's names (x86-64 psABI, table of microarchitecture levels)."""


def describe_environment() -> dict[str, str]:
    """Variables under which a process compiles for `PROCESSOR`, into `CARRIED`."""
    return {
        "NUMBA_CPU_NAME": PROCESSOR,
        "NUMBA_CPU_FEATURES": "",
        "NUMBA_CACHE_DIR": str(CARRIED),
    }
