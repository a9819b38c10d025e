import coal
import numpy as np
import pytest

from armguard.cover.signed_distance import compute_signed_distances
from armguard.cover.triangulation import triangulate


@pytest.fixture(scope="module")
def box():
    return triangulate("box", coal.Box(0.2, 0.4, 0.6))


@pytest.fixture(scope="module")
def points():
    return np.random.default_rng(0).uniform(-0.5, 0.5, size=(3000, 3))


def distance_to_box(points):
    excess = np.abs(points) - [0.1, 0.2, 0.3]
    outside = np.linalg.norm(np.maximum(excess, 0.0), axis=1)
    return outside + np.minimum(excess.max(axis=1), 0.0)


def test_distances_to_a_box_are_exact(box, points):
    np.testing.assert_allclose(
        compute_signed_distances(points, box), distance_to_box(points), atol=1e-12
    )


def test_inverted_duplicate_and_missing_faces_leave_the_sides_right(box, points):
    expected = distance_to_box(points) < 0.0
    for surface in (box[:, ::-1], np.concatenate([box, box])):
        assert ((compute_signed_distances(points, surface) < 0.0) == expected).all()
    deep = distance_to_box(points) < -0.05
    assert (compute_signed_distances(points[deep], box[1:]) < 0.0).mean() > 0.9
    far = distance_to_box(points) > 0.1
    assert (compute_signed_distances(points[far], box[1:]) > 0.0).all()


@pytest.mark.parametrize(
    "corners",
    [
        [[0.1, 0.2, 0.3]] * 3,
        [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]],
        [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]],
    ],
)
def test_degenerate_triangles_are_segments_or_points(corners, points):
    triangle = np.array([corners])
    steps = np.linspace(0.0, 1.0, 2001)[:, None]
    line = triangle[0, 0] + steps * (triangle[0, 2] - triangle[0, 0])
    sampled = np.linalg.norm(points[:50, None] - line, axis=2).min(axis=1)
    distances = compute_signed_distances(points[:50], triangle)
    np.testing.assert_allclose(distances, sampled, atol=1e-3)
