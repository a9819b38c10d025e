"""The UR5e's model, which is our own: the joints are where Universal Robots publishes them."""

import numpy as np
import pinocchio

from armguard.robot import Robot

DH = [
    (0.0, 0.1625, np.pi / 2),
    (-0.425, 0.0, 0.0),
    (-0.3922, 0.0, 0.0),
    (0.0, 0.1333, np.pi / 2),
    (0.0, 0.0997, -np.pi / 2),
    (0.0, 0.0996, 0.0),
]
"""a [m], d [m], alpha [rad] of each joint. universal-robots.com, "Parameters for calculations of
kinematics and dynamics"."""


def place_flange(q):
    """The flange in the base frame of the controller, by Denavit and Hartenberg's convention."""
    placement = np.eye(4)
    for angle, (a, d, alpha) in zip(q, DH, strict=True):
        c, s, ca, sa = np.cos(angle), np.sin(angle), np.cos(alpha), np.sin(alpha)
        placement = placement @ [
            [c, -s * ca, s * sa, a * c],
            [s, c * ca, -c * sa, a * s],
            [0.0, sa, ca, d],
            [0.0, 0.0, 0.0, 1.0],
        ]
    return placement


def test_the_flange_is_where_published_parameters_put_it():
    robot = Robot.load("ur5e")
    data = robot.model.createData()
    flange = robot.model.getFrameId("flange")
    base = np.diag([-1.0, -1.0, 1.0, 1.0])  # `base_link` stands half a turn from the controller's
    random = np.random.default_rng(1)
    for q in random.uniform(-2.0 * np.pi, 2.0 * np.pi, (50, 6)):
        pinocchio.framesForwardKinematics(robot.model, data, q)
        np.testing.assert_allclose(data.oMf[flange].homogeneous, base @ place_flange(q), atol=1e-9)
