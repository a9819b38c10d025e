"""No motion closes a gap between two spheres of an arm faster than is said, whatever attacks it."""

import functools
import itertools

import numpy as np
import pytest

from armguard.bounds.arm import ArmMotion
from armguard.bounds.closing import fill_arms, find_approach, find_closing, make_arms
from armguard.bounds.joint_box import make_box
from armguard.bounds.table_time import ArmSphere
from armguard.jit.kernels import kernel
from armguard.robot.kinematics import Kinematics
from support.example_arms import load_arm

SLACK = 1e-9


@functools.cache
def arm_of(name):
    """Robot, kinematics and motion."""
    robot = load_arm(name)
    return robot, Kinematics(robot), ArmMotion(robot, 0.02, with_velocities=True)


@kernel
def fill(one, radius, moves, other, other_radius, other_moves, box, arms):
    fill_arms(one, radius, moves, other, other_radius, other_moves, box, arms)


@kernel
def ask_approach(arms, box):
    return find_approach(arms, box)


@kernel
def ask_closing(arms):
    return find_closing(arms)


class Pair:
    """Two spheres of different links of an arm, and a box about a measured configuration."""

    def __init__(self, name, random, size, *, error=1e-3):
        self.robot, self.kinematics, motion = arm_of(name)
        robot, placement = self.robot, self.kinematics.placement
        self.tree = self.kinematics.spheres.tree
        lower = np.maximum(robot.lower_position_limit, -3.0)
        upper = np.minimum(robot.upper_position_limit, 3.0)
        count = len(lower)
        self.q = lower + (upper - lower) * random.random(count)
        self.moves = placement.moves[placement.joint]
        leaves = np.flatnonzero(self.tree.first_child < 0)
        while True:
            self.nodes = random.choice(leaves, 2, replace=False)
            if (self.moves[self.nodes[0]] != self.moves[self.nodes[1]]).any():
                break
        self.box = make_box(np.array(motion.joint.table.box.turning), np.full(count, error))
        ends = np.sort(random.uniform(-size, size, (2, count)), axis=0)
        self.box.span[0], self.box.span[1] = ends[1], ends[0]
        self.box.span[2] = np.maximum(ends[1], -ends[0])
        self.error = error
        self.place(self.q)
        lever, radius = motion.joint.lever, self.tree.radius
        self.radii = radius[self.nodes]
        self.spheres = [
            ArmSphere(*self.centers[k], placement.jacobian.T.copy(), lever[node], np.zeros(count))
            for k, node in enumerate(self.nodes)
        ]
        self.arms = make_arms(count)
        self.fill()

    def fill(self):
        one, other = self.spheres
        fill(
            one, self.radii[0], self.moves[self.nodes[0]], other, self.radii[1],
            self.moves[self.nodes[1]], self.box, self.arms,
        )  # fmt: skip

    def place(self, q):
        self.kinematics.compute(q, np.zeros(len(q)))
        self.centers = self.kinematics.centers[self.nodes].copy()

    def draw(self, random):
        """A configuration that the box and the limits allow for."""
        part = random.random(len(self.q))
        part = np.where(random.random(len(self.q)) < 0.7, np.round(part), part)
        high, low = self.box.span[:2]
        off = random.choice([-self.error, self.error], len(self.q))
        robot = self.robot
        q = self.q + off + low + part * (high - low)
        return np.clip(q, robot.lower_position_limit, robot.upper_position_limit)

    def levers(self):
        """How far points that a joint moves can be from its axis wherever joints are. (nv,)."""
        arms = [
            np.where(self.moves[node], sphere.lever + radius, 0.0)
            for node, sphere, radius in zip(self.nodes, self.spheres, self.radii, strict=True)
        ]
        return arms[0] + arms[1]

    def closing_rates(self, x, y):
        """How fast |x - y| falls with each joint, for points of both spheres; as they are placed.

        Shape (nv,).
        """
        jacobian = self.kinematics.placement.jacobian
        way = y - x
        way = way / np.linalg.norm(way)

        def rate(point, node):
            columns = jacobian[:, :3] + np.cross(jacobian[:, 3:], point)
            return np.where(self.moves[node], columns @ way, 0.0)

        return rate(x, self.nodes[0]) - rate(y, self.nodes[1])

    def attack(self, random, joint, sign):
        """The fastest closing by one joint that a climb over the points of both balls finds."""
        points, best = self.centers.copy(), -np.inf
        step = self.radii.max()
        for _ in range(60):
            tried = points + step * random.normal(size=(2, 3))
            off = tried - self.centers
            far = np.linalg.norm(off, axis=1) / self.radii
            off /= np.maximum(far, 1.0)[:, None]
            tried = self.centers + off
            if np.linalg.norm(tried[1] - tried[0]) < 1e-6:
                continue
            found = sign * self.closing_rates(*tried)[joint]
            if found > best:
                points, best = tried, found
            else:
                step *= 0.95
        return best


