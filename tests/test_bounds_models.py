"""Laws, figures and refusals of the reach, joint and braking models."""

from types import SimpleNamespace

import numpy as np
import pinocchio
import pytest
from joint_motions import STEP, brake_joints, limits_of, move_joints, random_state
from other_arms import load_arm

from armguard.bounds import BrakingMotion, IsotropicMotion, JointMotion, MotionModel, ReachMotion
from armguard.exceptions import ArmguardError, RobotError
from armguard.kinematics import Kinematics
from armguard.robot import Robot

HAND_POINT = np.array([0.0, 0.0, 0.1])
LIMITS = (
    "lower_position_limit",
    "upper_position_limit",
    "velocity_limit",
    "acceleration_limit",
    "braking_deceleration",
    "position_error",
    "velocity_error",
)


@pytest.fixture(scope="module")
def robot():
    return Robot.load("panda")


@pytest.fixture(scope="module")
def models(robot):
    return {
        "reach": ReachMotion(robot),
        "isotropic": IsotropicMotion(robot),
        "joint": JointMotion(robot),
        "braking": BrakingMotion(robot, 0.02),
    }


def unit(random):
    vector = random.normal(size=3)
    return vector / np.linalg.norm(vector)


def moderate_state(robot, random):
    q = random.uniform(robot.lower_position_limit, robot.upper_position_limit)
    return q, random.uniform(-0.3, 0.3, len(q)) * robot.velocity_limit


def altered(robot, **changes):
    """The robot with other limits."""
    keys = ("name", "model", "joints", "links", "cover", "joint_index", *LIMITS)
    return SimpleNamespace(**{key: getattr(robot, key) for key in keys} | changes)


# Reach


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


def test_pandas_reach_is_as_published(models):
    # 855 mm from the shoulder to the flange, then the hand.
    np.testing.assert_allclose(models["reach"].arm_ball[:3], [0.0, 0.0, 0.333], atol=1e-3)
    assert 0.95 < models["reach"].arm_ball[3] < 1.05


def test_reach_arrays_cannot_be_written(models):
    for array in (models["reach"].link_balls, models["reach"].arm_ball, models["joint"].lever):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0.0


# All models


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


def test_in_the_long_run_the_ranges_of_joints_decide(robot, models):
    q, v = moderate_state(robot, np.random.default_rng(7))
    question = q, v, "panda_hand", HAND_POINT, np.array([0.0, 0.6, 0.8])
    later = [models["joint"].advance(*question, t) for t in (20.0, 80.0, 1e6, 1e15)]
    assert max(later) == min(later) < 12.0


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


def test_joint_bound_is_the_taylor_bound_or_less(robot, models):
    random = np.random.default_rng(4)
    data = robot.model.createData()
    joint = robot.joint_index("panda_hand")
    levers = models["isotropic"].lever
    hand = Kinematics(robot).spheres.root[robot.links.index("panda_hand")]
    lever, center = levers[hand], Kinematics(robot).spheres.local[hand]
    distal = np.maximum(np.arange(7)[:, None], np.arange(7)[None, :])
    both = np.where(np.outer(lever, lever) > 0.0, lever[distal], 0.0)
    slower = altered(
        robot,
        position_error=np.zeros(7),
        velocity_error=np.zeros(7),
        upper_position_limit=np.full(7, np.inf),
        lower_position_limit=np.full(7, -np.inf),
    )
    motion = JointMotion(slower)
    for _ in range(100):
        q, v = moderate_state(robot, random)
        direction, t = unit(random), random.uniform(0.01, 0.1)
        accel = robot.acceleration_limit
        # Short enough that no joint reaches its top speed, and that bounds rise to their ends.
        high, low = (v + 0.5 * accel * t) * t, (v - 0.5 * accel * t) * t
        jacobian = pinocchio.computeJointJacobians(robot.model, data, q)
        place = data.oMi[joint].act(center)
        slope = direction @ (jacobian[:3] + np.cross(jacobian[3:].T, place).T)
        size = np.maximum(np.maximum(high, 0.0), np.maximum(-low, 0.0))
        taylor = np.maximum(0.0, np.maximum(slope * high, slope * low)).sum()
        taylor += 0.5 * size @ both @ size
        assert motion.advance(q, v, "panda_hand", center, direction, t) <= taylor * (1.0 + 1e-9)


