"""How far one coordinate gets, against motions integrated step by step."""

from fractions import Fraction

import numpy as np
import pytest

from armguard.bounds.displacement import arrival, brake, fill_displacements, fill_velocities
from armguard.bounds.free_body import free_displacement
from armguard.bounds.limits import JointLimits
from armguard.robot.brakes import Stop
from support.urdf_arms import hold


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


DT = 1e-3


def random_joints(random, count):
    """Limits and errors of joints, half of them near a stop, and how they truly are."""
    top, accel = random.uniform(0.3, 2.0, count), random.uniform(2.0, 20.0, count)
    room = random.uniform(0.02, 1.0, (2, count)) * random.choice([0.1, 1.0, np.inf], (2, count))
    limits = JointLimits(
        -room[0], room[1], top, accel, hold(accel * random.uniform(0.2, 1.0, count)),
        random.choice([0.0, 1e-3, 0.02], count), random.choice([0.0, 0.02, 0.2], count), top, accel,
    )  # fmt: skip
    return limits, np.zeros(count), top * random.uniform(-1.0, 1.0, count)


def move(random, limits, q, v, free, steps):
    """Displacements of joints that do as they like, and stop dead at their stops: (steps, n).

    They are free at first, and brake then.
    """
    top, accel, start = limits.velocity, limits.acceleration, q
    pushes = random.choice([-1.0, 1.0, 0.0], (3, len(q)), p=[0.45, 0.45, 0.1])
    turns = np.sort(random.uniform(0.0, 0.4, (2, len(q))), axis=0)
    held = limits.brakes.deceleration[:, 0]
    rate = held + random.choice([0.0, 1.0], len(q)) * (accel - held)
    turned = (DT * np.arange(steps)[:, None, None] > turns).sum(axis=1)
    pushes = np.take_along_axis(pushes, turned, axis=0) * accel * DT
    ways = np.zeros((steps, len(q)))
    for k in range(steps - 1):
        if k * DT < free - 1e-09:
            after = np.minimum(np.maximum(v + pushes[k], -top), top)
        else:
            after = np.sign(v) * np.maximum(np.abs(v) - rate * DT, 0.0)
        moved = q + 0.5 * DT * (v + after)
        q = np.minimum(np.maximum(moved, limits.lower), limits.upper)
        v = np.where(q == moved, after, 0.0)
        ways[k + 1] = q - start
    return ways


@pytest.mark.parametrize("age", [-0.05, 0.0, 0.03])
@pytest.mark.parametrize("free", [np.inf, 0.05, 0.1, 0.2, 0.3])
def test_no_joint_gets_further_whatever_stop_it_comes_back_from(age, free):
    random, closest = np.random.default_rng(2), np.zeros(2)
    time = 0.01 * np.arange(61)
    for _ in range(3):
        limits, true_q, true_v = random_joints(random, 1500)
        q = true_q + limits.position_error * random.choice([-1.0, 1.0], 1500)
        v = true_v + limits.velocity_error * random.choice([-1.0, 1.0], 1500)
        high, low = np.empty((2, len(time), 1500))
        highest, lowest = np.empty((2, 1500))
        fill_displacements(q, v, age, free, limits, time, high, low, highest, lowest)
        high, low = np.minimum(high, highest), np.maximum(low, lowest)
        slack = 1e-9 + limits.acceleration * DT**2
        # What was measured beyond a limit, by no more than its error, may be so.
        truly = limits._replace(
            lower=np.minimum(limits.lower, q),
            upper=np.maximum(limits.upper, q),
            velocity=np.maximum(limits.velocity, np.abs(v)),
        )
        at = np.rint((age + time) / DT).astype(int)
        after, before = at >= 0, at < 0
        for _ in range(5):
            ways = move(random, truly, true_q, true_v, free, at[-1] + 1)[at[after]]
            assert (ways <= high[after] + slack).all()
            assert (ways >= low[after] - slack).all()
            closest[0] = max(closest[0], (ways[-1] / np.maximum(high[-1], 0.05)).max())
            closest[1] = max(closest[1], (ways[-1] / np.minimum(low[-1], -0.05)).max())
        # As it may have come to where it was measured.
        came = true_v * (age + time[before])[:, None]
        inside = (truly.lower <= true_q + came) & (true_q + came <= truly.upper)
        assert (came <= high[before] + slack)[inside].all()
        assert (came >= low[before] - slack)[inside].all()
    assert (closest > 0.95).all()


