import math

import numpy as np
import pytest

from armguard.exceptions import ObstacleError
from armguard.obstacles import Frame, Obstacles
from armguard.obstacles.frames import ORTHONORMAL_TOLERANCE


@pytest.mark.hazard("H-05")
@pytest.mark.parametrize(
    "frame",
    [
        (np.eye(3) * 1.001, [0, 0, 0]),
        (np.diag([1, 1, -1]), [0, 0, 0]),
        (np.full((3, 3), math.nan), [0, 0, 0]),
        (np.eye(2), [0, 0, 0]),
        (np.eye(3), [0, 0]),
        (np.eye(3), [0, math.inf, 0]),
        (np.eye(3), [0, 0, 0], -0.1),
        (np.eye(3), [0, 0, 0], math.nan),
        ("x", [0, 0, 0]),
    ],
)
def test_frames_are_checked(frame):
    with pytest.raises(ObstacleError, match="frame"):
        Frame(*frame)
    with pytest.raises(ObstacleError, match="frame"):
        Obstacles(frames={"cam": frame})


@pytest.mark.parametrize("name", ["", "lens \ud800", 3])
def test_names_of_frames_can_be_written(name):
    with pytest.raises(ObstacleError, match=r"^frames"):
        Obstacles(frames={name: Frame(np.eye(3), np.zeros(3))})


def test_six_written_digits_are_a_rotation():
    angle = 1.0
    cosine, sine = math.cos(angle), math.sin(angle)
    exact = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    rotation = Frame(np.round(exact, 7), [1, 2, 3], 0.01).rotation
    assert np.abs(rotation @ rotation.T - np.eye(3)).max() < 1e-15
    assert np.abs(rotation - exact).max() < ORTHONORMAL_TOLERANCE
    assert np.linalg.det(rotation) > 0.0
