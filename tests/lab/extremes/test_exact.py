import warnings
from fractions import Fraction

import mpmath
import numpy as np
import pytest

from armguard.lab.extremes.evaluations import make_free, make_head_on
from armguard.lab.extremes.exact import Course, FreePair, HeadOn


def find_root(first, second, distance):
    """The first contact by mpmath at 60 digits; None if there is none."""
    mpf = mpmath.mpf
    with mpmath.workdps(60):
        apart = [
            (mpf(float(q)) - mpf(float(p)) + mpf(float(w)) * second.age - mpf(float(v)) * first.age,
             mpf(float(w)) - mpf(float(v)))
            for p, v, q, w in zip(*first[:2], *second[:2], strict=True)
        ]  # fmt: skip
        reach = [mpf(distance), mpf(0), mpf(0)]
        for one in (first, second):
            half, age = mpf(one.accel) / 2, mpf(one.age)
            for k, value in enumerate((half * age**2, 2 * half * age, half)):
                reach[k] += value
        square = [
            sum(a * a for a, _ in apart), sum(2 * a * b for a, b in apart),
            sum(b * b for _, b in apart), mpf(0), mpf(0),
        ]  # fmt: skip
        for i, one in enumerate(reach):
            for j, other in enumerate(reach):
                square[i + j] -= one * other
        while square[-1] == 0:
            square.pop()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # newer ones want another order
            roots = mpmath.polyroots(square[::-1], maxsteps=500, extraprec=600)
        real = [root.real for root in roots if abs(root.imag) < mpf(10) ** -25 and root.real > 0]
        return min(real, default=None)


@pytest.mark.parametrize("age", [0.0, 60.0])
@pytest.mark.parametrize("accel", [1e-6, 1.0, 1e6])
def test_contacts_are_those_of_60_digits(accel, age):
    random = np.random.default_rng(1)
    for _ in range(15):
        case = make_free(random, accel=accel, age=age)
        pair = case.arguments
        courses = [
            Course(pair[f"p{k}"], pair[f"v{k}"], pair[f"a{k}"], pair[f"age{k}"]) for k in (1, 2)
        ]
        expected = find_root(*courses, pair["contact_distance"])
        found = case.exact.find_contact(1e9)
        assert found == pytest.approx(float(expected), rel=1e-12)
        assert case.exact.is_apart(found * (1 - 1e-9))
        assert not case.exact.is_apart(found * (1 + 1e-9))


def test_a_body_that_passes_by_never_touches():
    rests = Course((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0, 0.0)
    passes = Course((1.0, -1.0, 0.0), (0.0, 1.0, 0.0), 0.0, 0.0)
    assert FreePair(rests, passes, 0.999).find_contact(1e9) is None
    assert FreePair(rests, passes, 0.999).is_apart(1e9)
    # It grazes: a double root, which is contact.
    assert FreePair(rests, passes, 1.0).find_contact(1e9) == pytest.approx(1.0, rel=1e-12)
    assert not FreePair(rests, passes, 1.0).is_apart(1.0)
    assert FreePair(rests, passes, 1.5).find_contact(1e9) == 0.0


def test_a_body_runs_up_to_its_speed_and_no_faster():
    case = HeadOn(distance=5.0, pace=1.0, accel=2.0, speed=3.0)
    assert case.travel(Fraction(1)) == 2
    assert case.travel(Fraction(2)) == 5
    assert case.find_contact(1e3) == pytest.approx(2.0, rel=1e-12)
    assert case.is_apart(2.0)
    assert not case.is_apart(2.0 + 1e-9)
    assert case.find_contact(1.0) is None


def test_the_cases_are_apart_to_begin_with():
    random = np.random.default_rng(2)
    for age in (0.0, 1.0, 3600.0):
        assert all(make_free(random, age=age).exact.is_apart(0.0) for _ in range(20))
    assert all(make_head_on(random, 10.0).exact.is_apart(0.0) for _ in range(20))
