"""What all motion models have in common."""

import numpy as np
import pinocchio
import pytest

from armguard.bounds import BrakingMotion, IsotropicMotion, JointMotion, MotionModel, ReachMotion
from support.hostile_joints import random_state
from support.motion_questions import HAND_POINT, moderate_state, unit

NAMES = ["reach", "isotropic", "joint", "braking"]


@pytest.mark.parametrize("name", NAMES)
def test_advance_starts_small_and_never_falls(robot, models, name):
    model: MotionModel = models[name]
    random = np.random.default_rng(1)
    for _ in range(10):
        q, v = random_state(robot, random)
        direction = unit(random)
        times = np.sort(random.uniform(0.0, 1.2, 30))
        advances = [model.advance(q, v, "panda_hand", HAND_POINT, direction, t) for t in times]
        assert min(advances) >= 0.0
        assert (np.diff(advances) >= 0.0).all()
        if name != "reach":
            assert model.advance(q, v, "panda_hand", HAND_POINT, direction, 0.0) < 1e-9


@pytest.mark.parametrize("name", NAMES)
def test_direction_is_the_worlds(robot, models, name):
    base = pinocchio.SE3(pinocchio.rpy.rpyToMatrix(0.4, 1.1, -2.0), np.array([3.0, 2.0, 1.0]))
    placed = {
        "reach": lambda: ReachMotion(robot, base),
        "isotropic": lambda: IsotropicMotion(robot, base),
        "joint": lambda: JointMotion(robot, base),
        "braking": lambda: BrakingMotion(robot, 0.02, base),
    }[name]()
    q, v = moderate_state(robot, np.random.default_rng(2))
    direction = np.array([0.6, 0.0, 0.8])
    here = models[name].advance(q, v, "panda_link7", [0.1, 0.0, 0.0], direction, 0.1)
    turned = base.rotation @ direction
    there = placed.advance(q, v, "panda_link7", [0.1, 0.0, 0.0], turned, 0.1)
    np.testing.assert_allclose(there, here, rtol=1e-9)
