"""How long one direction keeps two bodies apart, against motions taken step by step."""

import math
from fractions import Fraction

import numpy as np
import pytest

from armguard.contact.bodies import Bounds
from armguard.contact.gap import (
    Approach,
    _step,
    are_bounds,
    clock_drift,
    direction,
    follow,
    later,
    limits,
    usable_accel,
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


def test_limits_hold_what_was_measured_to_be_faster():
    bounds = Bounds(5.0, 2.0, 0.1, 0.0)
    assert limits(0.6, 0.0, 0.8, bounds) == (2.0, pytest.approx(0.1))
    top, _ = limits(3.0, 0.0, 4.0, bounds)
    assert 5.1 <= top < 5.1 * (1.0 + 1e-12)
    assert limits(0.0, 0.0, 0.0, Bounds(math.inf, 2.0, 0.0, 0.0))[1] == math.inf
    assert math.isnan(limits(math.nan, 0.0, 0.0, bounds)[0])


def test_a_clock_that_is_off_lets_a_body_go_at_its_top_speed():
    bounds, none = Bounds(5.0, 2.0, 0.0, 0.0), Bounds(5.0, math.inf, 0.0, 0.0)
    assert clock_drift(1.0, 0.0, 0.0, bounds, 0.0) == 0.0
    drift = clock_drift(1.0, 0.0, 0.0, bounds, 0.01)
    assert 0.02 <= drift < 0.02 * (1.0 + 1e-12)
    assert clock_drift(1.0, 0.0, 0.0, none, 0.01) == math.inf
    assert math.isnan(clock_drift(1.0, 0.0, 0.0, none, math.nan))


@pytest.mark.parametrize("scale", [1e-300, 1e-160, 1.0, 1e160, 1e300])
def test_a_direction_has_its_length_at_every_scale(scale):
    x, y, z, inverse = direction(2.0 * scale, -3.0 * scale, 6.0 * scale)
    assert np.array([x, y, z]) * inverse == pytest.approx(np.array([2.0, -3.0, 6.0]) / 7.0)


def test_nothing_points_nowhere():
    for bad in (0.0, math.nan, math.inf):
        assert math.isnan(direction(bad, 0.0, 0.0)[3])


@pytest.mark.parametrize(
    "bounds",
    [
        (-1.0, 1.0, 0.0, 0.0),
        (1.0, -1.0, 0.0, 0.0),
        (1.0, 1.0, -1.0, 0.0),
        (1.0, 1.0, 0.0, math.inf),
        (math.inf, math.inf, 0.0, 0.0),
        (1.0, math.inf, math.inf, 0.0),
        *(tuple(math.nan if i == j else 1.0 for i in range(4)) for j in range(4)),
    ],
)
def test_what_does_not_hold_a_body_back_is_no_bound(bounds):
    assert are_bounds(Bounds(1.0, 1.0, 0.0, -0.1))
    assert are_bounds(Bounds(math.inf, 1.0, 0.0, 0.0))
    assert are_bounds(Bounds(1.0, math.inf, 0.0, 0.0))
    assert not are_bounds(Bounds(*bounds))


def test_no_acceleration_vanishes_and_none_is_without_end():
    assert usable_accel(math.inf) == usable_accel(-0.0) == 0.0
    assert usable_accel(5e-324) > 1e-300
    assert usable_accel(3.0) == 3.0


def test_time_never_runs_backwards_and_is_rounded_down():
    assert later(1.0, 0.0) == 1.0
    assert later(1.0, 1e-30) == 1.0
    assert 1.5 * (1.0 - 1e-14) < later(1.0, 0.5) < 1.5


@pytest.mark.parametrize("decades", [0.0, 3.0, 100.0])
def test_a_step_to_the_root_is_rounded_down(decades):
    """In exact arithmetic: the gap is still open where the step ends, and shut soon after."""
    random = np.random.default_rng(1)

    def is_open(gap, slope, accel, h):
        return gap - slope * h - accel * h * h / 2 > 0

    for _ in range(4000):
        gap, accel = 10.0 ** random.uniform(-decades, decades, 2) * random.uniform(1.0, 10.0, 2)
        slope = random.choice([-1.0, 0.0, 1.0]) * 10.0 ** random.uniform(-decades, decades)
        if random.random() < 0.2:
            accel, slope = 0.0, abs(slope)
        step = _step(gap, slope, accel)
        if step == math.inf:
            assert accel == slope == 0.0
            continue
        exact = [Fraction(part) for part in (gap, slope, accel, step)]
        assert is_open(*exact)
        assert step > 1e300 or not is_open(*exact[:3], exact[3] * (1 + Fraction(1, 10**14)))
