"""The nearest point of a hull, against a search over all weights of its corners."""

import numpy as np
import pytest

from armguard.contact.gjk import distance_to_hull, nearest_on_hull


def nearest(origin, points, velocities=None, carry=0.0):
    corners, motions = np.zeros((8, 3)), np.zeros((8, 3))
    corners[: len(points)] = points
    if velocities is not None:
        motions[: len(points)] = velocities
    return np.array(nearest_on_hull(*origin, corners, motions, len(points), carry))


def search(points):
    """Frank and Wolfe's way to the point nearest to the origin: slow and simple."""
    weights = np.full(len(points), 1.0 / len(points))
    for _ in range(500):
        place = weights @ points
        towards = points[np.argmin(points @ place)] - place
        square = towards @ towards
        if not square > 0.0:
            break
        step = min(max(-(place @ towards) / square, 0.0), 1.0)
        weights *= 1.0 - step
        weights[np.argmin(points @ place)] += step
    return np.linalg.norm(weights @ points)


@pytest.mark.parametrize("count", range(1, 9))
def test_it_is_as_near_as_a_search_finds_and_a_plane_proves(count):
    random = np.random.default_rng(count)
    for _ in range(60):
        origin = random.normal(size=3)
        points = random.normal(size=(count, 3)) + random.normal(size=3) * 3.0
        distance = search(points - origin)
        if distance < 1e-2:  # as if the origin were inside
            continue
        found = nearest(origin, points)
        square = found @ found
        # No corner is behind the plane through the point found: nothing of the hull is nearer.
        assert ((points - origin) @ found).min() >= square * (1.0 - 1e-9)
        assert np.sqrt(square) <= distance * (1.0 + 1e-9)


def test_it_ends_inside_a_hull_too():
    box = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    for origin in np.random.default_rng(0).uniform(-1.0, 1.0, (200, 3)):
        assert np.isfinite(nearest(origin, box)).all()


def test_corners_are_carried_along_their_velocities():
    random = np.random.default_rng(0)
    points, velocities = random.normal(size=(2, 8, 3))
    points += 5.0
    carried = nearest((0.0, 0.0, 0.0), points, velocities, 0.3)
    assert carried == pytest.approx(nearest((0.0, 0.0, 0.0), points + 0.3 * velocities))


@pytest.mark.parametrize("count", range(1, 9))
def test_a_distance_is_never_too_much_and_nearly_enough(count):
    random = np.random.default_rng(count)
    still = np.zeros((8, 3))
    for _ in range(60):
        origin, corners = random.normal(size=3), np.zeros((8, 3))
        corners[:count] = random.normal(size=(count, 3)) + random.normal(size=3) * 2.0
        found = distance_to_hull(*origin, corners, still, count)[0]
        distance = search(corners[:count] - origin)
        assert 0.0 <= found <= distance * (1.0 + 1e-9) + 1e-12
        if distance > 1e-2:
            assert found == pytest.approx(np.linalg.norm(nearest(origin, corners[:count])))
