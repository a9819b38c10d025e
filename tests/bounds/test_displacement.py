"""How far one coordinate gets, against motions integrated step by step."""

from fractions import Fraction

import numpy as np
import pytest

from armguard.bounds.displacement import arrival, brake
from armguard.bounds.free_body import free_displacement
from armguard.robot.brakes import Stop


def integrate(rates, step):
    return np.concatenate([[0.0], np.cumsum(0.5 * (rates[1:] + rates[:-1]) * step)])


def exact_displacement(start, accel, top, s):
    """Of the fastest body, as rational numbers."""
    start, accel, top, s = (Fraction(float(part)) for part in (start, accel, top, s))
    start = min(start, top)
    ramp = min((top - start) / accel, s)
    return start * ramp + accel * ramp**2 / 2 + top * (s - ramp)


def test_displacements_are_rounded_up_and_arrivals_down():
    """In exact arithmetic, and by no more than rounding needs."""
    random = np.random.default_rng(0)
    for _ in range(3000):
        accel, top, room, s = 10.0 ** random.uniform(-3.0, 3.0, 4)
        start = top * random.choice([-3.0, -1e-6, 0.0, 0.3, 1.0, 2.0])
        exact, bound = (
            exact_displacement(start, accel, top, s),
            free_displacement(start, accel, top, s),
        )
        size = (abs(start) + top + accel * s) * s
        assert exact <= bound <= exact + 1e-11 * Fraction(size)
        time = arrival(start, accel, top, room)
        assert exact_displacement(start, accel, top, time) <= room
        assert exact_displacement(start, accel, top, time * (1.0 + 1e-11)) >= room * (1.0 - 1e-9)


def test_what_has_no_room_is_there_and_what_has_no_end_never_is():
    assert arrival(1.0, 1.0, 1.0, 0.0) == arrival(1.0, 1.0, 1.0, -3.0) == 0.0
    assert arrival(1.0, 1.0, 1.0, np.inf) == np.inf


@pytest.mark.parametrize("velocity", [-1.5, -0.2, 0.0, 0.2, 1.5])
def test_braking_is_slow_forwards_and_hard_backwards(velocity):
    accel, deceleration = 8.0, 2.0
    times = np.linspace(0.0, 2.0, 20_001)
    slows = deceleration if velocity > 0.0 else accel
    rates = np.sign(velocity) * np.maximum(abs(velocity) - slows * times, 0.0)
    stop = Stop(deceleration, np.inf, np.inf)
    found = [brake(velocity, accel, stop, s) for s in times[::500]]
    assert found == pytest.approx(integrate(rates, times[1])[::500], abs=1e-6)
    assert brake(velocity, accel, stop, 1e6) == pytest.approx(found[-1])
