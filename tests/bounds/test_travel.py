"""How far one coordinate gets, against motions integrated step by step."""

from fractions import Fraction

import numpy as np
import pytest

from armguard.bounds.travel import arrival, brake, travel

CASES = [
    (start, accel, top)
    for start in (-2.0, -0.1, 0.0, 0.4, 1.5, 3.0)
    for accel in (1e-3, 0.7, 20.0)
    for top in (0.5, 2.0)
]


def integrate(rates, step):
    return np.concatenate([[0.0], np.cumsum(0.5 * (rates[1:] + rates[:-1]) * step)])


@pytest.mark.parametrize(("start", "accel", "top"), CASES)
def test_travel_is_the_integral_of_the_fastest_motion(start, accel, top):
    times = np.linspace(0.0, 4.0, 40_001)
    way = integrate(np.minimum(min(start, top) + accel * times, top), times[1])
    found = [travel(start, accel, top, s) for s in times[::500]]
    assert found == pytest.approx(way[::500], abs=1e-6)


def test_travel_without_bounds():
    assert travel(-1.0, np.inf, 2.0, 3.0) == pytest.approx(6.0)
    assert travel(1.0, 2.0, np.inf, 3.0) == pytest.approx(12.0)


@pytest.mark.parametrize(("start", "accel", "top"), CASES)
@pytest.mark.parametrize("room", [1e-9, 0.02, 1.0, 50.0])
def test_nothing_arrives_early_and_nothing_much_later(start, accel, top, room):
    time = arrival(start, accel, top, room)
    assert travel(start, accel, top, time) <= room * (1.0 + 1e-9) + 1e-9 * top * time
    assert travel(start, accel, top, time * (1.0 + 1e-6) + 1e-9) >= room * (1.0 - 1e-5)


def exact_way(start, accel, top, s):
    """Of the fastest body, as rational numbers."""
    start, accel, top, s = (Fraction(float(part)) for part in (start, accel, top, s))
    start = min(start, top)
    ramp = min((top - start) / accel, s)
    return start * ramp + accel * ramp**2 / 2 + top * (s - ramp)


def test_ways_are_rounded_up_and_arrivals_down():
    """In exact arithmetic, and by no more than rounding needs."""
    random = np.random.default_rng(0)
    for _ in range(3000):
        accel, top, room, s = 10.0 ** random.uniform(-3.0, 3.0, 4)
        start = top * random.choice([-3.0, -1e-6, 0.0, 0.3, 1.0, 2.0])
        exact, way = exact_way(start, accel, top, s), travel(start, accel, top, s)
        size = (abs(start) + top + accel * s) * s
        assert exact <= way <= exact + 1e-11 * Fraction(size)
        time = arrival(start, accel, top, room)
        assert exact_way(start, accel, top, time) <= room
        assert exact_way(start, accel, top, time * (1.0 + 1e-11)) >= room * (1.0 - 1e-9)


def test_what_has_no_room_is_there_and_what_has_no_end_never_is():
    assert arrival(1.0, 1.0, 1.0, 0.0) == arrival(1.0, 1.0, 1.0, -3.0) == 0.0
    assert arrival(1.0, 1.0, 1.0, np.inf) == np.inf


@pytest.mark.parametrize("velocity", [-1.5, -0.2, 0.0, 0.2, 1.5])
def test_braking_is_slow_forwards_and_hard_backwards(velocity):
    accel, deceleration = 8.0, 2.0
    times = np.linspace(0.0, 2.0, 20_001)
    slows = deceleration if velocity > 0.0 else accel
    rates = np.sign(velocity) * np.maximum(abs(velocity) - slows * times, 0.0)
    found = [brake(velocity, accel, deceleration, s) for s in times[::500]]
    assert found == pytest.approx(integrate(rates, times[1])[::500], abs=1e-6)
    assert brake(velocity, accel, deceleration, 1e6) == pytest.approx(found[-1])
