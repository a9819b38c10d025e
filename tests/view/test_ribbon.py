import numpy as np
import pytest

from armguard.view.ribbon import lay_ribbon


@pytest.mark.parametrize("end", [[1.0, 0.0, 0.1], [0.2, -0.8, 0.0], [0.0, 0.1, 1.0]])
def test_a_ribbon_lies_around_its_way_and_is_as_wide_as_it_is_to_be(end):
    points = np.linspace(0.0, 1.0, 9)[:, None] * end
    corners = lay_ribbon(points, 0.06).reshape(-1, 3)
    assert len(corners) == 3 * 2 * 8
    along = np.array(end) / np.linalg.norm(end)
    offsets = corners - np.outer(corners @ along, along)
    assert np.linalg.norm(offsets, axis=1) == pytest.approx(np.full(len(corners), 0.03))


def test_its_triangles_cover_it_once():
    way = np.linspace(0.0, 1.0, 5)[:, None] * [1.0, 0.0, 0.0]
    triangles = lay_ribbon(way, 0.1)
    sides = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    assert 0.5 * np.linalg.norm(sides, axis=1).sum() == pytest.approx(0.1)
    assert (sides[:, 2] * sides[0, 2] > 0.0).all()


@pytest.mark.parametrize("points", [np.zeros((0, 3)), np.zeros((1, 3))])
def test_less_than_a_way_has_no_ribbon(points):
    assert lay_ribbon(points, 0.1).shape == (0, 3, 3)


def test_a_way_that_rests_has_a_ribbon_of_no_width():
    assert np.isfinite(lay_ribbon(np.ones((4, 3)), 0.1)).all()
    assert lay_ribbon(np.ones((4, 3)), 0.1) == pytest.approx(np.ones((6, 3, 3)))
