"""A certificate ends in time, and stands only while its record allows what came after it."""

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from armguard.obstacles.reference_states import allows_reference_state, expire, keep_reference_state
from armguard.obstacles.table import Marks, make_states, resize_states

BOUNDS = ("radius", "accel", "speed")
ERRORS = ("position_error", "velocity_error")
ROW, PLACE = 2, 5


def marks_of(*, has_state):
    flags = [np.zeros(4, dtype=bool) for _ in range(6)]
    marks = Marks(*flags, *(np.zeros(4, dtype=np.int64) for _ in range(6)))
    marks.has_state[ROW] = has_state
    return marks


def random_bodies(seed, count=2):
    """States of which one row is filled, and room for reference states."""
    rng = np.random.default_rng(seed)
    bodies, reference_states = (resize_states(make_states(0), rows, 8) for rows in (4, 7))
    bodies.points[ROW, :count] = rng.normal(size=(count, 3))
    velocities = rng.normal(size=(count, 3))
    bodies.velocities[ROW, :count] = velocities
    bodies.point_count[ROW] = count
    bodies.radius[ROW] = rng.uniform(0.01, 0.5)
    bodies.accel[ROW] = rng.uniform(1.0, 10.0)
    bodies.speed[ROW] = np.linalg.norm(velocities, axis=1).max() * rng.uniform(1.0, 2.0)
    bodies.position_error[ROW] = rng.uniform(0.0, 0.02)
    bodies.velocity_error[ROW] = rng.uniform(0.0, 0.1)
    bodies.stamp[ROW] = rng.uniform(-1.0, 1.0)
    return rng, bodies, reference_states


times = st.floats(0.0, 1e7)


@given(times, st.one_of(times, st.floats(0.0, 1.0), st.just(5e-324)), times)
def test_what_is_left_of_a_certificate_is_never_more_than_was_proved(now, contact_time, wait):
    """Whenever it is asked for, however the difference rounds."""
    expiry = expire(now, contact_time)
    later = now + wait
    proved = Fraction(now) + Fraction(contact_time) - Fraction(later)
    assert Fraction(max(expiry - later, 0.0)) <= max(proved, 0)
    assert expiry >= now + contact_time - 1e-14 * (now + contact_time)


def test_never_is_never():
    assert expire(5.0, math.inf) == math.inf
    assert expire(0.0, 0.0) == 0.0


@pytest.mark.parametrize("count", [1, 2, 8])
def test_a_record_is_kept_whole_and_allows_itself(count):
    _, bodies, reference_states = random_bodies(count, count)
    keep_reference_state(bodies, reference_states, marks_of(has_state=True), ROW, PLACE)
    for body, reference_state in zip(bodies, reference_states, strict=True):
        assert np.array_equal(body[ROW], reference_state[PLACE])
        assert not reference_state[:PLACE].any()
    assert allows_reference_state(bodies, reference_states, ROW, PLACE) == (True, False)


def test_without_a_state_there_is_no_record_and_any_state_is_growth():
    _, bodies, reference_states = random_bodies(0)
    keep_reference_state(bodies, reference_states, marks_of(has_state=True), ROW, PLACE)
    keep_reference_state(bodies, reference_states, marks_of(has_state=False), ROW, PLACE)
    assert allows_reference_state(bodies, reference_states, ROW, PLACE) == (True, True)


@pytest.mark.parametrize("bound", BOUNDS)
def test_each_bound_may_shrink_and_not_grow(bound):
    _, bodies, reference_states = random_bodies(1)
    keep_reference_state(bodies, reference_states, marks_of(has_state=True), ROW, PLACE)
    array = getattr(bodies, bound)
    kept = array[ROW]
    array[ROW] = np.nextafter(kept, 0.0)
    assert allows_reference_state(bodies, reference_states, ROW, PLACE) == (True, False)
    array[ROW] = np.nextafter(kept, math.inf)
    assert allows_reference_state(bodies, reference_states, ROW, PLACE) == (True, True)
    # Growth by much is another description as well, never a broken bound.
    array[ROW] = kept + 1.0
    assert allows_reference_state(bodies, reference_states, ROW, PLACE) == (True, True)


@pytest.mark.parametrize("error", ERRORS)
def test_a_vaguer_state_takes_nothing_from_what_is_known(error):
    _, bodies, reference_states = random_bodies(1)
    keep_reference_state(bodies, reference_states, marks_of(has_state=True), ROW, PLACE)
    getattr(bodies, error)[ROW] += 1.0
    assert allows_reference_state(bodies, reference_states, ROW, PLACE) == (True, False)


@pytest.mark.parametrize("seed", range(20))
def test_motion_within_the_bounds_is_allowed_and_beyond_them_is_not(seed):
    """The farthest that a body can have come, a little less and a little more than that."""
    rng, bodies, reference_states = random_bodies(seed)
    keep_reference_state(bodies, reference_states, marks_of(has_state=True), ROW, PLACE)
    accel, speed = bodies.accel[ROW], bodies.speed[ROW]
    step = rng.uniform(1e-3, 0.5)
    direction = rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    velocities = reference_states.velocities[PLACE, :2]
    # Full acceleration, until the speed limit is reached by any of the points.
    top = np.linalg.norm(velocities, axis=1).max()
    ramp = min(step, max(speed - top, 0.0) / accel)
    faster = velocities + accel * ramp * direction
    bodies.points[ROW, :2] += velocities * ramp + 0.5 * accel * ramp**2 * direction
    bodies.points[ROW, :2] += faster * (step - ramp)
    bodies.velocities[ROW, :2] = faster
    bodies.stamp[ROW] += step
    assert allows_reference_state(bodies, reference_states, ROW, PLACE) == (True, False)
    slack = accel * step**2 + 2.0 * bodies.velocity_error[ROW] * step
    slack += 2.0 * bodies.position_error[ROW] + 1e-6
    bodies.points[ROW, 1] += slack * direction
    assert allows_reference_state(bodies, reference_states, ROW, PLACE) == (False, False)


def test_another_number_of_points_is_another_body():
    _, bodies, reference_states = random_bodies(3)
    keep_reference_state(bodies, reference_states, marks_of(has_state=True), ROW, PLACE)
    bodies.point_count[ROW] = 1
    allowed, _ = allows_reference_state(bodies, reference_states, ROW, PLACE)
    assert not allowed
