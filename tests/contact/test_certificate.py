"""Certificates of the kernels against exact arithmetic, and the checker against forgeries.

ARMGUARD_CASES sets how many random pairs are certified and verified (default 4,000).
"""

from __future__ import annotations

import math
import os
from fractions import Fraction

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armguard.contact import Certificate, certify, earliest_contact_hull, verify
from armguard.contact.certificate import _floor, _root_bounds
from support.contact_cases import grazing_case, mixed_case, ordinary_case

CASES = int(os.environ.get("ARMGUARD_CASES", "4000"))
SEED = int(os.environ.get("ARMGUARD_SEED", "0"))

# Pairs that once were, or easily could be, answered wrongly.
HOSTILE = {
    "contact by one ulp": {"p2": [1.0, 0, 0], "contact_distance": np.nextafter(1.0, 0), "a2": 1.0},
    "contact exactly": {"p2": [3.0, 4.0, 0], "contact_distance": 5.0, "a2": 1.0},
    "no acceleration": {"p2": [1.0, 0.3, 0], "v2": [-1.0, 0.1, 0], "contact_distance": 0.5},
    "no speed": {"p2": [1.0, 1.0, 0], "a2": 9.0, "s2": 0.0, "contact_distance": 0.5},
    "at its speed bound": {"p2": [1.0, 1.0, 0], "v2": [-0.6, 0.8, 0], "a2": 9.0, "s2": 1.0},
    "bound broken by an ulp": {
        "p2": [1.0, 1.0, 0],
        "v2": [-1.0, 0, 0],
        "a2": 9.0,
        "s2": np.nextafter(1.0, 0),
        "velocity_error2": 0.0,
    },
    "receding": {"p2": [1.0, 1.0, 0], "v2": [9.0, 9.0, 0], "a2": 1.0, "s2": 13.0},
    "receding for ever": {"p2": [1.0, 1.0, 0], "v2": [9.0, 9.0, 0]},
    "near 1e-162": {"p2": [1e-162, 1e-162, 1e-162], "v2": [1e-162, 0, 0], "a2": 1e-162},
    "tiny, and very fast away": {"p2": [1e-150, 0, 0], "v2": [1e150, 1e149, 0], "a2": 1e-150},
    "smallest numbers": {"p2": [5e-324, 0, 0], "v2": [5e-324, 0, 0], "a2": 5e-324},
    "largest numbers": {"p2": [1.7e308, 0, 0], "v2": [-1.7e308, 0, 0], "a2": 1.7e308},
    "no acceleration bound": {"p2": [1.0, 2.0, 0], "v2": [0.1, 0, 0], "a2": math.inf, "s2": 2.0},
    "no bound at all": {"p2": [1.0, 2.0, 0], "a2": math.inf},
    "old and new": {
        "p2": [1.0, 2.0, 0],
        "v1": [1.0, 0, 0],
        "v2": [0, -1.0, 0],
        "a1": 5.0,
        "a2": 2.0,
        "s1": 2.0,
        "s2": 1.5,
        "age1": -0.4,
        "age2": 0.1,
    },
    "both newer than now": {
        "p2": [1.0, 2.0, 0],
        "v1": [1.0, 0, 0],
        "v2": [0, -1.0, 0],
        "a1": 5.0,
        "a2": 2.0,
        "s1": 2.0,
        "s2": 1.5,
        "age1": -0.4,
        "age2": -0.7,
        "velocity_error1": 0.1,
        "velocity_error2": 0.2,
    },
    "newer by more than products can hold": {
        "p2": [1.0, 2.0, 2.0],
        "v1": [0, 1.0, 0],
        "s1": 1e-280,
        "age1": -1.7e308,
        "a2": math.inf,
        "s2": 1e200,
    },
    "contact at a subnormal time": {
        "p2": [-8.33322001e-164, -1.74343361e-164, 9.96369303e-163],
        "v2": [-1.94305286e152, 4.60285908e151, -4.03270163e152],
        "a2": 9e152,
        "s2": 5e-163,
        "velocity_error2": 4e-6,
    },
    "contact at a subnormal time, without acceleration bounds": {
        "v1": [3.19207345e257, 2.13995342e258, -8.74114072e257],
        "a1": math.inf,
        "s1": 2.14e258,
        "p2": [3.56921799e-62, 4.67882534e-62, -6.84796565e-63],
        "contact_distance": 4.65533992229501e-62,
    },
    "faster than a float can tell": {"p2": [1.0, 1.0, 1.0], "v2": [-1.7e308] * 3, "a2": 1.0},
    "speed not known": {
        "p2": [1.0, 2.0, 0],
        "v2": [0.1, 0, 0],
        "a2": 1.0,
        "s2": 2.0,
        "velocity_error2": math.inf,
    },
    "never, but for a bend later than floats can tell": {
        "a1": math.inf,
        "s1": 0.0,
        "p2": [0.65919492, 0.03465725, -0.75117304],
        "v2": [1.31276521e-311, 2.17447782e-311, 9.67203669e-311],
        "s2": 1e-280,
    },
    "clocks off": {
        "p2": [1.0, 2.0, 0],
        "v1": [0.3, 0, 0],
        "a1": 3.0,
        "s1": 1.0,
        "v2": [-0.1, 0.2, 0],
        "a2": 1.0,
        "s2": 0.1,
        "clock_error1": 0.02,
        "clock_error2": 0.1,
    },
    "clock off, without speed bound": {"p2": [1.0, 2.0, 0], "a2": 1.0, "clock_error2": 1e-300},
    "capsule": {"p2": [[1.0, -5.0, 0], [1.0, 5.0, 0]], "a2": 1.0, "contact_distance": 0.3},
    "flat box": {
        "p2": [[1.0, y, z] for y in (-1, 1) for z in (-1, 1)] * 2,
        "a2": 1.0,
        "s1": 1.0,
        "a1": 1.0,
    },
    "points in one place": {"p2": [[1.0, 1.0, 1.0]] * 8, "a2": 1.0},
    "inside a box": {
        "p2": [[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)],
        "a2": 1.0,
    },
    "spinning rod": {
        "p2": [[1.0, -1, 0], [1.0, 1, 0]],
        "v2": [[-1, 0, 0], [1, 0, 0]],
        "a2": 1.0,
        "s2": 2.0,
    },
}


