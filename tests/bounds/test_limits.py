import numpy as np
import pytest

from armguard.bounds import BrakingMotion, JointMotion, ReachMotion
from armguard.exceptions import RobotError
from support.motion_questions import HAND_POINT, LIMITS, altered


@pytest.mark.parametrize("kind", [ReachMotion, JointMotion, lambda r: BrakingMotion(r, 0.02)])
@pytest.mark.parametrize(
    ("key", "value"),
    [(key, bad) for key in LIMITS[2:5] for bad in (0.0, -1.0, np.nan, np.inf)]
    + [(key, bad) for key in LIMITS[5:] for bad in (-1.0, np.nan, np.inf)]
    + [("lower_position_limit", np.nan), ("upper_position_limit", -3.0)]
    + [("braking_deceleration", 100.0)],
)
def test_unusable_limits_are_refused_by_joint(robot, kind, key, value):
    values = np.array(getattr(robot, key))
    values[2] = value
    with pytest.raises(RobotError, match="panda_joint3"):
        kind(altered(robot, **{key: values}))


def test_missing_limits_are_refused(robot):
    with pytest.raises(RobotError, match="shape"):
        JointMotion(altered(robot, acceleration_limit=np.ones(6)))


def test_a_state_beyond_limits_within_errors_is_taken(robot, models):
    q = np.array([0.0, 0.0, 0.0, -1.5, 0.0, 1.8, 0.0])
    q[1] = robot.upper_position_limit[1] + 0.5 * robot.position_error[1]
    v = np.zeros(7)
    v[2] = robot.velocity_limit[2] + 0.5 * robot.velocity_error[2]
    for model in models.values():
        assert model.advance(q, v, "panda_hand", HAND_POINT, np.array([0.0, 0.0, 1.0]), 0.1) > 0.0
