"""Checks the arguments of all schedules.

A schedule that quietly took a pair twice, or a result for the wrong pair, would leave another one
without a look. So numbers are checked before anything changes, and a doubtful time counts as 0.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from armguard.exceptions import ArmguardError
from armguard.jit.arrays import FloatArray, IntArray


def read_pairs(pairs: ArrayLike) -> IntArray:
    """Pair numbers as an int64 array of their own. Shape (n,).

    Raises:
        ArmguardError: They are not a list of whole, non-negative numbers, or one comes twice.
    """
    given = np.asarray(pairs)
    if given.ndim != 1 or (given.size and given.dtype.kind not in "iu"):
        raise ArmguardError(
            "pairs", f"array of {given.dtype} with shape {given.shape}", expected="integers, (n,)"
        )
    numbers = given.astype(np.int64)
    if numbers.size and not numbers.min() >= 0:
        raise ArmguardError("pairs", f"number {given.min()}", expected="0 or more, within int64")
    if np.unique(numbers).size != numbers.size:
        raise ArmguardError("pairs", "a number comes twice in one call", expected="each once")
    return numbers


def read_contact_times(contact_times: ArrayLike, count: int) -> FloatArray:
    """Times in [s] as a float64 array, with 0 for NaN and for what is negative. Shape (count,).

    Raises:
        ArmguardError: There are not exactly `count` of them.
    """
    times = np.asarray(contact_times, dtype=np.float64)
    if times.shape != (count,):
        raise ArmguardError(
            "contact_times",
            f"shape {times.shape}",
            expected=f"({count},), one for each pair that due() returned",
        )
    return np.where(times > 0.0, times, 0.0)


def refuse_known(number: int) -> ArmguardError:
    """The error for a pair that is inserted while it is there."""
    return ArmguardError(f"pair {number}", "is already scheduled", remedy="remove it first")


def refuse_unknown(number: int) -> ArmguardError:
    """The error for a pair that is not there."""
    return ArmguardError(f"pair {number}", "is not scheduled", remedy="insert it first")


def refuse_settle() -> ArmguardError:
    """The error for results that nobody asked for."""
    return ArmguardError(
        "settle", "no pairs are out for evaluation", remedy="call due() first, then settle() once"
    )
