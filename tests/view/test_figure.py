import numpy as np
import pytest

from armguard.view.figure import draw_legs

HIP = np.array([1.0, -2.0, 0.2])
SHOULDERS = {
    "left_shoulder": HIP + np.array([0.0, 0.2, 0.4]),
    "right_shoulder": HIP + np.array([0.0, -0.2, 0.4]),
}


def test_legs_lead_from_the_hip_to_the_floor():
    lines = draw_legs({"hip": HIP} | SHOULDERS, -0.75)
    assert lines.shape == (6, 2, 3)
    assert lines[..., 2].max() == pytest.approx(HIP[2])
    assert lines[..., 2].min() == pytest.approx(-0.75)
    # Feet point away from the back: left of forward is left.
    assert np.allclose(lines[..., 1].mean(), HIP[1])
    assert (lines[[2, 5], 1, 0] > HIP[0]).all()


@pytest.mark.parametrize(
    "places",
    [{}, {"head": HIP}, {"hip": HIP * np.nan}, {"hip": HIP - (0.0, 0.0, 1.0)}],
)
def test_without_a_hip_above_the_floor_there_are_none(places):
    assert draw_legs(places, -0.75).shape == (0, 2, 3)


def test_shoulders_one_above_the_other_turn_nothing_into_nan():
    places = {"hip": HIP, "left_shoulder": HIP + np.array([0.0, 0.0, 1.0]), "right_shoulder": HIP}
    assert np.isfinite(draw_legs(places, 0.0)).all()