@pytest.mark.parametrize("name", ["panda", "ur5", "xarm7", "tiago"])
@pytest.mark.parametrize("size", [0.0, 0.03, 0.5])
def test_no_line_between_two_spheres_closes_faster_than_is_said(name, size):
    random = np.random.default_rng(round(100 * size))
    closest = 0.0
    for _ in range(12):
        pair = Pair(name, random, size)
        between = np.flatnonzero(pair.moves[pair.nodes[0]] != pair.moves[pair.nodes[1]])
        rest = np.setdiff1d(np.arange(len(pair.q)), between)
        assert (pair.arms.forth[rest] == 0.0).all()
        assert (pair.arms.back[rest] == 0.0).all()
        for _ in range(3):
            pair.place(pair.draw(random))
            for joint in between:
                for sign, said in ((1.0, pair.arms.forth[joint]), (-1.0, pair.arms.back[joint])):
                    found = pair.attack(random, joint, sign)
                    assert found <= said + SLACK, (pair.nodes, joint, sign)
                    if said > 0.01:
                        closest = max(closest, found / said)
    # The bound by levers alone is reached by less.
    assert closest > (0.9 if size == 0.0 else 0.5)


@pytest.mark.parametrize("name", ["panda", "tiago"])
@pytest.mark.parametrize("size", [0.02, 0.3])
def test_spheres_come_no_nearer_than_is_said(name, size):
    random = np.random.default_rng(3)
    closest = 0.0
    for _ in range(40):
        pair = Pair(name, random, size)
        apart = np.linalg.norm(pair.centers[1] - pair.centers[0])
        said = ask_approach(pair.arms, pair.box)
        for _ in range(20):
            pair.place(pair.draw(random))
            nearer = apart - np.linalg.norm(pair.centers[1] - pair.centers[0])
            assert nearer <= said + SLACK
            closest = max(closest, nearer / max(said, SLACK))
    assert closest > 0.3


@pytest.mark.parametrize("name", ["panda", "xarm7"])
def test_a_motion_closes_a_gap_by_no_more_than_is_said(name):
    """Points of both spheres while joints go forth and back within the box."""
    random = np.random.default_rng(4)
    closest = 0.0
    for _ in range(60):
        pair = Pair(name, random, 0.2)
        steps = [pair.draw(random) for _ in range(3)]
        path = np.concatenate([np.linspace(a, b, 40) for a, b in itertools.pairwise(steps)])
        moves = np.diff(path, axis=0)
        pair.arms.ways[0] = np.maximum(moves, 0.0).sum(axis=0)
        pair.arms.ways[1] = np.maximum(-moves, 0.0).sum(axis=0)
        pair.arms.ways[2] = abs(moves).sum(axis=0)
        said = ask_closing(pair.arms)
        away = random.normal(size=(2, 3))
        away *= pair.radii[:, None] / np.linalg.norm(away, axis=1)[:, None]
        local, apart = [], []
        for q in path:
            pair.place(q)
            rotation = pair.kinematics.placement.rotation[
                pair.kinematics.placement.joint[pair.nodes]
            ]
            if not local:
                local = [turn.T @ off for turn, off in zip(rotation, away, strict=True)]
            points = [
                center + turn @ off
                for center, turn, off in zip(pair.centers, rotation, local, strict=True)
            ]
            apart.append(np.linalg.norm(points[1] - points[0]))
        fall = np.maximum(-np.diff(apart), 0.0).sum()
        assert fall <= said + SLACK
        closest = max(closest, fall / max(said, SLACK))
    assert closest > 0.2


def test_joints_that_open_a_narrow_gap_close_nothing():
    """Far apart, with small balls: turning one way closes, the other way opens."""
    random = np.random.default_rng(5)
    opening = 0
    for _ in range(100):
        pair = Pair("panda", random, 0.01)
        pair.radii = np.array([1e-3, 1e-3])
        pair.fill()
        one_way = (pair.arms.forth > 0.0) != (pair.arms.back > 0.0)
        assert not (one_way & (pair.moves[pair.nodes[0]] == pair.moves[pair.nodes[1]])).any()
        opening += int(one_way.sum())
    assert opening > 100


@pytest.mark.parametrize("bad", ["center", "jacobian"])
def test_what_is_no_number_counts_with_its_lever(bad):
    random = np.random.default_rng(6)
    for _ in range(20):
        pair = Pair("panda", random, 0.05)
        k = int(random.integers(2))
        if bad == "center":
            pair.spheres[k] = pair.spheres[k]._replace(x=np.nan)
        else:
            for sphere in pair.spheres:
                sphere.jacobian[:] = np.nan
        pair.fill()
        mine = pair.moves[pair.nodes[0]]
        between = mine != pair.moves[pair.nodes[1]]
        arms = pair.levers()
        if bad == "jacobian":
            turning = between & pair.box.turning
            np.testing.assert_array_equal(pair.arms.forth[turning], arms[turning])
            np.testing.assert_array_equal(pair.arms.back[turning], arms[turning])
        assert np.isfinite(pair.arms.forth).all()
        assert np.isfinite(pair.arms.back).all()
        assert (pair.arms.forth <= np.where(between, np.maximum(arms, 1.0), 0.0)).all()
        pair.arms.ways[:] = np.nan
        assert np.isnan(ask_closing(pair.arms))


def test_levers_bound_what_a_box_without_an_end_says():
    random = np.random.default_rng(7)
    for _ in range(20):
        pair = Pair("panda", random, 0.05)
        pair.box.span[:] = np.array([np.inf, -np.inf, np.inf])[:, None]
        pair.fill()
        arms = pair.levers()
        assert (pair.arms.forth <= arms).all()
        assert (pair.arms.back <= arms).all()