def test_a_joint_at_its_limit_goes_no_further(robot, models):
    q = np.array([robot.upper_position_limit[0], 0.3, 0.0, -1.5, 0.0, 1.8, 0.0])
    sideways = np.array([0.0, 1.0, 0.0])
    still = altered(robot, acceleration_limit=np.r_[15.0, np.full(6, 1e-9)],
                    braking_deceleration=np.r_[3.0, np.full(6, 1e-10)],
                    position_error=np.zeros(7), velocity_error=np.zeros(7))  # fmt: skip
    data = robot.model.createData()
    jacobian = pinocchio.computeJointJacobians(robot.model, data, q)
    place = data.oMi[robot.joint_index("panda_hand")].translation
    outwards = sideways * np.sign(
        sideways @ (jacobian[:3] + np.cross(jacobian[3:].T, place).T)[:, 0]
    )
    motion = JointMotion(still)
    assert motion.advance(q, np.zeros(7), "panda_hand", np.zeros(3), outwards, 0.1) < 1e-3
    assert motion.advance(q, np.zeros(7), "panda_hand", np.zeros(3), -outwards, 0.1) > 1e-2


# Braking


def test_a_braking_arm_rests_after_its_stop_time(robot, models):
    random, braking = np.random.default_rng(5), models["braking"]
    for _ in range(20):
        q, v = moderate_state(robot, random)
        direction = unit(random)
        rest = braking.stop_time(q, v, 0.0, 0.0)
        question = q, v, "panda_hand", HAND_POINT, direction
        at_rest = braking.advance(*question, rest)
        assert braking.advance(*question, rest + 5.0) == pytest.approx(at_rest, rel=1e-9)
        assert at_rest <= models["joint"].advance(*question, rest) * (1.0 + 1e-9)


def test_stop_time_is_that_of_the_slowest_joint(robot, models):
    v = np.zeros(7)
    v[1] = 1.0
    free = 0.002 + 0.003 + 0.02
    pace = 1.0 + robot.velocity_error[1] + robot.acceleration_limit[1] * free
    expected = 0.003 + 0.02 + pace / robot.braking_deceleration[1]
    q = np.array([0.0, 0.0, 0.0, -1.5, 0.0, 1.8, 0.0])
    assert models["braking"].stop_time(q, v, 0.002, 0.003) == pytest.approx(expected)


def test_stopping_volume_contains_what_brakes(robot, models):
    random, braking = np.random.default_rng(6), models["braking"]
    kinematics = Kinematics(robot)
    limits, care = limits_of(robot), np.zeros(7, np.int64)
    closest = 0.0
    for _ in range(60):
        q, v = moderate_state(robot, random)
        volumes = braking.stopping_volume(q, v, 0.002, 0.003)
        q = np.clip(q + random.choice([-1.0, 1.0], 7) * robot.position_error,
                    limits.lower, limits.upper)  # fmt: skip
        v = v + random.choice([-1.0, 1.0], 7) * robot.velocity_error
        push, strength = random.choice([-1.0, 1.0], 7), random.choice([0.0, 1.0], 7)
        for k in range(600):
            if k * STEP < 0.025 - 1e-9:
                move_joints(q, v, push, limits, care, STEP)
            else:
                brake_joints(q, v, strength, limits, STEP)
            if k % 10 == 0 and k > 1:
                kinematics.compute(q, v)
                away = np.linalg.norm(kinematics.centers - volumes[:, :3], axis=1)
                used = away + kinematics.spheres.radius
                assert (used <= volumes[:, 3]).all()
                closest = max(closest, (used / volumes[:, 3]).max())
    assert closest > 0.8


@pytest.mark.parametrize("bad", [-0.1, np.nan, np.inf])
def test_impossible_times_are_refused(robot, models, bad):
    with pytest.raises(ArmguardError, match="reaction_time"):
        BrakingMotion(robot, bad)
    q, v = np.array([0.0, 0.0, 0.0, -1.5, 0.0, 1.8, 0.0]), np.zeros(7)
    with pytest.raises(ArmguardError, match="horizon"):
        models["braking"].stop_time(q, v, 0.0, bad)
    with pytest.raises(ArmguardError, match="horizon"):
        models["braking"].tabulate(q, v, 0.0, bad)


# Bad input


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


def test_a_state_beyond_limits_within_errors_is_taken(robot, models):
    q = np.array([0.0, 0.0, 0.0, -1.5, 0.0, 1.8, 0.0])
    q[1] = robot.upper_position_limit[1] + 0.5 * robot.position_error[1]
    v = np.zeros(7)
    v[2] = robot.velocity_limit[2] + 0.5 * robot.velocity_error[2]
    for model in models.values():
        assert model.advance(q, v, "panda_hand", HAND_POINT, np.array([0.0, 0.0, 1.0]), 0.1) > 0.0
