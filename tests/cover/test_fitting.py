import coal
import numpy as np
import pytest

from armguard.cover.fitting import cut_pieces, fit_tree
from armguard.cover.signed_distance import compute_signed_distances
from armguard.cover.sphere_tree import GRID, MARGIN
from armguard.cover.triangulation import triangulate
from support.surface_samples import areas, is_inside, sample


@pytest.fixture(scope="module")
def rod():
    return triangulate("rod", coal.Box(0.08, 0.06, 0.4))


def test_slender_triangles_are_not_cut_into_tens_of_thousands():
    prism = triangulate("prism", coal.Cylinder(0.05, 0.4))
    for count in (600, 2500):
        pieces = cut_pieces(prism, count, most=4 * count)
        assert count < len(pieces) <= 4 * count
        assert areas(pieces).sum() == pytest.approx(areas(prism).sum(), rel=1e-12)
    assert len(cut_pieces(prism)) <= 10_000
    # What there is to begin with stays as it is.
    assert len(cut_pieces(prism, most=10)) == len(prism)


@pytest.mark.parametrize("count", [1, 2, 5, 9])
def test_at_most_so_many_leaves_that_stick_out_less_the_more_there_are(rod, count):
    tree = fit_tree(rod, spheres=count)
    leaves = tree.spheres[tree.child_count == 0]
    assert 1 <= len(leaves) <= count
    assert is_inside(sample(rod, 20_000), leaves).all()
    protrusion = (leaves[:, 3] + compute_signed_distances(leaves[:, :3], rod)).max()
    assert protrusion < {1: 0.181, 2: 0.09, 5: 0.04, 9: 0.035}[count]


def test_leaves_stick_out_no_more_than_asked(rod):
    tree = fit_tree(rod, protrusion=0.03)
    leaves = tree.spheres[tree.child_count == 0]
    protrusions = leaves[:, 3] + compute_signed_distances(leaves[:, :3], rod)
    assert (protrusions <= 0.03 + MARGIN + 2 * GRID).all()
    assert len(leaves) <= 8
    assert is_inside(sample(rod, 20_000), leaves).all()


def test_the_same_input_gives_the_same_tree(rod):
    first, second = fit_tree(rod, spheres=6), fit_tree(rod.copy(), spheres=6)
    for one, other in zip(first, second, strict=True):
        assert one.tobytes() == other.tobytes()


@pytest.mark.parametrize(
    "triangles",
    [
        np.zeros((1, 3, 3)),
        np.array([[[0.0, 0.0, 0.0], [0.2, 0.0, 0.0], [0.1, 0.0, 0.0]]]),
        np.array([[[0.0, 0.0, 0.0], [0.2, 0.0, 0.0], [0.0, 0.1, 0.0]]]),
        np.array([[[0.0, 0.0, 0.0], [1e-7, 0.0, 0.0], [0.0, 1e-7, 0.0]]]),
        np.array([[[0.0, 0.0, 0.0], [0.3, 0.0, 0.0], [0.3, 1e-9, 0.0]]] * 3),
    ],
    ids=["point", "segment", "sheet", "speck", "sliver"],
)
def test_degenerate_geometry_is_covered(triangles):
    for wanted in ({"spheres": 3}, {"protrusion": 0.02}):
        tree = fit_tree(triangles, **wanted)
        weights = np.random.default_rng(0).dirichlet(np.ones(3), size=500)
        points = (weights @ triangles).reshape(-1, 3)
        assert is_inside(points, tree.spheres[tree.child_count == 0]).all()
        assert is_inside(points, tree.spheres[:1]).all()
