import math

import numpy as np
import pinocchio
import pytest

from armguard.pairs.hull_distance import HullDistance
from armguard.pairs.hull_gap import hull_gap, lay_out_hulls
from armguard.robot import Kinematics, Robot
from support.nearest_points import closest_in_hull

TOLERANCE = 1e-5
BASE = pinocchio.SE3(pinocchio.utils.rotate("z", 0.4), np.array([0.5, -0.3, 0.2]))
SHAPES = {
    "ball": np.zeros((1, 3)),
    "capsule": np.array([[0.0, 0.0, 0.0], [0.2, 0.1, -0.3]]),
    "point twice": np.zeros((2, 3)),
    "triangle": np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.1], [0.0, 0.4, 0.2]]),
    "line of three": np.outer([0.0, 0.3, 1.0], [0.3, -0.2, 0.1]),
    "plate": np.array([[x, y, 0.0] for x in (0.0, 0.6) for y in (0.0, 0.4)]),
    "needle": np.array([[0.0, 0.0, 0.0], [1.5, 1e-7, 0.0], [1.5, 0.0, 1e-7], [3.0, 0.0, 0.0]]),
    "box": np.array([[x, y, z] for x in (0.0, 0.3) for y in (0.0, 0.2) for z in (0.0, 0.1)]),
    "tiny box": 1e-9 * np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]),
}


class Arm:
    """A robot's links, measured by Coal and by the compiled walk."""

    def __init__(self, name):
        self.robot = Robot.load(name)
        self.kinematics = Kinematics(self.robot, BASE)
        self.coal = HullDistance(self.robot, self.kinematics)
        self.hulls = lay_out_hulls(self.coal.vertices, self.coal.joints)
        self.links = len(self.robot.links)

    def place(self, random):
        lower = np.maximum(self.robot.lower_position_limit, -math.pi)
        upper = np.minimum(self.robot.upper_position_limit, math.pi)
        self.kinematics.compute(random.uniform(lower, upper), np.zeros(len(lower)))

    def gap(self, link, points, radius):
        points = np.ascontiguousarray(points, dtype=float)
        return hull_gap(self.hulls, link, self.kinematics.placement, points, len(points), radius)

    def middle(self, link):
        return self.kinematics.centers[self.kinematics.spheres.root[link]]


@pytest.fixture(scope="module", params=["panda", "ur5"])
def arm(request):
    return Arm(request.param)


def turn(random):
    return pinocchio.Quaternion(*random.normal(size=4)).normalized().matrix()


@pytest.mark.parametrize("shape", SHAPES)
def test_it_is_as_near_to_the_truth_as_coal(arm, shape):
    random, apart, overlapping = np.random.default_rng(0), 0, 0
    for _ in range(12):
        arm.place(random)
        for link in range(arm.links):
            direction = random.normal(size=3)
            direction *= random.choice([0.0, 0.05, 0.15, 0.3, 1.0, 40.0]) / np.linalg.norm(
                direction
            )
            corners = arm.middle(link) + direction + SHAPES[shape] @ turn(random).T
            radius = float(random.choice([0.0, 1e-6, 0.1]))
            distance, _, _ = arm.coal.distance(link, corners, radius)
            gap = arm.gap(link, corners, radius)
            if distance > TOLERANCE:
                apart += 1
                # Coal's is proved, too: neither can be above the truth.
                assert distance - TOLERANCE * max(1.0, distance) <= gap
                assert gap <= distance + 2.0 * TOLERANCE
            else:
                overlapping += 1
                assert gap <= 2.0 * TOLERANCE
    assert apart > 20
    assert overlapping > 2


@pytest.mark.parametrize("shape", ["ball", "capsule", "plate", "box"])
def test_no_points_of_the_two_bodies_are_nearer(arm, shape):
    random = np.random.default_rng(1)
    for _ in range(3):
        arm.place(random)
        for link in range(arm.links):
            direction = random.normal(size=3)
            direction *= random.choice([0.2, 0.5]) / np.linalg.norm(direction)
            corners = arm.middle(link) + direction + SHAPES[shape] @ turn(random).T
            placement = arm.kinematics.data.oMi[arm.coal.joints[link]]
            vertices = arm.coal.vertices[link] @ placement.rotation.T + placement.translation
            differences = (corners[:, None] - vertices[None]).reshape(-1, 3)
            found = np.linalg.norm(closest_in_hull(differences))
            assert arm.gap(link, corners, 0.0) <= found


def test_bodies_that_touch_are_told_to_a_hair(arm):
    random = np.random.default_rng(2)
    arm.place(random)
    for link in range(arm.links):
        direction = random.normal(size=3)
        corners = arm.middle(link) + direction + SHAPES["box"] @ turn(random).T
        distance, on_link, on_box = arm.coal.distance(link, corners, 0.0)
        normal = (on_box - on_link) / np.linalg.norm(on_box - on_link)
        for depth in (1e-3, 1e-6, 0.0, -1e-6, -1e-3, -0.01):
            gap = arm.gap(link, corners - (distance - depth) * normal, 0.0)
            assert gap <= max(depth, 0.0) + TOLERANCE
            if depth > 0.0:
                assert gap >= depth - TOLERANCE


def test_an_obstacle_around_the_link_is_no_gap(arm):
    arm.place(np.random.default_rng(3))
    around = np.array([[x, y, z] for x in (-2, 2) for y in (-2, 2) for z in (-2, 2)], dtype=float)
    for link in range(arm.links):
        vertex = arm.coal.vertices[link][0]
        placement = arm.kinematics.data.oMi[arm.coal.joints[link]]
        assert arm.gap(link, arm.middle(link) + around, 0.0) <= 0.0
        assert arm.gap(link, [placement.act(vertex)], 0.0) <= 0.0
        assert arm.gap(link, [arm.middle(link)], 1e6) <= -9e5


@pytest.mark.parametrize("distance", [1e3, 1e6, 1e12])
def test_far_away_rounding_errs_to_the_safe_side(arm, distance):
    arm.place(np.random.default_rng(4))
    for link in range(arm.links):
        for axis in np.concatenate([np.eye(3), -np.eye(3)]):
            gap = arm.gap(link, [distance * axis], 0.0)
            assert distance * (1.0 - 1e-5) - 3.0 <= gap
            # No part of an arm is farther from its base than this.
            assert gap <= distance + 3.0


def test_what_is_no_number_is_no_gap(arm):
    arm.place(np.random.default_rng(5))
    corners = arm.middle(0) + 1.0 + SHAPES["box"]
    for bad in (math.nan, math.inf, -math.inf):
        for place in range(8):
            broken = corners.copy()
            broken[place, place % 3] = bad
            assert arm.gap(0, broken, 0.0) == -math.inf
        assert arm.gap(0, np.full((1, 3), bad), 0.0) == -math.inf
    assert arm.gap(0, corners, math.nan) == -math.inf
    assert arm.gap(0, corners, math.inf) == -math.inf