def velocities_of(q, v, age, free, limits, time):
    fastest, slowest = np.empty((2, len(time), len(q)))
    fill_velocities(q, v, age, free, limits, time, fastest, slowest)
    return fastest, slowest


@pytest.mark.parametrize("age", [-0.05, 0.0, 0.03])
@pytest.mark.parametrize("free", [np.inf, 0.05, 0.2])
def test_velocities_bound_the_slopes_of_motions(age, free):
    """From a node on where joints brake, up to it where they never do."""
    random, closest = np.random.default_rng(3), 0.0
    time = 0.01 * np.arange(41)
    for _ in range(3):
        limits, true_q, true_v = random_joints(random, 1000)
        q = true_q + limits.position_error * random.choice([-1.0, 1.0], 1000)
        v = true_v + limits.velocity_error * random.choice([-1.0, 1.0], 1000)
        truly = limits._replace(
            lower=np.minimum(limits.lower, q),
            upper=np.maximum(limits.upper, q),
            velocity=np.maximum(limits.velocity, np.abs(v)),
        )
        fastest, slowest = velocities_of(q, v, age, free, limits, time)
        at = np.rint((age + time) / DT).astype(int)
        slack = 1e-9 + limits.acceleration * DT
        for _ in range(5):
            slopes = np.diff(move(random, truly, true_q, true_v, free, at[-1] + 2), axis=0) / DT
            for node in np.flatnonzero(at >= 0):
                part = slopes[: at[node]] if free == np.inf else slopes[at[node] :]
                if free == np.inf and age > 0.0:
                    part = slopes[at[0] : at[node]]
                assert (part <= fastest[node] + slack).all()
                assert (part >= slowest[node] - slack).all()
            closest = max(closest, (slopes[at[-1] // 2] / fastest[len(time) // 2].max()).max())
    assert closest > (0.95 if free == np.inf else 0.0)


@pytest.mark.parametrize("free", [np.inf, 0.0, 0.1])
def test_velocities_bound_more_the_longer_the_time_that_a_node_stands_for(free):
    random, time = np.random.default_rng(4), 0.01 * np.arange(61)
    limits, q, v = random_joints(random, 1000)
    for age in (-0.02, 0.0, 0.05):
        rise = 1.0 if free == np.inf else -1.0
        fastest, slowest = velocities_of(q, v, age, free, limits, time)
        assert (rise * np.diff(fastest, axis=0) >= 0.0).all()
        assert (rise * np.diff(slowest, axis=0) <= 0.0).all()
        assert (slowest <= fastest).all()
        top = np.maximum(limits.operating_velocity, np.abs(v)) * (1.0 + 1e-9)
        assert (fastest <= top).all()
        assert (slowest >= -top).all()
        if free < np.inf:
            rest = max(age, 0.0) + time[-1] + 100.0
            rested = velocities_of(q, v, age, free, limits, np.array([rest]))
            assert not np.any(rested)


@pytest.mark.parametrize("wrong", ["q", "v", "age", "free"])
@pytest.mark.parametrize("free", [np.inf, 0.1])
@pytest.mark.parametrize("number", [np.nan, -np.inf])
def test_what_is_no_number_may_have_any_velocity(wrong, free, number):
    limits, q, v = random_joints(np.random.default_rng(5), 4)
    given = {"q": q, "v": v, "age": 0.0, "free": free}
    given[wrong] = given[wrong] * np.nan if np.ndim(given[wrong]) else number
    fastest, slowest = velocities_of(*given.values(), limits, np.array([0.0, 0.1]))
    assert (fastest == np.inf).all()
    assert (slowest == -np.inf).all()
