"""The laws that contact times obey: symmetries, looser bounds, ages, clocks, advances, shapes."""

from __future__ import annotations

import math

import numpy as np
import pytest

from armguard.contact import earliest_contact_pair
from support.contact_cases import CONVERGED, converged, ordinary_case


def _turned(case, rotation):
    vectors = {name: np.asarray(case[name]) @ rotation.T for name in ("p1", "v1", "p2", "v2")}
    return case | vectors


def _swapped(case):
    other = {"1": "2", "2": "1"}
    return {
        name[:-1] + other[name[-1]] if name[-1] in other else name: value
        for name, value in case.items()
    }


def _law_cases(seed, count=400):
    """Pairs that no speed bound is broken in, whose contact time is neither 0 nor inf."""
    rng = np.random.default_rng(seed)
    cases = []
    while len(cases) < count:
        case = ordinary_case(rng)
        for i in "12":
            speed = float(np.linalg.norm(case["v" + i])) - case["velocity_error" + i]
            case["s" + i] = max(case["s" + i], 1.01 * speed)
        if 0.0 < earliest_contact_pair(**case, advances=CONVERGED) < math.inf:
            cases.append(case)
    return cases


def test_rotation_exchange_and_units_change_nothing():
    rng = np.random.default_rng(3)
    cases = _law_cases(3)
    times = converged(cases)
    rotation, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    np.testing.assert_allclose(converged([_turned(c, rotation) for c in cases]), times, rtol=1e-9)
    np.testing.assert_allclose(converged([_swapped(c) for c in cases]), times, rtol=1e-9)
    length, time = 0.3048, 1e-3  # feet and milliseconds
    unit = {
        "p": length, "v": length / time, "a": length / time**2, "s": length / time,
        "velocity_error": length / time, "age": time, "clock_error": time,
        "contact_distance": length,
    }  # fmt: skip
    changed = [{n: v / unit[n.rstrip("12")] for n, v in case.items()} for case in cases]
    np.testing.assert_allclose(converged(changed) * time, times, rtol=1e-9)


def _is_slow(case, i):
    fastest = float(np.linalg.norm(case["v" + i])) + case["velocity_error" + i]
    return bool(case["s" + i] >= 1.5 * fastest)


@pytest.mark.parametrize(
    "name",
    [
        "a1", "a2", "s1", "s2", "contact_distance", "velocity_error1", "velocity_error2",
        "clock_error1", "clock_error2",
    ],
)  # fmt: skip
def test_looser_bounds_never_raise_the_time(name):
    """Speed bounds that are nearly met turn directions with them, at the cost of tightness only."""
    cases = [
        case
        for case in _law_cases(4, 800)
        if min(case["age1"], case["age2"]) >= 0.0 and all(_is_slow(case, i) for i in "12")
    ]
    assert len(cases) > 100
    times = converged(cases)
    for more in (1e-9, 0.01, 1.0):
        looser = converged([case | {name: case[name] + more} for case in cases])
        assert (looser <= times * (1.0 + 1e-9)).all()


def test_age_of_both_lowers_the_time_by_as_much():
    cases = _law_cases(5)
    times = converged(cases)
    for older in (0.003, 0.1):
        aged = converged(
            [c | {"age1": c["age1"] + older, "age2": c["age2"] + older} for c in cases]
        )
        assert (aged >= times - older - 1e-9).all()
        reached = times >= older
        np.testing.assert_allclose(aged[reached], times[reached] - older, rtol=1e-9, atol=1e-9)


def test_a_clock_error_covers_every_stamp_within_it():
    cases = _law_cases(14)
    for i in "12":
        lowest = converged([case | {"clock_error" + i: 0.02} for case in cases])
        for shift in (-0.02, -0.007, 0.004, 0.02):
            shifted = [
                case | {"age" + i: case["age" + i] + shift, "clock_error" + i: 0.0}
                for case in cases
            ]
            assert (lowest <= converged(shifted) * (1.0 + 1e-9)).all()
