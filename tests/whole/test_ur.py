"""Models of the e-Series: their joints are where Universal Robots publishes them."""

import numpy as np
import pinocchio
import pytest

from armguard.robot import Robot

DH = {
    "ur3e": (0.15185, -0.24355, -0.2132, 0.13105, 0.08535, 0.0921),
    "ur5e": (0.1625, -0.425, -0.3922, 0.1333, 0.0997, 0.0996),
    "ur10e": (0.1807, -0.6127, -0.57155, 0.17415, 0.11985, 0.11655),
}
"""d1, a2, a3, d4, d5 and d6 in [m]. universal-robots.com, "Parameters for calculations of
kinematics and dynamics"."""


def place_flange(name, q):
    """The flange in the base frame of the controller, by Denavit and Hartenberg's convention."""
    d1, a2, a3, d4, d5, d6 = DH[name]
    quarter = 0.5 * np.pi
    rows = zip(
        (0.0, a2, a3, 0.0, 0.0, 0.0),
        (d1, 0.0, 0.0, d4, d5, d6),
        (quarter, 0.0, 0.0, quarter, -quarter, 0.0),
        strict=True,
    )
    placement = np.eye(4)
    for angle, (a, d, alpha) in zip(q, rows, strict=True):
        c, s, ca, sa = np.cos(angle), np.sin(angle), np.cos(alpha), np.sin(alpha)
        placement = placement @ [
            [c, -s * ca, s * sa, a * c],
            [s, c * ca, -c * sa, a * s],
            [0.0, sa, ca, d],
            [0.0, 0.0, 0.0, 1.0],
        ]
    return placement


@pytest.mark.parametrize("name", DH)
def test_the_flange_is_where_published_parameters_put_it(name):
    robot = Robot.load(name)
    data = robot.model.createData()
    flange = robot.model.getFrameId("tool0")
    base = np.diag([-1.0, -1.0, 1.0, 1.0])  # `base_link` stands half a turn from the controller's
    random = np.random.default_rng(1)
    for q in random.uniform(-2.0 * np.pi, 2.0 * np.pi, (50, 6)):
        pinocchio.framesForwardKinematics(robot.model, data, q)
        expected = base @ place_flange(name, q)
        np.testing.assert_allclose(data.oMf[flange].homogeneous, expected, atol=1e-8)
