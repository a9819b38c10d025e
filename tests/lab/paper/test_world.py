import numpy as np
import pytest

from armguard.lab.paper.world import FASTEST, PACE, RADIUS, World
from support.quartic import smallest_root


def test_contact_times_are_the_smallest_roots_of_the_quartic():
    world = World(12, 0.05, 1)
    times, distances = world.compute_contact_times(), world.compute_distances()
    assert times.shape == distances.shape == (world.pairs,) == (66,)
    pairs = [(i, j) for i in range(12) for j in range(i + 1, 12)]
    compared = 0
    for pair, (i, j) in enumerate(pairs):
        x = world._position[j] - world._position[i]
        assert distances[pair] == pytest.approx(np.linalg.norm(x))
        if distances[pair] > 2 * RADIUS:
            v = world._velocity[j] - world._velocity[i]
            expected = smallest_root(x, v, 2 * RADIUS, world._accel[i] + world._accel[j])
            assert times[pair] == pytest.approx(expected, rel=1e-6)
            compared += 1
    assert compared > 50


def test_balls_keep_to_their_bounds_and_to_their_hall():
    world = World(30, 0.05, 3)
    for _ in range(400):
        place, pace = world._position.copy(), world._velocity.copy()
        world.step()
        change = np.linalg.norm(world._velocity - pace, axis=1)
        assert (change <= world._accel * world.period * (1 + 1e-12)).all()
        mean = 0.5 * (pace + world._velocity)
        np.testing.assert_allclose(world._position - place, mean * world.period, atol=1e-12)
    # Beyond the walls they brake as hard as they may: v²/2A, give or take a period.
    away = np.abs(world._position).max() - world._half
    assert away < (PACE + FASTEST) ** 2 / (2 * 0.3) + 1.0
    assert np.linalg.norm(world._velocity, axis=1).max() < 3 * PACE


def test_no_contact_is_sooner_than_it_was_said():
    world = World(25, 0.05, 4)
    said = world.compute_contact_times()
    for tick in range(1, 60):
        world.step()
        touching = world.compute_distances() <= 2 * RADIUS
        assert (said[touching] <= tick * world.period + 1e-9).all()
