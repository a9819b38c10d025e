import coal
import numpy as np
import pytest

from armguard.cover.inflation import inflate_spheres, measure_gaps
from armguard.cover.triangulation import triangulate
from armguard.exceptions import CoverError
from support.one_link import OneLink
from support.surface_samples import is_inside, sample

DIAGONAL = float(np.linalg.norm([0.1, 0.05, 0.05]))


@pytest.fixture(scope="module")
def box():
    return OneLink(triangulate("box", coal.Box(0.2, 0.1, 0.1)))


def spheres(*rows):
    return {"link": np.array(rows, dtype=np.float64)}


def test_share_and_depth_are_those_of_dense_samples(box):
    rows = spheres([0.05, 0, 0, 0.08], [-0.05, 0.0, 0.0, 0.065])
    gap = measure_gaps(box, rows)["link"]
    points = sample(box.triangles("link"), 100_000)
    distances = np.linalg.norm(points[:, None] - rows["link"][:, :3], axis=2) - rows["link"][:, 3]
    nearest = distances.min(axis=1)
    assert not gap.proved
    assert gap.share == pytest.approx((nearest > 0.0).mean(), abs=0.01)
    # The farthest point is a corner, which samples only come near to.
    corner = np.linalg.norm([0.05, 0.05, 0.05]) - 0.065
    assert gap.depth == pytest.approx(corner, abs=1e-9)
    assert nearest.max() <= gap.depth


def test_a_link_without_spheres_is_all_gap(box):
    gap = measure_gaps(box, {})["link"]
    assert (gap.count, gap.share, gap.depth, gap.proved) == (0, 1.0, np.inf, False)
    for none in ({}, {"link": np.zeros((0, 4))}):
        with pytest.raises(CoverError, match="'link': has no spheres"):
            inflate_spheres(box, none)


def test_inflated_spheres_are_a_proved_cover_and_none_has_shrunk(box):
    rows = spheres([0.06, 0, 0, 0.06], [-0.06, 0.01, 0, 0.05], [0, 0, 0, 0.062], [0, 0, 0, 0.001])
    cover = inflate_spheres(box, rows)
    assert cover.check(box).proved
    cover.verify(box)
    for level in range(cover.levels("link")):
        points = sample(box.triangles("link"), 20_000)
        assert is_inside(points, cover.spheres("link", level)).all()
    before = {tuple(row[:3]): row[3] for row in rows["link"][:3]}
    for ball in cover.spheres("link"):
        assert ball[3] >= before[tuple(ball[:3])]


def test_of_spheres_that_share_a_centre_none_shrinks(box):
    """Each may own pieces; the larger must not be taken for the smaller."""
    rows = spheres([0, 0, 0, 0.13], [0, 0, 0, 0.14], [0, 0, 0, 0.135])
    assert (inflate_spheres(box, rows).spheres("link")[:, 3] >= 0.13).all()
