"""How distances between links can vary is never more than is said."""

import functools

import numpy as np
import pinocchio
import pytest

from armguard.bounds.arm import ArmMotion
from armguard.bounds.link_gaps import cover_base
from armguard.robot.kinematics import Kinematics
from support.example_arms import load_arm


@functools.cache
def arm_of(name):
    """Robot, kinematics, and how gaps between its links vary."""
    robot = load_arm(name)
    return robot, Kinematics(robot), ArmMotion(robot, 0.02, with_velocities=True).link_gaps


def leaves_below(tree, node):
    if tree.first_child[node] < 0:
        return [node]
    children = [child for child in range(len(tree.parent)) if tree.parent[child] == node]
    return [leaf for child in children for leaf in leaves_below(tree, child)]


def draw_q(random, robot):
    lower = np.maximum(robot.lower_position_limit, -6.0)
    upper = np.minimum(robot.upper_position_limit, 6.0)
    return lower + (upper - lower) * random.random(len(lower))


@pytest.mark.parametrize("name", ["panda", "xarm7", "ur5", "tiago"])
def test_distances_vary_no_more_than_is_said(name):
    """One joint runs through its whole range, the others are anywhere."""
    robot, kinematics, gaps = arm_of(name)
    tree, placement = kinematics.spheres.tree, kinematics.placement
    random = np.random.default_rng(3)
    moves = placement.moves[placement.joint]
    is_leaf = tree.first_child < 0
    still = np.zeros(len(robot.joints))
    closest = 0.0
    for joint in range(len(still)):
        least = np.full((len(tree.parent),) * 2, np.inf)
        most = np.zeros_like(least)
        lower, upper = robot.lower_position_limit[joint], robot.upper_position_limit[joint]
        q = draw_q(random, robot)
        for angle in np.linspace(max(lower, -np.pi), min(upper, max(lower, -np.pi) + 7.0), 40):
            q[joint] = angle
            kinematics.compute(q, still)
            centers = kinematics.centers
            apart = np.linalg.norm(centers[:, None] - centers[None], axis=2)
            least, most = np.minimum(least, apart), np.maximum(most, apart)
        varies = most - least
        for c, part in enumerate(gaps.parts):
            differ = moves != moves[part]
            rows = np.flatnonzero(differ[:, joint] & (differ.sum(axis=1) == 1) & is_leaf)
            found = varies[np.ix_(rows, leaves_below(tree, part))].max(axis=1, initial=0.0)
            said = gaps.variation[rows, c]
            assert (found <= said).all(), (robot.joints[joint], (found - said).max())
            if np.isfinite(said).all() and len(rows):
                closest = max(closest, float((found / said).max()))
    assert closest > 0.9 or not np.isfinite(gaps.variation[gaps.variation > 0.0]).any()


@pytest.mark.parametrize("name", ["panda", "xarm7"])
def test_distances_of_links_vary_unless_no_joint_lies_between(name):
    _, kinematics, gaps = arm_of(name)
    placement, tree = kinematics.placement, kinematics.spheres.tree
    moves = placement.moves[placement.joint]
    count = (moves[:, None] != moves[gaps.parts][None]).sum(axis=2)
    assert (gaps.variation[count == 0] == 0.0).all()
    assert (gaps.variation[count > 1] == np.inf).all()
    # What holds for a node holds for all below it.
    child = np.flatnonzero(tree.parent >= 0)
    assert (gaps.variation[child] <= gaps.variation[tree.parent[child]]).all()
    # Between them the parts own every leaf.
    owned = [leaf for part in gaps.parts for leaf in leaves_below(tree, part)]
    assert sorted(owned) == np.flatnonzero(tree.first_child < 0).tolist()


@pytest.mark.parametrize("name", ["panda", "ur5", "tiago"])
def test_the_balls_of_the_base_hold_all_that_no_joint_moves(name):
    robot, _, gaps = arm_of(name)
    random = np.random.default_rng(2)
    placement = pinocchio.SE3.Random()
    balls = cover_base(robot.fixed_points().values(), placement)
    assert np.allclose(balls[:, 3], gaps.base[:, 3])
    assert len(robot.fixed_points()) * 8 == len(balls) > 0
    for points in robot.fixed_points().values():
        weights = random.dirichlet(np.full(len(points), 0.02), 500)
        inside = np.concatenate([weights @ points, points])
        inside = inside @ placement.rotation.T + placement.translation
        away = np.linalg.norm(inside[:, None] - balls[:, :3], axis=2) - balls[:, 3]
        assert (away.min(axis=1) <= 0.0).all()
    # Not much more than that is held.
    assert (
        balls[:, 3]
        < 0.26 * np.ptp(np.concatenate(list(robot.fixed_points().values())), axis=0).sum()
    ).all()


def test_an_arm_of_which_nothing_stands_still_has_no_base():
    assert cover_base([]).shape == (0, 4)
