"""Buckets of imminence: ranges of contact times, by which pairs are counted and coloured.

A pair belongs to bucket k = floor(log2(tau / dt)), clipped to 0 ... 15: every bucket is twice as
long as the one before.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

BUCKET_COUNT = 16


def compute_buckets(contact_times: ArrayLike, period: float) -> NDArray[np.uint8]:
    """The bucket of each contact time.

    Args:
        contact_times: Earliest contact, in [s]. NaN is unknown and counts as 0. Shape (...).
        period: One tick of the monitor, in [s].

    Returns:
        Buckets 0 (at once) to 15 (far off in time). Shape (...).
    """
    ticks = np.asarray(contact_times, dtype=np.float64) / period
    # An unknown time fails the comparison and becomes the most imminent.
    ticks = np.where(ticks >= 1.0, np.minimum(ticks, 2.0**BUCKET_COUNT), 1.0)
    # frexp is exact at powers of two, where a rounded log2 might not be.
    exponent = np.frexp(ticks)[1] - 1
    buckets: NDArray[np.uint8] = np.minimum(exponent, BUCKET_COUNT - 1).astype(np.uint8)
    return buckets


def count_buckets(contact_times: ArrayLike, period: float) -> NDArray[np.int64]:
    """Number of contact times in each bucket; see `compute_buckets`. Shape (16,)."""
    counts = np.bincount(compute_buckets(contact_times, period).ravel(), minlength=BUCKET_COUNT)
    return counts.astype(np.int64)