def _filled(case):
    still = {"v1": np.zeros(3), "v2": np.zeros(np.shape(case["p2"]))}
    bounds = {"a1": 0.0, "s1": math.inf, "a2": 0.0, "s2": math.inf, "contact_distance": 0.0}
    return {"p1": np.zeros(3)} | still | bounds | case


@pytest.mark.parametrize("name", HOSTILE)
@pytest.mark.parametrize("advances", [1, 2, 8, 60])
def test_hostile_pairs_are_certified(name, advances):
    case = _filled(HOSTILE[name])
    assert verify(certify(**case, advances=advances), **case)


def test_what_the_hostile_pairs_give():
    def time(name):
        return certify(**_filled(HOSTILE[name])).contact_time

    for name in (
        "contact exactly", "largest numbers", "no bound at all", "inside a box",
        "clock off, without speed bound", "contact at a subnormal time",
    ):  # fmt: skip
        assert time(name) == 0.0, name
    assert time("clocks off") > 0.1
    assert time("speed not known") == pytest.approx(math.sqrt(5) / 2)
    for name in ("no speed", "receding for ever"):
        assert time(name) == math.inf, name
    large = {"p2": np.ones(3), "v2": [1.0, 0, 0], "a2": 1.0}
    assert time("near 1e-162") == pytest.approx(certify(**_filled(large)).contact_time, rel=1e-12)
    assert time("no acceleration bound") == pytest.approx(math.sqrt(5) / 2)
    assert time("flat box") == pytest.approx(1.0)  # together for 0.5 m and 0.5 m


def test_random_pairs_are_certified():
    rng = np.random.default_rng(SEED)
    proved = 0
    for _ in range(CASES):
        case = mixed_case(rng)
        certificate = certify(**case, advances=int(rng.integers(1, 12)))
        assert verify(certificate, **case), case
        proved += certificate.contact_time > 0.0
    assert proved > CASES / 2


def test_certified_time_is_the_kernels_to_the_bit():
    rng = np.random.default_rng(1)
    for _ in range(300):
        case = mixed_case(rng)
        whole = case | {"p2": np.atleast_2d(case["p2"]), "v2": np.atleast_2d(case["v2"])}
        assert certify(**case).contact_time == earliest_contact_hull(**whole)


def test_forgeries_are_refused():
    rng = np.random.default_rng(2)
    tried = 0
    while tried < 200:
        case = grazing_case(rng) if tried % 2 else ordinary_case(rng, 1 + tried % 3)
        case["clock_error2"] = 0.0  # the kernel adds that of the fastest corner to all of them
        certificate = certify(**case, advances=40)
        time, times, directions = certificate
        if not 0.0 < time < math.inf:
            continue
        tried += 1
        later = Certificate(time * (1.0 + 1e-6), times, directions)
        assert not verify(later, **case)
        assert not verify(Certificate(math.inf, times, directions), **case)
        assert not verify(Certificate(math.nan, times, directions), **case)
        assert not verify(Certificate(time, times, -directions), **case)
        assert not verify(Certificate(time, times, 0.0 * directions), **case)
        assert not verify(Certificate(time, times + time, directions), **case)
        assert not verify(Certificate(time, times[:0], directions[:0]), **case)
        assert not verify(certificate, **case | {"contact_distance": 1e6})
        assert not verify(certificate, **case | {"contact_distance": math.nan})
        assert not verify(certificate, **case | {"a1": -1.0})
        assert not verify(certificate, **case | {"p1": [math.nan, 0.0, 0.0]})


