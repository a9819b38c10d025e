import math

import numpy as np

from armguard.latency import Durations


def test_durations_are_kept_to_a_percent_and_the_longest_exactly():
    random = np.random.default_rng(0)
    values = 10.0 ** random.uniform(-6.0, 0.5, 20_000)
    durations = Durations()
    assert math.isnan(durations.percentile(50.0))
    for value in values:
        durations.add(float(value))
    assert durations.longest == values.max()
    for percent in (1.0, 50.0, 99.0, 99.9, 100.0):
        exact = np.percentile(values, percent, method="inverted_cdf")
        assert exact * (1 - 1e-9) <= durations.percentile(percent) <= exact * 1.012
    durations.add(0.0)
    durations.add(1e6)
    assert durations.percentile(100.0) == 1e6
