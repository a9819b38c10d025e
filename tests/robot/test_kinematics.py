import numpy as np
import pinocchio
import pytest

from armguard.exceptions import ArmguardError
from armguard.robot import Kinematics, Robot
from armguard.robot.kinematics import ArmSpheres, _view_data
from support.urdf_arms import limits_for, two_links


@pytest.fixture(scope="module")
def robot():
    return Robot.load("panda")


@pytest.fixture
def base():
    return pinocchio.SE3(pinocchio.rpy.rpyToMatrix(0.3, -0.7, 2.1), np.array([0.4, -1.2, 0.8]))


def random_state(robot, seed):
    random = np.random.default_rng(seed)
    q = random.uniform(robot.lower_position_limit, robot.upper_position_limit)
    return q, random.uniform(-robot.velocity_limit, robot.velocity_limit)


def test_spheres_follow_links_and_trees(robot):
    spheres = ArmSpheres(robot)
    for index, link in enumerate(robot.links):
        tree = robot.cover.tree(link)
        own = np.flatnonzero(spheres.link == index)
        assert own[0] == spheres.root[index]
        assert (np.diff(own) == 1).all()
        assert (np.column_stack([spheres.local, spheres.radius])[own] == tree.spheres).all()
        assert (spheres.joint[own] == robot.joint_index(link)).all()
        assert (spheres.child_count[own] == tree.child_count).all()
        for node, parent in enumerate(own):
            if tree.child_count[node]:
                assert spheres.first_child[parent] == own[0] + tree.first_child[node]
            else:
                assert spheres.first_child[parent] == -1


def test_arrays_cannot_be_written(robot):
    kinematics = Kinematics(robot)
    spheres = kinematics.spheres
    for array in (*vars(spheres).values(), kinematics.centers, kinematics.velocities):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0


@pytest.mark.parametrize("placed", [False, True])
def test_centers_and_velocities_agree_with_pinocchio(robot, base, placed):
    placement = base if placed else pinocchio.SE3.Identity()
    kinematics = Kinematics(robot, placement if placed else None)
    spheres, data = kinematics.spheres, robot.model.createData()
    for seed in range(20):
        q, v = random_state(robot, seed)
        kinematics.compute(q, v)
        pinocchio.computeJointJacobians(robot.model, data, q)
        for i in range(len(spheres)):
            joint = int(spheres.joint[i])
            center = placement.act(data.oMi[joint].act(spheres.local[i]))
            jacobian = pinocchio.getJointJacobian(
                robot.model, data, joint, pinocchio.ReferenceFrame.LOCAL
            )
            shift = np.hstack([np.eye(3), -pinocchio.skew(spheres.local[i])])
            velocity = placement.rotation @ data.oMi[joint].rotation @ shift @ jacobian @ v
            np.testing.assert_allclose(kinematics.centers[i], center, atol=1e-13)
            np.testing.assert_allclose(kinematics.velocities[i], velocity, atol=1e-12)


def test_velocities_are_derivatives_of_centers(robot, base):
    kinematics = Kinematics(robot, base)
    step = 1e-6
    for seed in range(10):
        q, v = random_state(robot, seed)
        kinematics.compute(q + step * v, v)
        after = kinematics.centers.copy()
        kinematics.compute(q - step * v, v)
        slope = (after - kinematics.centers) / (2.0 * step)
        kinematics.compute(q, v)
        np.testing.assert_allclose(kinematics.velocities, slope, atol=1e-7)


def test_results_stay_in_place_and_do_not_depend_on_history(robot):
    kinematics = Kinematics(robot)
    centers, velocities = kinematics.centers, kinematics.velocities
    first, second = random_state(robot, 1), random_state(robot, 2)
    kinematics.compute(*first)
    expected = centers.copy(), velocities.copy()
    kinematics.compute(*second)
    assert not np.allclose(centers, expected[0])
    kinematics.compute(*first)
    assert kinematics.centers is centers
    assert (centers == expected[0]).all()
    assert (velocities == expected[1]).all()


def test_two_arms_do_not_share_anything(robot, base):
    here, there = Kinematics(robot), Kinematics(robot, base)
    q, v = random_state(robot, 3)
    here.compute(q, v)
    there.compute(*random_state(robot, 4))
    alone = Kinematics(robot)
    alone.compute(q, v)
    assert (here.centers == alone.centers).all()


def test_views_cover_all_joints_of_pinocchios_data(robot):
    data = robot.model.createData()
    rotations, translations = _view_data(data, robot.model.njoints)
    for seed in range(5):
        pinocchio.forwardKinematics(robot.model, data, *random_state(robot, seed))
        for joint in range(robot.model.njoints):
            assert (rotations[joint] == data.oMi[joint].rotation).all()
            assert (translations[joint] == data.oMi[joint].translation).all()
    assert np.shares_memory(rotations, data.oMi[1].rotation)


def test_another_memory_layout_is_refused(robot, monkeypatch):
    monkeypatch.setattr("armguard.robot.kinematics.PLACEMENT_STRIDE", 104)
    with pytest.raises(ArmguardError, match=r"pinocchio .* keeps joint 1's"):
        Kinematics(robot)


def test_base_placement_leaves_the_robot_alone(robot, base):
    before = robot.model.jointPlacements[1].homogeneous.copy()
    Kinematics(robot, base)
    assert (robot.model.jointPlacements[1].homogeneous == before).all()


@pytest.mark.parametrize(
    ("rotation", "translation"),
    [
        (2.0 * np.eye(3), np.zeros(3)),
        (np.diag([1.0, 1.0, -1.0]), np.zeros(3)),
        (np.full((3, 3), np.nan), np.zeros(3)),
        (np.eye(3), np.array([0.0, np.inf, 0.0])),
    ],
)
def test_bad_base_placement_is_refused(robot, rotation, translation):
    with pytest.raises(ArmguardError, match="base placement"):
        Kinematics(robot, pinocchio.SE3(rotation, translation))


@pytest.mark.parametrize("length", [0, 6, 8])
def test_wrong_lengths_are_refused(robot, length):
    kinematics = Kinematics(robot)
    with pytest.raises(ArmguardError, match="joint state"):
        kinematics.compute(np.zeros(length), np.zeros(7))
    with pytest.raises(ArmguardError, match="joint state"):
        kinematics.compute(np.zeros(7), np.zeros(length))


def test_nan_reaches_the_spheres_behind_it(robot):
    kinematics = Kinematics(robot)
    assert np.isnan(kinematics.centers).all()
    q = np.zeros(7)
    q[3] = np.nan
    kinematics.compute(q, np.zeros(7))
    behind = kinematics.spheres.joint >= 4
    assert np.isnan(kinematics.centers[behind]).any(axis=1).all()
    assert np.isfinite(kinematics.centers[~behind]).all()


def test_an_arm_of_one_joint(tmp_path):
    robot = Robot.from_urdf(two_links(tmp_path), limits=limits_for("shoulder"))
    kinematics, q, v, step = Kinematics(robot), np.array([0.3]), np.array([0.7]), 1e-6
    kinematics.compute(q - step * v, v)
    before = kinematics.centers.copy()
    kinematics.compute(q + step * v, v)
    moved = (kinematics.centers - before) / (2.0 * step)
    kinematics.compute(q, v)
    assert np.abs(moved).max() > 0.01
    np.testing.assert_allclose(kinematics.velocities, moved, atol=1e-8)
