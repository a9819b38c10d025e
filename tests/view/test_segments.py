import numpy as np
import pytest

from armguard.view.segments import connect

BALLS = np.array([[0.0, 0.0, 0.0, 0.1], [1.0, 0.0, 0.0, 0.2]])


def test_a_line_ends_on_both_surfaces():
    line = connect(BALLS, np.array([[3.0, 0.0, 0.0]]), 0.5)
    assert np.allclose(line, [[1.2, 0.0, 0.0], [2.5, 0.0, 0.0]])


def test_of_a_capsule_the_nearest_place_on_its_axis_counts():
    line = connect(BALLS[:1], np.array([[1.0, -2.0, 0.0], [1.0, 2.0, 0.0]]), 0.25)
    assert np.allclose(line, [[0.1, 0.0, 0.0], [0.75, 0.0, 0.0]])


def test_bodies_that_overlap_are_joined_by_a_point():
    line = connect(BALLS[:1], np.array([[0.2, 0.0, 0.0]]), 0.5)
    assert np.array_equal(line[0], line[1])
    assert connect(BALLS[:1], np.array([[0.0, 0.0, 0.0]]), 0.5) == pytest.approx(0.0)


def sample_hull(points, count=60_000):
    """Random places in the hull of points."""
    weights = np.random.default_rng(0).dirichlet(np.full(len(points), 0.15), count)
    return weights @ points


def test_no_place_of_a_hull_is_nearer_than_the_end_of_its_line():
    random = np.random.default_rng(1)
    for _ in range(10):
        points = random.uniform(-0.5, 0.5, (int(random.integers(3, 9)), 3))
        points += [1.5, 0.3, 0.2]
        _, end = connect(BALLS[:1], points, 0.0)
        least = np.linalg.norm(sample_hull(points), axis=1).min()
        # Samples are in the hull, so none is nearer; some come close.
        assert np.linalg.norm(end) <= least + 1e-9
        assert np.linalg.norm(end) >= least - 0.05


def test_points_that_repeat_are_a_hull_too():
    line = connect(BALLS[:1], np.array([[2.0, 0.0, 0.0]] * 4), 0.5)
    assert np.allclose(line, [[0.1, 0.0, 0.0], [1.5, 0.0, 0.0]])
