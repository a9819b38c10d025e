import math

import numpy as np
import pytest

from armguard.view import compute_buckets
from armguard.view.buckets import BUCKET_COUNT, count_buckets


@pytest.mark.parametrize("period", [1e-3, 2**-10, 0.05])
def test_a_bucket_is_the_rounded_down_logarithm(period):
    for k in range(BUCKET_COUNT):
        inside = period * 2.0**k * np.array([1.0 + 1e-9, 1.5, 2.0 - 1e-9])
        assert compute_buckets(inside, period).tolist() == [k] * 3


def test_powers_of_two_begin_a_bucket_exactly():
    assert compute_buckets(2.0 ** np.arange(16), 1.0).tolist() == list(range(16))


def test_what_is_unknown_is_imminent_and_what_is_far_is_clipped():
    times = [math.nan, -1.0, -math.inf, 0.0, 1e-9, 1e6, math.inf]
    assert compute_buckets(times, 1e-3).tolist() == [0, 0, 0, 0, 0, 15, 15]
    assert compute_buckets(np.zeros((2, 3)), 1e-3).shape == (2, 3)


def test_counts_are_those_of_the_buckets():
    counts = count_buckets([0.0, 0.5e-3, 1.5e-3, 3e-3, 3.5e-3, math.inf], 1e-3)
    assert counts[0] == 3
    assert counts[1] == 2
    assert counts[15] == 1
    assert count_buckets([], 1e-3).tolist() == [0] * BUCKET_COUNT
