import numpy as np
import pinocchio
import pytest

from armguard.exceptions import ArmguardError
from armguard.pairs.hull_distance import HullDistance, _build_hull
from armguard.robot import Kinematics, Robot
from support.nearest_points import closest_in_hull

TOLERANCE = 1e-5


@pytest.fixture(scope="module")
def robot():
    return Robot.load("panda")


@pytest.fixture(scope="module")
def kinematics(robot):
    kinematics = Kinematics(robot, pinocchio.SE3(np.eye(3), np.array([0.5, -0.3, 0.2])))
    kinematics.compute(np.array([0.3, -0.5, 0.2, -1.8, 0.4, 1.6, 0.7]), np.zeros(7))
    return kinematics


@pytest.fixture(scope="module")
def exact(robot, kinematics):
    return HullDistance(robot, kinematics)


def true_distance(robot, kinematics, link_index, corners, radius):
    """Feasible points of both bodies: never below the true distance."""
    link = robot.links[link_index]
    placement = kinematics.data.oMi[robot.joint_index(link)]
    vertices = robot.hull(link) @ placement.rotation.T + placement.translation
    differences = (corners[:, None] - vertices[None]).reshape(-1, 3)
    return np.linalg.norm(closest_in_hull(differences)) - radius


def random_obstacle(random, kinematics, link_index, kind):
    root = kinematics.spheres.root[link_index]
    direction = random.normal(size=3)
    center = kinematics.centers[root] + random.choice([0.3, 0.5, 2.0]) * direction
    size = random.choice([1e-3, 0.05, 0.3])
    shapes = {
        "ball": np.zeros((1, 3)),
        "capsule": random.normal(size=(2, 3)),
        "point twice": np.zeros((2, 3)),
        "triangle": random.normal(size=(3, 3)),
        "line of three": np.outer([0.0, 0.3, 1.0], random.normal(size=3)),
        "point thrice": np.zeros((3, 3)),
        "flat": random.normal(size=(6, 3)) * [1.0, 1.0, 0.0],
        "hull": random.normal(size=(8, 3)),
        "box": np.stack(np.meshgrid([-1, 1], [-1, 1], [-1, 1]), axis=-1).reshape(8, 3),
    }
    turn = np.linalg.qr(random.normal(size=(3, 3)))[0]
    return center + size * shapes[kind] @ turn, float(random.choice([0.0, 0.02, 0.1]))


@pytest.mark.parametrize(
    "kind",
    [
        "ball",
        "capsule",
        "point twice",
        "triangle",
        "line of three",
        "point thrice",
        "flat",
        "hull",
        "box",
    ],
)
def test_distances_are_never_too_large_and_hardly_too_small(robot, kinematics, exact, kind):
    random = np.random.default_rng(0)
    apart = 0
    for round_ in range(120):
        link_index = round_ % len(robot.links)
        corners, radius = random_obstacle(random, kinematics, link_index, kind)
        truth = true_distance(robot, kinematics, link_index, corners, radius)
        found, on_link, on_obstacle = exact.distance(link_index, corners, radius)
        assert found <= truth + 1e-12
        if truth > 1e-9:
            apart += 1
            assert found >= truth - TOLERANCE
            assert np.linalg.norm(on_obstacle - on_link) == pytest.approx(truth, abs=1e-4)
    assert apart > 60


def test_the_middle_of_a_link_is_not_free(robot, kinematics, exact):
    for index, link in enumerate(robot.links):
        placement = kinematics.data.oMi[robot.joint_index(link)]
        middle = placement.act(robot.hull(link).mean(axis=0))
        distance, _, _ = exact.distance(index, middle[None], 0.001)
        assert distance < -0.001


def test_overlap_is_negative_to_the_depth(robot, kinematics, exact):
    for index in range(len(robot.links)):
        center = kinematics.centers[kinematics.spheres.root[index]]
        far = center + np.array([0.0, 0.0, 3.0])
        clear, _, _ = exact.distance(index, far[None], 0.0)
        grown, _, _ = exact.distance(index, far[None], clear + 0.2)
        assert grown == pytest.approx(-0.2, abs=TOLERANCE)


@pytest.mark.parametrize("scale", [1e-300, 1e6, 1e150, 1e300])
@pytest.mark.parametrize("count", [1, 2, 3, 8])
def test_extreme_places_stay_safe(robot, kinematics, exact, scale, count):
    corners = scale * np.random.default_rng(7).uniform(0.5, 1.5, (count, 3))
    distance, _, _ = exact.distance(2, corners, 0.1)
    nearest = corners[np.argmin(corners @ np.ones(3))]
    reach = 2.0
    assert np.isfinite(distance)
    assert distance <= np.abs(nearest).max() * np.sqrt(3.0) + reach
    assert exact.distance(2, corners, 1e300)[0] < 0.0 or scale == 1e300


@pytest.mark.parametrize("vertices", [1, 2, 4])
def test_flat_links_get_a_hull_that_contains_them(vertices):
    plate = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]])
    hull = _build_hull(plate[:vertices])
    corners = np.array(hull.points())
    for direction in np.random.default_rng(8).normal(size=(50, 3)):
        assert (corners @ direction).max() >= (plate[:vertices] @ direction).max()


@pytest.mark.parametrize(
    ("arguments", "offender"),
    [
        ((-1, np.zeros((1, 3)), 0.1), "link index"),
        ((99, np.zeros((1, 3)), 0.1), "link index"),
        ((0, np.zeros(3), 0.1), "points"),
        ((0, np.zeros((0, 3)), 0.1), "points"),
        ((0, np.zeros((2, 2)), 0.1), "points"),
        ((0, np.full((1, 3), np.nan), 0.1), "obstacle or arm"),
        ((0, np.full((1, 3), np.inf), 0.1), "obstacle or arm"),
        ((0, np.zeros((1, 3)), -0.1), "obstacle or arm"),
        ((0, np.zeros((1, 3)), np.nan), "obstacle or arm"),
        ((0, np.zeros((1, 3)), np.inf), "obstacle or arm"),
    ],
)
def test_bad_obstacles_are_refused(exact, arguments, offender):
    with pytest.raises(ArmguardError) as caught:
        exact.distance(*arguments)
    assert caught.value.offender == offender


def test_an_unknown_arm_is_refused(robot):
    kinematics = Kinematics(robot)
    exact = HullDistance(robot, kinematics)
    kinematics.compute(np.full(7, np.nan), np.zeros(7))
    with pytest.raises(ArmguardError, match="obstacle or arm"):
        exact.distance(6, np.zeros((1, 3)), 0.1)
