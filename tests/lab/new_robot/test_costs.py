"""Laws of what choices cost: the less is known of an arm, the sooner it stops for a person."""

import numpy as np
import pinocchio
import pytest

from armguard.lab.new_robot.costs import (
    WALKING_SPEED,
    choose_approach,
    choose_state,
    list_cases,
    measure,
)
from armguard.robot import Robot
from armguard.robot.ros_parameters import PlanningLimits
from support.urdf_arms import limits_for, two_links

OPERATING = {
    "published": {
        "sources": {"velocity": "a test", "acceleration": "a test"},
        "velocity": {"shoulder": 0.9},
        "acceleration": {"shoulder": 3.0},
    }
}
PLANNING = PlanningLimits((), {}, {}, 0.1, 1.0, ())


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    limits = limits_for("shoulder") | {"operating": OPERATING}
    return Robot.from_urdf(two_links(tmp_path_factory.mktemp("arm")), limits=limits)


@pytest.fixture(scope="module")
def figures(robot):
    return {case.name: measure(case) for case in list_cases(robot, PLANNING)}


def test_every_case_is_what_its_name_says(robot):
    cases = {case.name: case for case in list_cases(robot, PLANNING)}
    found = {
        name: [float(limit[0]) for limit in case.operating.resolve(robot)]
        for name, case in cases.items()
        if case.operating is not None
    }
    assert found == {
        "as written": [0.9, 3.0],
        "MoveIt's default scaling factors": [pytest.approx(0.09), 3.0],
        "operating velocities halved": [0.45, 3.0],
        "operating accelerations halved": [0.9, 1.5],
        "brakes twice as hard": [0.9, 3.0],
        "measurement errors halved": [0.9, 3.0],
    }
    assert [name for name in cases if name not in found] == ["without operating limits"]
    assert [case.name for case in list_cases(robot)] == [
        name for name in cases if not name.startswith("MoveIt")
    ]
    harder = cases["brakes twice as hard"].robot.brakes.entries["shoulder"][0]
    assert harder.deceleration == 4.0


def test_distances_are_those_of_the_walk_until_the_arm_rests(robot, figures):
    for case in list_cases(robot, PLANNING):
        stop_time, distance = figures[case.name]
        _, v = choose_state(robot, case.operating)
        # No less than what the person walks, unless the arm goes as far away from them at its
        # speed; no more than the person at their fastest and the arm's end at its own limit go.
        end = np.linalg.norm(choose_approach(robot, np.array([0.5]))[0])
        assert distance >= (WALKING_SPEED - end * v[0]) * stop_time
        assert distance <= (2.0 + end * robot.velocity_limit[0]) * stop_time + 0.05
        assert 0.0 < stop_time < 2.0


def test_the_person_is_as_far_from_the_arm_as_is_said(robot):
    q = np.array([0.5])
    end, way = choose_approach(robot, q)
    data = robot.model.createData()
    pinocchio.forwardKinematics(robot.model, data, q)
    corners = robot.triangles("upper").reshape(-1, 3)
    corners = np.array([data.oMi[1].act(corner) for corner in corners])
    gaps = np.linalg.norm(corners - (end + 0.3 * way), axis=1)
    assert gaps.min() == pytest.approx(0.3)
    assert way[2] == 0.0


def test_less_is_needed_of_an_arm_of_which_more_is_known(figures):
    written = figures["as written"]
    for name, one in figures.items():
        if name == "without operating limits":
            assert one.distance > written.distance
            assert one.stop_time > written.stop_time
        else:
            assert one.distance <= written.distance
            assert one.stop_time <= written.stop_time
    for name in ("brakes twice as hard", "MoveIt's default scaling factors"):
        assert figures[name].distance < written.distance
        assert figures[name].stop_time < written.stop_time


def test_brakes_that_are_not_stated_for_the_speed_stop_for_a_person_anywhere(tmp_path):
    limits = limits_for("shoulder") | {"operating": OPERATING}
    limits["brakes"] = [row | {"speed": 0.1} for row in limits["brakes"]]
    slow = Robot.from_urdf(two_links(tmp_path), limits=limits)
    assert measure(next(list_cases(slow))) == (np.inf, np.inf)


def test_the_robot_itself_is_left_as_it_is(robot, figures):
    assert figures
    assert robot.acceleration_limit[0] == 5.0
    assert robot.brakes.entries["shoulder"][0].deceleration == 2.0


def test_the_arm_works_at_a_share_of_its_operating_velocities(robot):
    q, v = choose_state(robot, None)
    np.testing.assert_allclose(q, [0.5])
    np.testing.assert_allclose(v, [0.2 * 0.9])
