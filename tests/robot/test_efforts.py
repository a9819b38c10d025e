"""A single pendulum, whose accelerations are known in closed form."""

import numpy as np
import pinocchio
import pytest

from armguard.robot.efforts import (
    compute_accelerations,
    compute_supported_shares,
    round_down,
    round_up,
)

MASS, LENGTH, EFFORT, GRAVITY = 2.0, 0.5, 30.0, 9.81
INERTIA = MASS * LENGTH**2


def make_pendulum(mass=MASS):
    model = pinocchio.Model()
    joint = model.addJoint(0, pinocchio.JointModelRX(), pinocchio.SE3.Identity(), "swing")
    inertia = pinocchio.Inertia(mass, np.array([0.0, 0.0, LENGTH]), np.zeros((3, 3)))
    model.appendBodyToJoint(joint, inertia, pinocchio.SE3.Identity())
    model.lowerPositionLimit, model.upperPositionLimit = np.array([-np.pi]), np.array([np.pi])
    model.velocityLimit, model.effortLimit = np.array([1.0]), np.array([EFFORT])
    return model


def test_the_hardest_push_is_with_gravity():
    (found,) = compute_accelerations(make_pendulum(), 2000)
    most = (EFFORT + MASS * GRAVITY * LENGTH) / INERTIA
    assert 0.999 * most < found <= most * (1.0 + 1e-9)


def test_the_gentlest_stop_is_against_gravity():
    (share,) = compute_supported_shares(
        make_pendulum(), np.array([1.0]), 0.0, np.zeros(3), np.array([0.3]), 2000
    )
    least = (EFFORT - MASS * GRAVITY * LENGTH) / INERTIA
    assert least * (1.0 - 1e-9) <= share < 1.001 * least


@pytest.mark.parametrize("value", [1.0, 0.034567, 129.9, 1234.0, 7.0e-6])
def test_rounding_goes_one_way(value):
    assert value <= round_up(value) <= 1.1 * value
    assert value / 1.1 <= round_down(value) <= value * (1.0 + 1e-12)
