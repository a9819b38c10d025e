"""What every schedule refuses, and the protocol that all of them keep."""

import numpy as np
import pytest

from armguard.exceptions import ArmguardError
from armguard.scheduling.paper.arguments import read_contact_times, read_pairs

BAD_PAIRS = [[-1], [1.0], [[1]], 3, [2, 2], ["a"], [True], np.array([2**63], dtype=np.uint64)]


@pytest.mark.parametrize("pairs", BAD_PAIRS, ids=repr)
def test_bad_pair_numbers_are_refused(pairs):
    with pytest.raises(ArmguardError):
        read_pairs(pairs)


def test_pair_numbers_span_int64():
    largest = 2**63 - 1
    assert read_pairs([0, largest]).tolist() == [0, largest]
    assert read_pairs([]).dtype == np.int64
    assert read_pairs(np.array([1, 2], dtype=np.uint8)).dtype == np.int64


def test_doubtful_times_count_as_zero():
    times = read_contact_times([np.nan, -1.0, -np.inf, 0.5, np.inf], 5)
    assert times.tolist() == [0.0, 0.0, 0.0, 0.5, np.inf]
