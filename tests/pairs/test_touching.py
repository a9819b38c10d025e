"""A body is touched where a leaf of the arm meets it as it was measured, however the arm moves.

Spheres of each level contain the link, so what a sphere above a leaf does not meet is not touched.
"""

import numpy as np
import pytest

from armguard.bounds.arm import ArmMotion
from armguard.jit.kernels import kernel
from armguard.obstacles import Obstacles
from armguard.pairs.evaluate import TickState
from armguard.pairs.touching import NO_LINK, find_touching_link
from armguard.robot.kinematics import Kinematics
from support.panda_monitor import panda
from support.tick_states import begin_tick

KINEMATICS = Kinematics(panda())
MOTION = ArmMotion(panda(), 0.02)
TREE, LINK = KINEMATICS.spheres.tree, KINEMATICS.spheres.link
LEAVES = np.flatnonzero(TREE.first_child < 0)
LINKS, MARGIN, NOW = len(panda().links), 0.01, 3.0


@kernel
def ask(handle, row, watched, now):
    return find_touching_link(handle, row, watched, now)


def nearest(center, points):
    """Way from a place to the nearest point of a segment or point."""
    if len(points) == 1:
        return points[0] - center
    along = points[1] - points[0]
    part = np.clip((center - points[0]) @ along / (along @ along), 0.0, 1.0)
    return points[0] + part * along - center


class World:
    """A Panda that moves at random, and a body that lies about where a leaf is."""

    def __init__(self, random, points=1, *, errors=True):
        robot = panda()
        low, high = robot.lower_position_limit, robot.upper_position_limit
        self.q = low + random.uniform(0.2, 0.8, len(low)) * (high - low)
        self.v = random.uniform(-0.5, 0.5, len(low)) * robot.velocity_limit
        KINEMATICS.compute(self.q, self.v)
        leaf = random.choice(LEAVES)
        self.points = KINEMATICS.centers[leaf] + random.normal(size=(points, 3)) * 0.08
        self.radius, self.error = random.uniform(0.01, 0.05), 0.01 if errors else 0.0
        self.obstacles = Obstacles(accel=5.0, speed=2.0)
        self.obstacles.update(
            ["body"], NOW - 0.01, self.points[None], random.normal(size=(1, points, 3)),
            radius=self.radius, position_error=self.error, region="hand",
        )  # fmt: skip
        self.row = self.obstacles.row("body")
        self.state = TickState(KINEMATICS, MOTION, self.obstacles, margin=MARGIN)
        begin_tick(self.state, NOW, 0.0, np.inf)
        KINEMATICS.place(self.q)
        self.state.prepare_arm(self.q, self.v)

    def ask(self, watched=None):
        watched = np.ones(LINKS, dtype=bool) if watched is None else watched
        return ask(self.state.handle, self.row, watched, NOW)

    def find(self):
        """Links that meet the body, and the least gap of a sphere."""
        arm = self.state.scene.arm
        ways = np.array([nearest(center, self.points) for center in arm.centers])
        away = np.linalg.norm(ways, axis=1)
        gap = away - TREE.radius - self.radius - MARGIN - self.error - arm.position_error
        meets = set()
        for leaf in LEAVES:
            node = leaf
            while node >= 0 and gap[node] <= 0.0:
                node = TREE.parent[node]
            if node >= 0:
                continue
            meets.add(int(LINK[leaf]))
        return meets, abs(gap).min()


@pytest.mark.parametrize("points", [1, 2])
def test_who_is_touched_is_met_by_a_leaf(points):
    random = np.random.default_rng(points)
    touched = free = 0
    for _ in range(150):
        world = World(random, points)
        meets, closest = world.find()
        if closest < 1e-6:
            continue
        found = world.ask()
        assert (found != NO_LINK) == bool(meets)
        assert found == NO_LINK or found in meets
        touched += found != NO_LINK
        free += not meets
        # Of links that are not watched nothing is said.
        watched = np.ones(LINKS, dtype=bool)
        watched[list(meets)] = False
        assert world.ask(watched) == NO_LINK
    assert min(touched, free) > 3


def test_every_state_that_may_be_true_counts():
    random = np.random.default_rng(9)
    world = World(random)
    while not world.find()[0]:
        world = World(random)
    table = world.obstacles.table
    # The accepted state is far away, and the other one was refused.
    world.obstacles.update(
        ["body"], NOW, world.points[None] + 3.0, np.zeros((1, 1, 3)), radius=world.radius,
        region="hand",
    )  # fmt: skip
    assert table.marks.refused[world.row]
    assert world.ask() != NO_LINK
    table.accepted.points[world.row] += 50.0
    assert world.ask() == NO_LINK


def test_of_what_nothing_is_known_nothing_is_touched():
    world = World(np.random.default_rng(9))
    world.obstacles.table.marks.has_state[world.row] = False
    assert world.ask() == NO_LINK
