"""What all motion models have in common."""

import numpy as np
import pinocchio
import pytest

from armguard.bounds import BrakingMotion, JointMotion, MotionModel, ReachMotion
from armguard.exceptions import ArmguardError
from support.hostile_joints import random_state
from support.motion_questions import HAND_POINT, moderate_state, unit


@pytest.mark.parametrize("name", ["reach", "joint", "braking"])
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


@pytest.mark.parametrize("name", ["reach", "joint", "braking"])
def test_direction_is_the_worlds(robot, models, name):
    base = pinocchio.SE3(pinocchio.rpy.rpyToMatrix(0.4, 1.1, -2.0), np.array([3.0, 2.0, 1.0]))
    placed = {
        "reach": lambda: ReachMotion(robot, base),
        "joint": lambda: JointMotion(robot, base),
        "braking": lambda: BrakingMotion(robot, 0.02, base),
    }[name]()
    q, v = moderate_state(robot, np.random.default_rng(2))
    direction = np.array([0.6, 0.0, 0.8])
    here = models[name].advance(q, v, "panda_link7", [0.1, 0.0, 0.0], direction, 0.1)
    turned = base.rotation @ direction
    there = placed.advance(q, v, "panda_link7", [0.1, 0.0, 0.0], turned, 0.1)
    np.testing.assert_allclose(there, here, rtol=1e-9)


@pytest.mark.parametrize("name", ["reach", "joint", "braking"])
@pytest.mark.parametrize(
    ("change", "offender"),
    [
        ({"q": np.zeros(6)}, "joint positions"),
        ({"q": [np.nan] * 7}, "joint positions"),
        ({"v": [np.inf] * 7}, "joint velocities"),
        ({"q": [0.0, 2.0, 0.0, -1.5, 0.0, 1.8, 0.0]}, "panda_joint2"),
        ({"v": [0.0, 0.0, -2.5, 0.0, 0.0, 0.0, 0.0]}, "panda_joint3"),
        ({"link": "nothing"}, "nothing"),
        ({"point": [0.0, np.nan, 0.0]}, "point"),
        ({"direction": [0.0, 0.0, 2.0]}, "direction"),
        ({"t": -1e-9}, "t"),
        ({"t": np.nan}, "t"),
        ({"t": np.inf}, "t"),
    ],
)
def test_bad_questions_are_refused(models, name, change, offender):
    good = {
        "q": np.array([0.0, 0.0, 0.0, -1.5, 0.0, 1.8, 0.0]),
        "v": np.zeros(7),
        "link": "panda_hand",
        "point": [0.0, 0.0, 0.0],
        "direction": [0.0, 0.0, 1.0],
        "t": 0.1,
    }
    models[name].advance(**good)
    with pytest.raises(ArmguardError) as caught:
        models[name].advance(**{**good, **change})
    assert offender in caught.value.offender
