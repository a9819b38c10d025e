"""The bound on a free body, against motions integrated step by step and rational numbers."""

import math
from fractions import Fraction

import numpy as np
import pytest

from armguard.bounds.free_body import (
    displacement_at,
    free_displacement,
    length_above,
    saturation_time,
    top_speed,
)


def test_displacement_without_bounds():
    assert free_displacement(-1.0, np.inf, 2.0, 3.0) == pytest.approx(6.0)
    assert free_displacement(1.0, 2.0, np.inf, 3.0) == pytest.approx(12.0)


@pytest.mark.parametrize("s", [-0.3, -1e-9, 1e-9, 0.3, 2.0])
def test_displacement_before_the_stamp_is_that_of_the_opposite_motion(s):
    for closing, error in ((0.5, 0.1), (-0.5, 0.1), (0.0, 0.0)):
        found = displacement_at(closing, error, 2.0, 1.5, s)
        assert found == displacement_at(-closing, error, 2.0, 1.5, -s)
        start = math.copysign(1.0, s) * closing + error
        assert found == free_displacement(start, 2.0, 1.5, abs(s))


def test_a_body_is_where_it_was_measured_at_its_stamp():
    for bound in (0.0, 1.0, math.inf):
        assert displacement_at(0.5, 0.1, bound, bound, 0.0) == 0.0
    assert math.isnan(displacement_at(0.5, 0.1, 1.0, 2.0, math.nan))


def test_a_speed_is_rounded_up():
    random = np.random.default_rng(0)
    for x, y, z in random.normal(size=(500, 3)) * 10.0 ** random.uniform(-3.0, 3.0, (500, 1)):
        exact = sum(Fraction(float(part)) ** 2 for part in (x, y, z))
        found = length_above(x, y, z)
        assert Fraction(found) ** 2 >= exact
        assert found <= np.linalg.norm([x, y, z]) * (1.0 + 1e-11)


def test_a_speed_bound_holds_until_it_is_broken_by_more_than_the_error():
    assert top_speed(1.0, 1.5, 0.0) == 1.5
    assert top_speed(1.6, 1.5, 0.1) == 1.5
    assert top_speed(2.0, 1.5, 0.1) == 2.1
    assert top_speed(2.0, math.inf, 0.1) == math.inf
    assert math.isnan(top_speed(math.nan, 1.5, 0.1))


def test_a_body_saturates_when_it_may_have_its_top_speed():
    assert saturation_time(0.6, 0.0, 0.8, 2.0, 3.0) == pytest.approx(1.0)
    assert saturation_time(0.6, 0.0, 0.8, 2.0, 0.5) == 0.0
    assert saturation_time(0.6, 0.0, 0.8, 2.0, math.inf) == math.inf
    assert saturation_time(0.6, 0.0, 0.8, 0.0, 3.0) == math.inf
