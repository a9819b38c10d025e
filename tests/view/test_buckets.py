import math

import numpy as np
import pytest

from armguard.view import NO_BUCKET, compute_buckets
from armguard.view.buckets import (
    BUCKET_COUNT,
    NO_BUCKET_COLOUR,
    compute_colours,
    describe_buckets,
    format_colour,
)


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


def test_colours_go_from_red_to_grey_and_lightness_has_one_summit():
    colours = compute_colours(1e-3)[:BUCKET_COUNT].astype(float)
    assert colours[0, 0] > 0.9
    assert max(colours[0, 1:]) < 0.3
    assert np.ptp(colours[-1]) < 0.2
    lightness = colours @ [0.2126, 0.7152, 0.0722]
    steps = np.sign(np.diff(lightness))
    assert np.count_nonzero(np.diff(steps[steps != 0])) == 1


def test_a_colour_stands_for_a_time_whatever_the_rate():
    assert np.allclose(compute_colours(1e-3)[4:16], compute_colours(4e-3)[2:14], atol=1e-6)


def test_only_the_sixteen_are_on_the_scale():
    colours = compute_colours(1e-3)
    assert colours.shape == (256, 3)
    assert format_colour(colours[NO_BUCKET]) == NO_BUCKET_COLOUR


def test_the_legend_states_every_range_once():
    lines = describe_buckets(1e-3)
    starts = [start for _, _, start in lines]
    assert starts[0] == 0.0
    assert starts == sorted(set(starts))
    assert lines[0][0] == "under 128 ms"
    assert lines[1][0] == "128 to 256 ms"
    assert lines[-1][0].startswith("over")
    colours = compute_colours(1e-3)
    for _, code, start in lines:
        assert format_colour(colours[compute_buckets(start * 1.001, 1e-3)]) == code
