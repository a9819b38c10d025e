import numpy as np
import pinocchio
import pytest

from armguard.exceptions import ArmguardError
from armguard.robot import Kinematics, Robot
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


def test_another_memory_layout_is_refused(robot, monkeypatch):
    monkeypatch.setattr("armguard.robot.kinematics.PLACEMENT_STRIDE", 104)
    with pytest.raises(ArmguardError, match=r"pinocchio .* keeps joint 1's"):
        Kinematics(robot)


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


def test_the_threaded_tree_visits_every_sphere_once(robot):
    spheres = Kinematics(robot).spheres
    tree = spheres.tree
    for link, root in enumerate(spheres.root):
        seen, node = [], root
        while node >= 0:
            seen.append(node)
            node = tree.first_child[node] if tree.first_child[node] >= 0 else tree.skip[node]
        assert sorted(seen) == np.flatnonzero(spheres.link == link).tolist()
    for node in np.flatnonzero(tree.parent >= 0):
        first = spheres.first_child[tree.parent[node]]
        assert first <= node < first + spheres.child_count[tree.parent[node]]
    assert (tree.parent[tree.root] == -1).all()


def test_a_skip_leaves_out_all_that_is_below(robot):
    """And nothing else: it goes on where a walk through everything comes afterwards."""
    tree = Kinematics(robot).spheres.tree

    def walk(node):
        while node >= 0:
            yield int(node)
            node = tree.first_child[node] if tree.first_child[node] >= 0 else tree.skip[node]

    def below(node):
        children = np.flatnonzero(tree.parent == node)
        return {node}.union(*(below(child) for child in children))

    for root in tree.root:
        order = list(walk(root))
        for place, node in enumerate(order):
            after = [other for other in order[place:] if other not in below(node)]
            assert list(walk(tree.skip[node])) == after
