"""What samples show beyond bounds, and which of them are of a body that has moved."""

from typing import NamedTuple

import numpy as np
import pytest

from armguard.jit import kernel, pack
from armguard.obstacles.broken_bounds import (
    BODY_LIMITS,
    FURTHER_SAMPLES,
    Breaks,
    begin_break,
    count_bounds,
    has_moved,
    make_breaks,
    measure_bounds,
)
from armguard.obstacles.table import States, extend_rows, make_states


class Two(NamedTuple):
    before: States
    after: States


class Story(NamedTuple):
    breaks: Breaks
    before: States
    after: States
    later: States


@kernel
def measure(handle):
    two = handle.content
    return measure_bounds(two.before, 0, two.after)


@kernel
def decide(handle, accel, speed):
    """Whether a body has moved by a break between two states and by a third one."""
    story = handle.content
    story.breaks.further[0] = 0
    begin_break(story.breaks, 0, story.before, 0, story.after, accel, speed)
    return has_moved(story.breaks, 0, story.later)


@kernel
def widen(handle, accel, speed):
    count_bounds(handle.content, accel, speed)


def make_state(stamp, points, velocities, *, error=0.0, slip=0.0):
    points = np.atleast_2d(points)
    states = make_states(2, 2)
    states.points[0, : len(points)], states.velocities[0, : len(points)] = points, velocities
    states.point_count[0], states.stamp[0] = len(points), stamp
    states.accel[0], states.speed[0] = 10.0, 2.0
    states.position_error[0], states.velocity_error[0] = error, slip
    return states


def with_errors(random, truth, error):
    """Off by no more than that."""
    noise = random.normal(size=truth.shape)
    norm = np.linalg.norm(noise, axis=-1, keepdims=True)
    return truth + error * random.random() * noise / norm


@pytest.mark.parametrize("seed", range(20))
def test_what_is_seen_is_never_more_than_what_a_body_did(seed):
    """Whatever errors hide: else a true motion could be taken for an error of measurement."""
    random = np.random.default_rng(seed)
    for _ in range(100):
        count, dt = random.integers(1, 3), random.uniform(0.002, 0.09)
        x, v = random.normal(size=(2, count, 3))
        push = random.normal(size=(count, 3)) * random.uniform(0.0, 100.0)
        accel = np.linalg.norm(push, axis=1).max()
        later = v + push * dt
        speed = max(np.linalg.norm(v, axis=1).max(), np.linalg.norm(later, axis=1).max())
        error, slip = random.choice([0.0, 0.01, 0.1], 2)
        states = [
            make_state(0.0, with_errors(random, x, error), with_errors(random, v, slip)),
            make_state(
                dt,
                with_errors(random, x + v * dt + 0.5 * push * dt**2, error),
                with_errors(random, later, slip),
            ),
        ]
        for one in states:
            one.position_error[0], one.velocity_error[0] = error, slip
        seen_accel, seen_speed = measure(pack(Two(*states)))
        assert seen_accel <= accel * (1.0 + 1e-6) + 1e-6
        assert seen_speed <= speed * (1.0 + 1e-6) + 1e-6
        if error == slip == 0.0:
            assert seen_accel == pytest.approx(accel, rel=1e-6)


@pytest.mark.parametrize(
    ("stamp", "points"),
    [(0.2, [0.0, 0, 0]), (0.0, [0.0, 0, 0]), (-0.01, [0.0, 0, 0]), (0.01, [[0.0, 0, 0]] * 2)],
)
def test_nothing_is_seen_where_samples_cannot_be_compared(stamp, points):
    before = make_state(0.0, np.zeros(3), np.zeros(3))
    assert measure(pack(Two(before, make_state(stamp, points, np.zeros(3))))) == (np.inf, np.inf)


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("dt", [0.005, 0.01, 0.033])
def test_a_body_that_goes_on_has_moved_and_one_that_jumped_has_not(seed, dt):
    """Whatever its velocity before, in whatever direction."""
    random = np.random.default_rng(seed)
    breaks = make_breaks()
    breaks = Breaks._make([extend_rows(array, 2) for array in breaks])
    v = random.normal(size=3) * 0.5
    push = random.normal(size=3)
    push *= random.uniform(20.0, BODY_LIMITS[1]) / np.linalg.norm(push)
    lasting = FURTHER_SAMPLES * dt
    before = make_state(0.0, np.zeros(3), v)
    step = v * dt + 0.5 * push * dt**2
    faster = v + push * dt
    after = make_state(dt, step, faster)
    # It keeps its velocity at least; or its velocity is what it was, as that of what only jumped.
    for along, moved in ((faster, True), (faster + 0.5 * push * lasting, True), (v, False)):
        later = make_state(dt + lasting, step + along * lasting, along)
        assert decide(pack(Story(breaks, before, after, later)), 10.0, 2.0) == moved


def test_what_is_no_number_is_not_widened_and_an_unknown_velocity_is_with_its_bound():
    state = make_state(0.0, np.zeros(3), 0.0)
    state.accel[0], state.speed[0], state.velocity_error[0] = np.nan, 2.0, 2.0
    widen(pack(state), 50.0, 4.0)
    assert np.isnan(state.accel[0])
    assert (state.speed[0], state.velocity_error[0]) == (4.0, 4.0)
    state.accel[0], state.velocity_error[0] = 10.0, 0.1
    widen(pack(state), 1e4, 200.0)
    assert (state.accel[0], state.speed[0], state.velocity_error[0]) == (np.inf, np.inf, 0.1)
