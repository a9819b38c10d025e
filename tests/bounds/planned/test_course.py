import numpy as np
import pinocchio
import pytest

from armguard.bounds import compute_levers
from armguard.bounds.planned.course import close_deviation_along, deviation_along
from armguard.robot.joints import is_prismatic
from support.example_arms import load_holding
from support.motion_questions import unit


@pytest.fixture(scope="module", params=["panda", "kinova", "tiago"])
def question(request):
    """A robot, its last link's sphere centres, their levers, and which joints turn."""
    robot = load_holding(request.param)
    points = robot.cover.tree(robot.links[-1]).spheres[:, :3]
    numbers = [robot.model.getJointId(joint) for joint in robot.joints]
    turning = np.array([not is_prismatic(robot.model, number) for number in numbers])
    return robot, points, compute_levers(robot, robot.links[-1], points), turning


def configuration(robot, random):
    return random.uniform(
        np.maximum(robot.lower_position_limit, -4.0), np.minimum(robot.upper_position_limit, 4.0)
    )


@pytest.mark.parametrize("find", [deviation_along, close_deviation_along])
def test_no_configuration_in_the_box_is_further_off(question, find):
    robot, points, levers, turning = question
    model, data, random = robot.model, robot.model.createData(), np.random.default_rng(0)
    joint, closest = robot.joint_index(robot.links[-1]), 0.0
    for _ in range(150):
        low, high = robot.lower_position_limit, robot.upper_position_limit
        middle, row = configuration(robot, random), random.integers(len(points))
        half = random.uniform(0.0, 1.0, len(middle)) * random.choice([1e-4, 0.02, 0.3])
        half = np.minimum(half, np.minimum(high - middle, middle - low))
        jacobian = np.ascontiguousarray(pinocchio.computeJointJacobians(model, data, middle))
        place, along = data.oMi[joint].act(points[row]), unit(random)
        bound = find(tuple(along), tuple(place), jacobian, half, levers[row], turning)
        assert bound <= levers[row] @ half * (1.0 + 1e-9) + 1e-9
        slope = along @ (jacobian[:3] + np.cross(jacobian[3:].T, place).T)
        signs = [np.sign(slope), -np.sign(slope), *random.choice([-1.0, 1.0], (20, len(half)))]
        for sign in signs:
            pinocchio.forwardKinematics(model, data, middle + sign * half)
            way = along @ (data.oMi[joint].act(points[row]) - place)
            assert way <= bound
            closest = max(closest, way / bound)
    assert closest > 0.99


def test_to_third_order_the_bound_is_near_what_corners_of_the_box_reach(question):
    """Where the other one is not: in boxes as wide as a stop, of joints that all move."""
    robot, points, levers, turning = question
    model, data, random = robot.model, robot.model.createData(), np.random.default_rng(2)
    joint, off = robot.joint_index(robot.links[-1]), []
    for _ in range(60):
        middle, row = configuration(robot, random), random.integers(len(points))
        half = random.uniform(0.02, 0.08, len(middle))
        jacobian = np.ascontiguousarray(pinocchio.computeJointJacobians(model, data, middle))
        place, along = data.oMi[joint].act(points[row]), unit(random)
        way = 0.0
        slope = along @ (jacobian[:3] + np.cross(jacobian[3:].T, place).T)
        signs = [np.sign(slope), *random.choice([-1.0, 1.0], (40, len(half)))]
        for sign in signs:
            pinocchio.forwardKinematics(model, data, middle + sign * half)
            way = max(way, along @ (data.oMi[joint].act(points[row]) - place))
        given = (tuple(along), tuple(place), jacobian, half, levers[row], turning)
        off.append((deviation_along(*given) - way, close_deviation_along(*given) - way))
    far, close = np.mean(off, axis=0)
    assert 0.0 < close < 0.5 * far


@pytest.mark.parametrize("find", [deviation_along, close_deviation_along])
def test_no_box_no_way_and_nonsense_has_no_bound(question, find):
    robot, points, levers, turning = question
    model, data = robot.model, robot.model.createData()
    nothing = np.zeros(model.nv)
    middle = configuration(robot, np.random.default_rng(1))
    jacobian = np.ascontiguousarray(pinocchio.computeJointJacobians(model, data, middle))
    place = data.oMi[robot.joint_index(robot.links[-1])].act(points[0])
    still = find((0.0, 0.0, 1.0), tuple(place), jacobian, nothing, levers[0], turning)
    assert 0.0 <= still < 1e-10
    lost = nothing + np.nan
    off = find((0.0, 0.0, 1.0), tuple(place), jacobian, lost, levers[0], turning)
    assert not off < np.inf
