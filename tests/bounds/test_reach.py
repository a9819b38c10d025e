import numpy as np
import pinocchio
import pytest

from armguard.bounds import ReachMotion
from armguard.robot import Kinematics
from support.example_arms import load_arm
from support.hostile_joints import random_state


@pytest.mark.parametrize("name", ["panda", "xarm7", "ur5", "tiago"])
def test_no_configuration_leaves_the_workspace_balls(name):
    robot, random = load_arm(name), np.random.default_rng(0)
    base = pinocchio.SE3(pinocchio.rpy.rpyToMatrix(0.4, 1.1, -2.0), np.array([3.0, 2.0, 1.0]))
    reach, kinematics = ReachMotion(robot, base), Kinematics(robot, base)
    spheres = kinematics.spheres
    leaf = spheres.child_count == 0
    furthest = np.zeros(len(robot.links))
    for _ in range(3000):
        q, v = random_state(robot, random)
        q = np.where(random.random(len(q)) < random.random(), q, 0.0)
        q = np.clip(q, robot.lower_position_limit, robot.upper_position_limit)
        kinematics.compute(q + random.choice([-1.0, 1.0]) * robot.position_error, v)
        balls = reach.link_balls[spheres.link]
        used = np.linalg.norm(kinematics.centers - balls[:, :3], axis=1) + spheres.radius
        assert (used[leaf] <= balls[leaf, 3]).all()
        np.maximum.at(furthest, spheres.link[leaf], used[leaf])
        used = np.linalg.norm(kinematics.centers - reach.arm_ball[:3], axis=1) + spheres.radius
        assert (used[leaf] <= reach.arm_ball[3]).all()
    assert np.median(furthest / reach.link_balls[:, 3]) > 0.8


def test_a_lift_goes_from_end_to_end_whatever_it_was_measured_to_be():
    """It is believed up to an error beyond its limits, and may truly be another one beyond."""
    robot = load_arm("tiago")
    lift, link = robot.joints.index("torso_lift_joint"), "torso_lift_link"
    error, up = robot.position_error[lift], np.array([0.0, 0.0, 1.0])
    low, high = robot.lower_position_limit[lift], robot.upper_position_limit[lift]
    reach = ReachMotion(robot)
    for way, nearest, furthest in ((1.0, low, high), (-1.0, high, low)):
        q = np.clip(np.zeros(len(robot.joints)), robot.lower_position_limit, None)
        q[lift] = nearest - way * error
        travel = abs(furthest - nearest) + 4.0 * error
        bound = reach.advance(q, np.zeros(len(q)), link, np.zeros(3), way * up, 0.0)
        assert travel <= bound <= travel * (1.0 + 1e-9)


def test_pandas_reach_is_as_published(models):
    # 855 mm from the shoulder to the flange, then the hand.
    np.testing.assert_allclose(models["reach"].arm_ball[:3], [0.0, 0.0, 0.333], atol=1e-3)
    assert 0.95 < models["reach"].arm_ball[3] < 1.05
