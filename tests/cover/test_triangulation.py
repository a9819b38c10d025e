import coal
import numpy as np
import pytest

from armguard.cover.signed_distance import compute_signed_distances
from armguard.cover.triangulation import hull_triangles, triangulate
from armguard.exceptions import RobotError


def points_on(shape, count=2000):
    """Points on a round shape's surface."""
    generator = np.random.default_rng(5)
    points = generator.normal(size=(count, 3))
    points *= shape.radius / np.linalg.norm(points, axis=1, keepdims=True)
    if isinstance(shape, coal.Capsule):
        points[:, 2] += np.where(points[:, 2] > 0.0, shape.halfLength, -shape.halfLength)
    if isinstance(shape, coal.Cylinder):
        points[:, :2] *= shape.radius / np.linalg.norm(points[:, :2], axis=1, keepdims=True)
        points[:, 2] = generator.uniform(-1.0, 1.0, size=count) * shape.halfLength
    return points


@pytest.mark.parametrize(
    "shape", [coal.Sphere(0.05), coal.Cylinder(0.05, 0.2), coal.Capsule(0.05, 0.3)]
)
def test_round_shapes_are_contained_and_only_just(shape):
    distances = compute_signed_distances(points_on(shape), triangulate("tip", shape))
    assert (distances < 1e-12).all()
    assert (distances > -0.12 * shape.radius).all()


def test_boxes_are_exact():
    triangles = triangulate("tip", coal.Box(0.2, 0.4, 0.6))
    assert set(np.abs(triangles).reshape(-1, 3).max(axis=0)) == {0.1, 0.2, 0.3}
    sides = triangles[:, 1:] - triangles[:, :1]
    normals = np.cross(sides[:, 0], sides[:, 1])
    assert np.linalg.norm(normals, axis=1).sum() / 2 == pytest.approx(2 * (0.08 + 0.12 + 0.24))
    volume = np.einsum("ij,ij->i", triangles[:, 0], normals).sum() / 6
    assert volume == pytest.approx(0.2 * 0.4 * 0.6)  # so all faces are wound outwards


def test_a_hull_contains_its_points_and_is_wound_outwards():
    points = np.random.default_rng(1).normal(size=(300, 3))
    triangles = hull_triangles("cloud", points)
    assert (compute_signed_distances(points, triangles) < 1e-12).all()
    sides = triangles[:, 1:] - triangles[:, :1]
    normals = np.cross(sides[:, 0], sides[:, 1])
    heights = np.einsum("ij,nij->ni", normals, points[:, None] - triangles[:, 0])
    assert (heights < 1e-12).all()
    assert set(map(tuple, triangles.reshape(-1, 3))) <= set(map(tuple, points))


@pytest.mark.parametrize("count", [1, 3, 4])
def test_flat_points_have_no_hull(count):
    sheet = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])
    with pytest.raises(RobotError, match="sheet: has no convex hull"):
        hull_triangles("sheet", sheet[:count])


@pytest.mark.parametrize(
    ("shape", "key"),
    [
        (coal.Box(0.1, np.nan, 0.1), "halfSide"),
        (coal.Box(0.1, 0.1, -0.1), "halfSide"),
        (coal.Sphere(0.0), "radius"),
        (coal.Sphere(-1.0), "radius"),
        (coal.Cylinder(0.1, np.inf), "halfLength"),
    ],
)
def test_sizes_that_are_not_positive_and_finite_are_refused_by_name(shape, key):
    with pytest.raises(RobotError, match=f"tip: has {key} = "):
        triangulate("tip", shape)
