import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from armguard.cover.containment import STEP, is_contained, tighten
from armguard.cover.fitting import fit_tree
from armguard.cover.sphere_tree import GRID, MARGIN, SphereTree

SLIVER = np.array([[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, 0.1, 0.0]]])
ROOT = [0.5, 0.0, 0.0, 0.6]


def tree(spheres, first_child=(0,), child_count=(0,)):
    return SphereTree(
        np.array(spheres, dtype=np.float64),
        np.array(first_child, dtype=np.int64),
        np.array(child_count, dtype=np.int64),
    )


def family(root, *children):
    """A root and its leaves."""
    count = len(children)
    return tree([root, *children], [1] + [0] * count, [count] + [0] * count)


def test_a_triangle_across_two_balls_is_proved_by_its_parts():
    assert is_contained(SLIVER, family(ROOT, [0.2, 0, 0, 0.35], [0.8, 0, 0, 0.35]))
    assert not is_contained(SLIVER, family(ROOT, [0.2, 0, 0, 0.29], [0.8, 0, 0, 0.29]))
    # Neither excuses the other: leaves that cover, or the ball above them.
    assert not is_contained(SLIVER, family([0.5, 0, 0, 0.45], [0.2, 0, 0, 0.35], [0.8, 0, 0, 0.35]))
    assert not is_contained(SLIVER, family(ROOT, [0.2, 0, 0, 0.35]))


def test_a_leaf_does_not_help_below_another_balls_root():
    """Each half is in a leaf, but in the one below the ball that does not hold that half."""
    left, right = [0.2, 0, 0, 0.35], [0.8, 0, 0, 0.35]
    for first, second, proved in ((left, right, True), (right, left, False)):
        crossed = tree([ROOT, left, right, first, second], [1, 3, 4, 0, 0], [2, 1, 1, 0, 0])
        assert is_contained(SLIVER, crossed) == proved


def test_balls_that_only_touch_prove_nothing():
    line = np.array([[[-0.5, 0.0, 0.0], [0.5, 0.0, 0.0], [0.0, 0.0, 0.0]]])
    touching = family([0, 0, 0, 0.6], [-0.25, 0, 0, 0.25], [0.25, 0, 0, 0.25])
    assert not is_contained(line, touching)


def test_corners_on_the_ball_are_not_enough():
    """The digest leaves a grid cell open, so the ball must reach beyond the corner."""
    triangle = np.array([[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]])
    assert not is_contained(triangle, tree([[0, 0, 0, 1.0]]))
    assert not is_contained(triangle, tree([[0, 0, 0, 1.0 + np.sqrt(3.0) * GRID]]))
    assert is_contained(triangle, tree([[0, 0, 0, 1.0 + MARGIN + 1e-12]]))


@given(st.integers(0, 2**32 - 1), st.floats(0.2, 1.0))
@settings(max_examples=60)
def test_whatever_is_proved_has_no_sample_outside(seed, size):
    generator = np.random.default_rng(seed)
    triangles = generator.uniform(-0.3, 0.3, size=(5, 3, 3))
    leaves = np.column_stack([generator.uniform(-0.3, 0.3, size=(6, 3)), np.full(6, size)])
    balls = family([0.0, 0.0, 0.0, 0.6], *leaves)
    weights = generator.dirichlet(np.full(3, 0.7), size=4000)
    points = (weights @ triangles).reshape(-1, 3)
    offsets = np.linalg.norm(points[:, None] - leaves[:, :3], axis=2)
    covered = (offsets <= leaves[:, 3]).any(axis=1).all()
    assert covered or not is_contained(triangles, balls)


def test_no_ball_of_a_tightened_tree_could_be_smaller():
    triangles = np.random.default_rng(1).uniform(-0.2, 0.2, size=(6, 3, 3))
    loose = fit_tree(triangles, spheres=5)
    tight = tighten(triangles, loose)
    assert is_contained(triangles, tight)
    assert (tight.spheres[:, 3] <= loose.spheres[:, 3]).all()
    np.testing.assert_array_equal(tight.spheres[:, :3], loose.spheres[:, :3])
    for node in range(len(tight.spheres)):
        spheres = tight.spheres.copy()
        spheres[node, 3] -= 2 * STEP
        assert not is_contained(triangles, tight._replace(spheres=spheres))


def test_a_proof_that_gives_up_is_none():
    """Whatever pieces it may look at: what sticks out is never proved, and what does not, once."""
    for leaf, covers in ((0.301, True), (0.2995, False)):
        leaves = [0.2, 0, 0, leaf], [0.8, 0, 0, leaf]
        edge = np.array([[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.7, 1e-4, 0.0]]])
        proved = [is_contained(edge, family(ROOT, *leaves), most) for most in range(60)]
        assert proved[-1] == covers
        assert proved == sorted(proved)
        assert not any(proved[:3])
