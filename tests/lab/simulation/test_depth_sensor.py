"""Images are spoilt as it is published, and by no more."""

import numpy as np
import pytest

from armguard.bridges.depth import PinholeCamera
from armguard.lab.simulation.depth_sensor import EDGE, SPOTS, StereoSensor

CAMERA = PinholeCamera((135.0, 135.0), (127.5, 71.5))
SENSOR = StereoSensor(CAMERA, 447.0, 0.095)
SHAPE = 144, 256


@pytest.mark.parametrize("depth", [1.0, 2.0, 3.0])
def test_noise_grows_with_the_square_of_the_depth(depth):
    image = SENSOR.expose(np.full(SHAPE, depth), np.random.default_rng(1))
    seen = CAMERA.read(image)
    spots = np.isnan(seen).sum()
    assert 0 < spots <= SPOTS[0] * SPOTS[1] ** 2
    expected = 0.08 * depth**2 / (447.0 * 0.095)
    assert np.nanstd(seen) == pytest.approx(expected, rel=0.05)
    assert np.nanmean(seen) == pytest.approx(depth, abs=1e-3)


def test_pixels_fly_beside_edges_alone_and_the_shadow_of_an_edge_is_empty():
    true = np.full(SHAPE, 3.0)
    true[:, 100:150] = 1.0
    seen = CAMERA.read(SENSOR.expose(true, np.random.default_rng(2)))
    between = (seen > 1.2) & (seen < 2.8)
    columns = set(np.flatnonzero(between.any(axis=0)))
    assert columns <= {99, 100, 149, 150}
    assert {100, 149} <= columns
    # Left of what is near, as many pixels as the disparities differ by: 8.55.
    assert np.isnan(seen[:, 92:100]).all()
    assert not np.isnan(seen[:, :91]).all(axis=0).any()
    assert np.isnan(seen[:, 150]).mean() < 0.5


def test_a_slant_is_no_edge_and_a_depth_beyond_the_units_is_none_that_is_near():
    true = np.tile(np.linspace(1.0, 1.0 + 0.5 * EDGE * SHAPE[1], SHAPE[1]), (SHAPE[0], 1))
    seen = CAMERA.read(SENSOR.expose(true, np.random.default_rng(3)))
    assert np.isnan(seen).sum() <= SPOTS[0] * SPOTS[1] ** 2
    assert (SENSOR.expose(np.full(SHAPE, 1e3), np.random.default_rng(4)).max()) == 65535
