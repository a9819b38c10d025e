"""What comes near another link on a piece is never missed, nor how far it closes in."""

import numpy as np
import pytest

from armguard.bounds import CheckedPlan, Plan, PlannedMotion, append_stop, check_plan
from armguard.bounds.arm import ArmMotion
from armguard.bounds.planned.clamps import find_closing_way
from armguard.jit.kernels import kernel
from armguard.obstacles.regions import ContactLimit
from armguard.robot.kinematics import Kinematics
from support.example_arms import load_arm
from support.plan_cases import Hermite

TIMES = np.linspace(0.0, 0.4, 41)
ERROR, SLACK = 1e-3, 1e-9
THICKNESS = 0.01


@kernel
def ask(course, arm, node, slab, limit):
    return find_closing_way(node, slab, limit, course, arm)


class Piece:
    """An arm that moves some joints at a constant rate, and stops."""

    def __init__(self, name, seed, rate):
        random = np.random.default_rng(seed)
        self.robot = robot = load_arm(name)
        gaps = ArmMotion(robot, 0.02, with_velocities=True).link_gaps
        self.motion = PlannedMotion(robot, gaps=gaps)
        self.kinematics = Kinematics(robot)
        lower = np.maximum(robot.lower_position_limit, -3.0)
        upper = np.minimum(robot.upper_position_limit, 3.0)
        nv = len(lower)
        home = lower + (upper - lower) * random.uniform(0.3, 0.7, nv)
        rates = rate * random.uniform(-1.0, 1.0, nv)
        q, v = home + TIMES[:, None] * rates, np.tile(rates, (len(TIMES), 1))
        plan = Plan(0.0, TIMES, q, v, np.full(nv, ERROR), np.full(nv, 0.01))
        plan = append_stop(plan, robot.braking_deceleration)
        checked = check_plan(plan, robot, 0.0, q[0], v[0], 0.0)
        assert isinstance(checked, CheckedPlan), checked
        self.course = self.motion.lay_out(checked, with_velocities=True)
        self.curve = Hermite(plan.times, plan.q, plan.v)
        self.end = float(plan.times[-1])

    def closing_way(self, node, slab, gap, thickness=THICKNESS, max_way=np.inf):
        limit = ContactLimit(1.0, max_way, gap, thickness)
        return ask(self.course, self.motion._arm, node, slab, limit)

    def trace(self, random, times):
        """Centres of all spheres along a motion on the piece, within its errors."""
        off = random.uniform(-ERROR, ERROR, len(self.robot.joints))
        centers = []
        for time in times:
            q = self.curve(min(time, self.end)) + off
            self.kinematics.compute(q, np.zeros(len(q)))
            centers.append(self.kinematics.centers.copy())
        return np.array(centers)


def find_closing_to_base(centers, reach, gaps):
    """How far a sphere on its way, (m, 3), comes nearer to balls of the base while it is near."""
    apart = np.linalg.norm(centers[:, None] - gaps.base[:, :3], axis=2)
    near = apart - gaps.base[:, 3] <= reach
    falls = np.where(near[1:] & near[:-1], -np.diff(apart, axis=0), 0.0)
    return falls.max(axis=1, initial=0.0).sum()


@pytest.mark.parametrize("name", ["panda", "ur5", "xarm7"])
def test_no_gap_that_closes_is_missed(name):
    random = np.random.default_rng(5)
    found, closest = 0, 0.0
    for seed in range(4):
        piece = Piece(name, seed, 0.4)
        arm, course = piece.motion._arm, piece.course
        times = np.linspace(0.0, course.end[-1], 60)
        centers = piece.trace(random, times)
        radius, parts = arm.tree.radius, arm.gaps.parts
        leaves = np.flatnonzero(arm.tree.first_child < 0)
        for node in random.choice(leaves, 12):
            slab = int(random.integers(len(course.start)))
            later = times >= course.start[slab]
            if not later.any():
                continue
            varies = arm.gaps.variation[node] > THICKNESS
            apart = np.linalg.norm(centers[later][:, node, None] - centers[later][:, parts], axis=2)
            gap = random.uniform(0.02, 0.3)
            near = varies & (apart - radius[node] - radius[parts] <= gap)
            way = piece.closing_way(node, slab, gap)
            way_to_base = find_closing_to_base(
                centers[later][:, node], gap + radius[node], arm.gaps
            )
            assert way_to_base <= way + SLACK
            # What is pressed may slip to the gap that closes fastest, again and again.
            falls = np.where(near[1:] & near[:-1], -np.diff(apart, axis=0), 0.0)
            closed = falls.max(axis=1, initial=0.0).sum()
            assert closed <= way + SLACK
            assert piece.closing_way(node, slab, gap, max_way=way) == way
            assert not way > 0.0 or piece.closing_way(node, slab, gap, max_way=0.9 * way) == np.inf
            closest = max(closest, closed / max(way, SLACK))
            moves = arm.moves[arm.carrier[node]] != arm.moves[arm.carrier[parts[near.any(axis=0)]]]
            turning = np.abs(piece.curve(0.1, 1)) > 1e-3
            if (moves & turning).any() and course.start[slab] < 0.4:
                assert way > 0.0
                found += 1
    assert found > 5
    assert closest > 0.1


def test_the_way_falls_along_a_piece_and_grows_with_the_gap():
    piece = Piece("panda", 1, 0.5)
    slabs = len(piece.course.start)
    leaves = np.flatnonzero(piece.motion._arm.tree.first_child < 0)
    for node in leaves[:: max(1, len(leaves) // 15)]:
        ways = [piece.closing_way(node, slab, 10.0) for slab in range(slabs)]
        assert (np.diff(ways) <= SLACK).all()
        by_gap = [piece.closing_way(node, 0, gap) for gap in (0.0, 0.1, 0.5, 10.0)]
        assert by_gap == sorted(by_gap)
        assert piece.closing_way(node, 0, np.nan) == by_gap[-1]


def test_links_that_no_joint_separates_clamp_nothing():
    piece = Piece("panda", 1, 0.5)
    arm = piece.motion._arm
    node = int(arm.tree.root[0])
    assert piece.closing_way(node, 0, 10.0, np.inf) <= piece.closing_way(node, 0, 10.0)
    still = Piece("panda", 1, 1e-9)
    assert still.closing_way(node, 0, 10.0) < piece.closing_way(node, 0, 10.0)
