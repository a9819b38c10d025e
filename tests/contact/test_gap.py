"""How long one direction keeps two bodies apart, against motions taken step by step."""

import numpy as np
import pytest

from armguard.contact.gap import (
    Approach,
    follow,
)


def advance(closing, margin, top, accel, age, t):
    """How far a body may come along its side by time t, from where it was at its stamp."""
    span = age + t
    start = min((closing if span >= 0.0 else -closing) + margin, top)
    ramp = min((top - start) / accel, abs(span))
    return start * ramp + 0.5 * accel * ramp**2 + top * (abs(span) - ramp)


def body(random):
    top, accel = random.uniform(0.5, 3.0), random.uniform(0.5, 20.0)
    return random.uniform(-1.0, 1.0) * top, random.uniform(0.0, 0.1), top, accel


@pytest.mark.parametrize("aged", [0.0, 0.05, 0.5])
def test_the_gap_is_open_up_to_the_time_reached_and_shut_after(aged):
    random = np.random.default_rng(0)
    reached = 0
    for _ in range(500):
        one, other = body(random), body(random)
        ages = random.uniform(-aged, aged, 2)
        along = random.uniform(0.01, 3.0)

        def gap(t, one=one, other=other, ages=ages, along=along):
            return along - advance(*one, ages[0], t) - advance(*other, ages[1], t)

        approaches = [
            Approach(closing, margin, top, accel, 1.0 / accel, age)
            for (closing, margin, top, accel), age in zip((one, other), ages, strict=True)
        ]
        time, _, _ = follow(along, along, 0.0, *approaches)
        if gap(0.0) <= 0.0:
            assert time == 0.0
            continue
        reached += 1
        assert min(gap(t) for t in np.linspace(0.0, time, 200)) > -1e-12
        # Back in time to a newer stamp, a chord stands in for the curve: safe, but a little early.
        if ages.min() >= 0.0:
            assert gap(time * (1.0 + 1e-9) + 1e-9) < 1e-7
    assert reached > 100
