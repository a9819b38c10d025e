"""Laws of what choices cost: the less is known of an arm, the sooner it stops for a person."""

import numpy as np
import pytest

from armguard.app.new_robot.costs import choose_state, list_cases, measure
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


def test_every_case_has_finite_figures(figures):
    assert len(figures) == 9
    for one in figures.values():
        assert 0.0 < one.stop_time < 2.0
        assert 0.0 < one.reach < one.approach < 5.0


def test_less_is_needed_of_an_arm_of_which_more_is_known(figures):
    written = figures["as written"]
    for name, one in figures.items():
        worse = name in ("no operating limits", "one ball a link")
        assert one.approach >= written.approach if worse else one.approach <= written.approach
    assert figures["brakes twice as hard"].stop_time < written.stop_time
    slower = figures["operating limits by the default scaling factors"]
    assert slower.approach < written.approach


def test_the_robot_itself_is_left_as_it_is(robot, figures):
    assert figures
    assert robot.acceleration_limit[0] == 5.0
    assert robot.brakes.entries["shoulder"][0].deceleration == 2.0


def test_the_arm_works_at_a_share_of_its_operating_velocities(robot):
    q, v = choose_state(robot, None)
    np.testing.assert_allclose(q, [0.5])
    np.testing.assert_allclose(v, [0.2 * 0.9])
