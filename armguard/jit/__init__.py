"""Compiled kernels and their common parts: cache, progress, handles, array layout, numerics.

Every kernel of armguard is compiled by `kernel`, which keeps it under a digest of all sources that
went into it, and many arrays cross to it at once by `pack`.
"""

from armguard.jit.arrays import BoolArray, FloatArray, IntArray
from armguard.jit.handle import pack
from armguard.jit.kernels import kernel
from armguard.jit.progress import Progress, Work, telling

__all__ = [
    "BoolArray",
    "FloatArray",
    "IntArray",
    "Progress",
    "Work",
    "kernel",
    "pack",
    "telling",
]
