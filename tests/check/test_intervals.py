import math
from fractions import Fraction

import mpmath
import pytest
from hypothesis import given
from hypothesis import strategies as st

from armguard_check.intervals import (
    BITS,
    UNBOUNDED,
    Interval,
    ProofError,
    cross,
    dot,
    greatest,
    least,
    read,
    read_bound,
    read_list,
    sine_and_cosine,
)

SCALE = 1 << BITS
NUMBERS = st.floats(-1e6, 1e6)


def holds(interval, value):
    return Fraction(interval.low, SCALE) <= value <= Fraction(interval.high, SCALE)


@given(NUMBERS, NUMBERS)
def test_results_hold_the_true_ones(a, b):
    x, y = read(a), read(b)
    exact_a, exact_b = Fraction(a), Fraction(b)
    wide_x = Interval(x.low - 5, x.high + 7)
    for one in (x, wide_x):
        assert holds(one + y, exact_a + exact_b)
        assert holds(one - y, exact_a - exact_b)
        assert holds(one * y, exact_a * exact_b)
        assert holds(-one, -exact_a)
        assert holds(abs(one), abs(exact_a))
        assert holds(greatest(one, y), max(exact_a, exact_b))
        assert holds(least(one, y), min(exact_a, exact_b))
        assert holds(one.over(7), exact_a / 7)
        if b > 1e-30:
            assert holds(one / y, exact_a / exact_b)
    root = abs(x).root()
    assert Fraction(root.low, SCALE) ** 2 <= abs(exact_a) <= Fraction(root.high, SCALE) ** 2


@given(st.floats(-100.0, 100.0))
def test_sines_and_cosines_are_enclosed_narrowly(angle):
    with mpmath.workdps(60):
        for found, true in zip(
            sine_and_cosine(read(angle)), (mpmath.sin(angle), mpmath.cos(angle)), strict=True
        ):
            assert found.low <= true * SCALE <= found.high
            assert found.high - found.low < SCALE >> 90


def test_what_is_no_number_is_refused():
    for value in (math.nan, math.inf, 2.0**64, 10**400, None, "1", True, "NaN", "Infinity", [1.0]):
        with pytest.raises(ProofError):
            read(value)
    assert read_bound("Infinity") is UNBOUNDED
    assert read_bound("-Infinity").high == -UNBOUNDED.low
    for values in ([1.0], [1.0, 2.0, 3.0], 2.0, None):
        with pytest.raises(ProofError):
            read_list(values, 2)


def test_nothing_is_divided_by_what_may_be_zero():
    with pytest.raises(ProofError):
        read(1.0) / Interval(-1, 1)


def test_a_turn_beyond_all_use_is_refused():
    with pytest.raises(ProofError):
        sine_and_cosine(read(1e9))


def test_products_of_vectors():
    a, b = (tuple(map(read, one)) for one in ([1.0, 2.0, 3.0], [-4.0, 0.5, 2.0]))
    assert holds(dot(a, b), 3)
    for found, true in zip(cross(a, b), (2.5, -14.0, 8.5), strict=True):
        assert holds(found, Fraction(true))