def _last_gap(case, direction, time):
    """The gap of one direction at `time`, to 60 digits, by the formulas for two free balls."""
    mpf = mpmath.mpf
    n = [mpf(c) for c in direction.tolist()]
    length = mpmath.sqrt(sum(c * c for c in n))

    def advance(v, sign, i):
        v = [mpf(c) for c in np.asarray(v).tolist()]
        error, top = mpf(case["velocity_error" + i]), mpf(case["s" + i])
        size = mpmath.sqrt(sum(c * c for c in v))
        top = top if size - error <= top else size + error
        s = mpf(case["age" + i]) + mpf(time)
        along = sign * sum(a * b for a, b in zip(n, v, strict=True)) / length
        start = min(top, (along if s >= 0 else -along) + error)
        s, accel = abs(s), mpf(case["a" + i])
        drift = mpf(case["clock_error" + i])
        drift = top * drift if drift else drift
        if start == top or accel == mpmath.inf:
            return top * s + drift
        if accel == 0 or s <= (top - start) / accel:
            return start * s + accel * s * s / 2 + drift
        until = (top - start) / accel
        return (start + top) * until / 2 + top * (s - until) + drift

    apart = [mpf(b) - mpf(a) for a, b in zip(case["p1"].tolist(), case["p2"].tolist(), strict=True)]
    gap = sum(a * b for a, b in zip(n, apart, strict=True)) / length - mpf(case["contact_distance"])
    return gap - advance(case["v1"], 1, "1") - advance(case["v2"], -1, "2")


def test_the_checker_is_sharp_to_the_last_bit():
    """It takes the very last float before the last direction's root, and not the next."""
    rng = np.random.default_rng(15)
    tried = 0
    with mpmath.workdps(60):
        while tried < 150:
            case = grazing_case(rng) if tried % 2 else ordinary_case(rng)
            certificate = certify(**case, advances=1 + tried % 5)
            low = certificate.contact_time
            if not 0.0 < low < math.inf:
                continue
            high = 2.0 * low
            direction = certificate.witnesses[-1]
            if _last_gap(case, direction, high) >= 0:
                continue
            tried += 1
            while np.nextafter(low, high) < high:
                middle = 0.5 * (low + high)
                if _last_gap(case, direction, middle) >= 0:
                    low = middle
                else:
                    high = middle
            assert verify(certificate._replace(contact_time=low), **case)
            assert not verify(certificate._replace(contact_time=high), **case)


def test_every_direction_takes_over_before_the_time_that_is_claimed():
    """One that comes later has no part in the proof: such a certificate is malformed."""
    rng = np.random.default_rng(17)
    tried = 0
    while tried < 100:
        case = ordinary_case(rng, 1 + tried % 3)
        certificate = certify(**case, advances=40)
        time, times, directions = certificate
        if not 0.0 < time < math.inf or len(times) < 3:
            continue
        tried += 1
        for claimed in (times[-1], 0.5 * (times[-2] + times[-1]), times[1], 0.5 * times[1]):
            assert not verify(Certificate(claimed, times, directions), **case)
            # Without what comes too late, the claim is as good as the greater one.
            kept = times < claimed
            assert verify(Certificate(claimed, times[kept], directions[kept]), **case)


def test_roots_and_quotients_are_between_their_bounds():
    """Of all magnitudes, squares among them: on the right side, and by no more than 2**-150 off."""
    rng, close = np.random.default_rng(18), Fraction(1, 2**150)
    for _ in range(500):
        value = Fraction(*(int(part) + 1 for part in rng.integers(0, 2**62, 2)))
        value = (value * Fraction(2) ** int(rng.integers(-900, 900))) ** int(rng.integers(1, 3))
        low, high = _root_bounds(value)
        assert low**2 <= value <= high**2
        assert high <= low * (1 + close)
        for quotient in (value, -value):
            assert quotient - close * value <= _floor(quotient) <= quotient


EXTREME = st.floats(-1e150, 1e150) | st.floats(-2.0, 2.0) | st.floats(-1e-140, 1e-140)
VECTOR = st.tuples(EXTREME, EXTREME, EXTREME)
BOUND = EXTREME.map(abs) | st.just(math.inf)


@settings(max_examples=int(os.environ.get("ARMGUARD_EXAMPLES", "300")), derandomize=True)
@given(
    case=st.fixed_dictionaries(
        {
            "p1": VECTOR, "v1": VECTOR, "a1": BOUND, "s1": BOUND,
            "p2": VECTOR, "v2": VECTOR, "a2": BOUND, "s2": BOUND,
            "contact_distance": EXTREME.map(abs), "age1": EXTREME, "age2": EXTREME,
            "velocity_error1": BOUND, "velocity_error2": BOUND,
            "clock_error1": EXTREME.map(abs), "clock_error2": EXTREME.map(abs),
        }
    ),
    advances=st.integers(1, 20),
)  # fmt: skip
def test_no_counter_example_is_found(case, advances):
    assert verify(certify(**case, advances=advances), **case)
