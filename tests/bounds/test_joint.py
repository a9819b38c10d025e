import numpy as np
import pinocchio
import pytest

from armguard.bounds import BrakingMotion, IsotropicMotion, JointMotion
from armguard.exceptions import ArmguardError
from armguard.robot import Robot
from support.example_arms import load_arm
from support.motion_questions import HAND_POINT, moderate_state, unit
from support.urdf_arms import limits_for, two_links

READY = np.array([0.0, 0.0, 0.0, -1.5, 0.0, 1.8, 0.0])


@pytest.mark.parametrize(
    ("q", "v", "age"),
    [
        (READY[:6], np.zeros(6), 0.0),
        (READY.astype(np.float32), np.zeros(7), 0.0),
        (READY, np.zeros((7, 1)), 0.0),
        (READY, np.full(7, np.nan), 0.0),
        (READY, np.full(7, 9.0), 0.0),
        (READY + 9.0, np.zeros(7), 0.0),
        (READY * np.nan, np.zeros(7), 0.0),
        (READY, np.zeros(7), np.nan),
        (READY, np.zeros(7), np.inf),
    ],
)
def test_what_no_table_can_be_filled_for_is_refused(models, q, v, age):
    with pytest.raises(ArmguardError):
        models["joint"].tabulate(q, v, age)
    with pytest.raises(ArmguardError):
        models["braking"].tabulate(q, v, age, 0.1)


def test_in_the_long_run_the_ranges_of_joints_decide(robot, models):
    q, v = moderate_state(robot, np.random.default_rng(7))
    question = q, v, "panda_hand", HAND_POINT, np.array([0.0, 0.6, 0.8])
    later = [models["joint"].advance(*question, t) for t in (20.0, 80.0, 1e6, 1e15)]
    assert max(later) == min(later) < 12.0


@pytest.mark.parametrize("name", ["panda", "xarm7", "ur5", "tiago"])
def test_joint_bounds_are_a_fraction_of_isotropic_ones(name):
    robot, random = load_arm(name), np.random.default_rng(3)
    isotropic, joint = IsotropicMotion(robot), JointMotion(robot)
    ratios = {0.05: [], 0.1: [], 0.2: []}
    for _ in range(60):
        q, v = moderate_state(robot, random)
        direction = unit(random)
        for t, found in ratios.items():
            question = q, v, robot.links[-1], HAND_POINT, direction, t
            free = isotropic.advance(*question)
            found.append(joint.advance(*question) / free if free > 0.0 else 1.0)
    medians = [np.median(found) for found in ratios.values()]
    assert medians[0] <= 0.2
    assert medians[1] <= 0.25
    assert medians[2] <= 0.6


def test_an_arm_with_a_single_joint_is_bounded_as_any(tmp_path):
    robot = Robot.from_urdf(two_links(tmp_path), limits=limits_for("shoulder"))
    q, v, t = np.array([0.5]), np.array([0.6]), 0.1
    placement = pinocchio.SE3(np.eye(3), np.array([0.0, 0.0, 1.0]))
    point, data = np.array([0.2, 0.1, 0.3]), robot.model.createData()
    for motion in (JointMotion(robot), BrakingMotion(robot, 0.05)):
        pinocchio.forwardKinematics(robot.model, data, q)
        before = data.oMi[1].act(point)
        pinocchio.forwardKinematics(robot.model, data, q + 0.05 * v)
        moved = data.oMi[1].act(point) - before
        distance = np.linalg.norm(moved)
        bound = motion.advance(q, v, "upper", point, moved / distance, t)
        assert distance <= bound <= np.linalg.norm(point) * t * robot.velocity_limit[0] * 1.1
    volumes = BrakingMotion(robot, 0.05, placement).stopping_volume(q, v, 0.0, 0.0)
    spheres = robot.cover.tree("upper").spheres
    for angle in q + np.array([0.0, 0.02, 0.05]) * v:
        pinocchio.forwardKinematics(robot.model, data, np.array([angle]))
        for (*center, radius), (x, y, z, reach) in zip(spheres.tolist(), volumes, strict=True):
            gone = placement.act(data.oMi[1].act(np.array(center))) - [x, y, z]
            assert np.linalg.norm(gone) + radius <= reach
