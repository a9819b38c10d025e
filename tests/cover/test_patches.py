import coal
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armguard.cover.containment import is_contained
from armguard.cover.patches import (
    ON_SURFACE,
    bisect_pieces,
    compute_corners,
    compute_hull_points,
    drop_nothing,
    measure_sides,
    swell_nothing,
)
from armguard.cover.sphere_tree import MARGIN, SphereTree
from armguard.cover.triangulation import make_patches, triangulate
from support.round_surfaces import distance_from_core, half_length, surface_points

SHAPES = [coal.Sphere(0.05), coal.Capsule(0.03, 0.2), coal.Capsule(0.2, 0.01)]


def patches_of(shape):
    return make_patches(shape, triangulate("tip", shape))


def draw_from(patches, count, seed=0):
    """Points of each patch, from its definition. Shape (n, count, 3)."""
    generator = np.random.default_rng(seed)
    core = generator.dirichlet(np.ones(3), size=(len(patches), count)) @ patches[:, :, :3]
    swelling = generator.dirichlet(np.ones(3), size=(len(patches), count)) @ patches[:, :, 3:]
    length = np.linalg.norm(patches[:, :1, 3:], axis=2, keepdims=True)
    return core + length * swelling / np.linalg.norm(swelling, axis=2, keepdims=True)


def one_ball(center, radius):
    return SphereTree(np.array([[*center, radius]]), np.zeros(1, int), np.zeros(1, int))


def solve_hull(points, target):
    """Whether a point is in the hull of few: no direction separates it."""
    directions = np.random.default_rng(3).normal(size=(2000, 3))
    directions = np.concatenate([directions, points - target, target - points.mean(axis=0)[None]])
    return ((directions @ (points - target).T).max(axis=1) >= -1e-12).all()


@pytest.mark.parametrize("shape", SHAPES)
def test_patches_are_the_surface_and_all_of_it(shape):
    patches = patches_of(shape)
    np.testing.assert_allclose(distance_from_core(draw_from(patches, 20), shape), shape.radius)
    np.testing.assert_allclose(distance_from_core(compute_corners(patches), shape), shape.radius)
    # Every point of the surface is in the cone of a patch, over a core that reaches it.
    core, cones = patches[:, :, 2], patches[:, :, 3:].transpose(0, 2, 1)
    inverses = np.linalg.pinv(cones)
    for point in surface_points(shape, 200):
        axis = np.clip(point[2], -half_length(shape), half_length(shape))
        reaches = (core.min(axis=1) - 1e-12 <= axis) & (axis <= core.max(axis=1) + 1e-12)
        outwards = point - [0.0, 0.0, axis]
        weights = inverses @ outwards
        rest = (cones @ weights[:, :, None])[:, :, 0] - outwards
        is_in = (weights >= -1e-9).all(axis=1) & (np.abs(rest).max(axis=1) < 1e-12)
        assert (reaches & is_in).any(), point


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("cuts", [0, 1, 5])
def test_a_patch_is_in_the_hull_of_its_points(shape, cuts):
    patches = patches_of(shape)
    for _ in range(cuts):
        patches = bisect_pieces(patches[:60])
    patches = patches[:40]
    hulls = compute_hull_points(patches)
    on_surface = distance_from_core(hulls[:, :ON_SURFACE], shape)
    np.testing.assert_allclose(on_surface, shape.radius)
    for hull, points in zip(hulls, draw_from(patches, 4), strict=True):
        assert all(solve_hull(hull, point) for point in points)


@pytest.mark.parametrize("shape", SHAPES)
def test_one_ball_is_proved_exactly_where_it_holds_the_shape(shape):
    for center in ([0.0, 0.0, 0.0], [0.01, -0.02, 0.005]):
        ends = np.array([[0.0, 0.0, half_length(shape)], [0.0, 0.0, -half_length(shape)]])
        needed = np.linalg.norm(ends - center, axis=1).max() + shape.radius
        patches = patches_of(shape)
        assert is_contained(patches, one_ball(center, needed + MARGIN + 1e-5))
        assert not is_contained(patches, one_ball(center, needed - 1e-5))


@given(st.integers(0, 2**32 - 1), st.floats(0.03, 0.09))
@settings(max_examples=40)
def test_whatever_is_proved_has_no_point_outside(seed, size):
    generator = np.random.default_rng(seed)
    shape = coal.Capsule(0.05, 0.1)
    leaves = np.column_stack([generator.uniform(-0.06, 0.06, (5, 3)), np.full(5, size)])
    tree = SphereTree(
        np.concatenate([[[0.0, 0.0, 0.0, 0.3]], leaves]),
        np.array([1, 0, 0, 0, 0, 0]),
        np.array([5, 0, 0, 0, 0, 0]),
    )
    points = surface_points(shape, 3000, seed)
    distances = np.linalg.norm(points[:, None] - leaves[:, :3], axis=2)
    covered = (distances <= leaves[:, 3]).any(axis=1).all()
    assert covered or not is_contained(patches_of(shape), tree)


def test_flat_pieces_are_triangles_whatever_their_form():
    triangles = np.random.default_rng(0).normal(size=(20, 3, 3))
    patches = swell_nothing(triangles)
    np.testing.assert_array_equal(drop_nothing(patches), triangles)
    np.testing.assert_array_equal(compute_corners(patches), triangles)
    np.testing.assert_allclose(measure_sides(patches), measure_sides(triangles))
    np.testing.assert_array_equal(bisect_pieces(patches)[:, :, :3], bisect_pieces(triangles))
    ball = patches_of(coal.Sphere(0.1))
    mixed = np.concatenate([patches, ball])
    assert drop_nothing(mixed) is mixed
    assert is_contained(mixed, one_ball([0, 0, 0], 10.0))
    assert not is_contained(mixed, one_ball([0, 0, 0], 0.2))
