import numpy as np
import pytest

from armguard.cover.sphere_tree import (
    GRID,
    MARGIN,
    MOST_CHILDREN,
    Node,
    build_tree,
    compute_parents,
    enclose,
)


def make_leaves(count, seed=0):
    generator = np.random.default_rng(seed)
    corners = generator.normal(size=(count, 4, 3)) * 0.02 + generator.normal(size=(count, 1, 3))
    return [Node(enclose(points.mean(axis=0), points), points, []) for points in corners]


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 17, 40])
def test_every_leaf_is_there_and_every_ball_has_two_to_four_children(count):
    leaves = make_leaves(count)
    tree = build_tree(leaves)
    assert set(tree.child_count) <= {0, *range(2, MOST_CHILDREN + 1)}
    found = tree.spheres[tree.child_count == 0]
    expected = np.array([leaf.sphere for leaf in leaves])
    np.testing.assert_array_equal(np.unique(found, axis=0), np.unique(expected, axis=0))


def test_every_ball_holds_the_corners_of_all_leaves_below_it():
    leaves = make_leaves(25)
    tree = build_tree(leaves)
    parents = compute_parents(tree)
    for leaf in leaves:
        (node,) = np.flatnonzero((tree.spheres == leaf.sphere).all(axis=1))
        while True:
            offsets = np.linalg.norm(leaf.corners - tree.spheres[node, :3], axis=1)
            assert (offsets + MARGIN <= tree.spheres[node, 3]).all()
            if node == 0:
                break
            node = parents[node]


def test_balls_are_on_the_grid_and_only_just_large_enough():
    points = np.random.default_rng(3).normal(size=(50, 3))
    ball = enclose(points.mean(axis=0), points)
    np.testing.assert_allclose(ball / GRID, np.round(ball / GRID), atol=1e-6)
    reach = np.linalg.norm(points - ball[:3], axis=1).max()
    assert reach + MARGIN <= ball[3] <= reach + MARGIN + 2 * GRID
