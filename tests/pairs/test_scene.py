import numpy as np
import pytest

from armguard.bounds import IsotropicMotion, JointMotion
from armguard.bounds.arm import ArmMotion
from armguard.obstacles import Obstacles
from armguard.pairs.evaluate import TickState
from armguard.pairs.scene import (
    thread_tree,
)
from armguard.robot import Kinematics
from support.panda_monitor import HOME, panda

KINEMATICS = Kinematics(panda())
SPHERES = KINEMATICS.spheres
TABLE = ("high", "low", "highest", "lowest")


def test_the_threaded_tree_visits_every_sphere_once():
    tree = thread_tree(SPHERES)
    for link, root in enumerate(SPHERES.root):
        seen, node = [], root
        while node >= 0:
            seen.append(node)
            node = tree.first_child[node] if tree.first_child[node] >= 0 else tree.skip[node]
        assert sorted(seen) == np.flatnonzero(SPHERES.link == link).tolist()
    for node in np.flatnonzero(tree.parent >= 0):
        first = SPHERES.first_child[tree.parent[node]]
        assert first <= node < first + SPHERES.child_count[tree.parent[node]]
    assert (tree.parent[tree.root] == -1).all()


def test_a_skip_leaves_out_all_that_is_below():
    """And nothing else: it goes on where a walk through everything comes afterwards."""
    tree = thread_tree(SPHERES)

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


@pytest.mark.parametrize("with_joints", [False, True])
@pytest.mark.parametrize("age", [0.0, 0.01, -0.004])
def test_the_arm_is_prepared_as_its_models_say(with_joints, age):
    rng, robot = np.random.default_rng(0), panda()
    v = rng.uniform(-0.5, 0.5, 7) * robot.velocity_limit
    motion = ArmMotion(robot, 0.02, with_joints=with_joints)
    state = TickState(KINEMATICS, motion, Obstacles(), margin=0.0)
    for name in TABLE:
        getattr(motion.table, name)[...] = 7.0
    state.begin(0.0, age, 0.0)
    KINEMATICS.place(HOME)
    state.prepare_arm(HOME, v)
    other = Kinematics(robot)
    other.compute(HOME, v)
    assert state.scene.arm.centers == pytest.approx(other.centers, abs=1e-12)
    assert state.scene.arm.velocities == pytest.approx(other.velocities, abs=1e-12)
    isotropic, joint = IsotropicMotion(robot), JointMotion(robot)
    isotropic.update(v)
    assert np.array_equal(state.scene.arm.velocity_error, isotropic.velocity_error)
    expected = joint.tabulate(HOME, v, age)
    for name in TABLE:
        filled = getattr(state.scene.table, name)
        assert (
            np.array_equal(filled, getattr(expected, name)) if with_joints else (filled == 7).all()
        )
