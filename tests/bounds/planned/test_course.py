import numpy as np
import pytest

from armguard.bounds import PlannedMotion, check_plan
from armguard.bounds.planned.course import find_center, set_slab
from support.example_arms import load_holding
from support.plan_cases import place_spheres
from support.short_plans import HOME, NOW, STILL, resting


@pytest.fixture(scope="module")
def arm_and_course():
    robot = load_holding("panda")
    motion = PlannedMotion(robot)
    return motion._arm, motion.lay_out(check_plan(resting(), robot, NOW, HOME, STILL, NOW))


def test_centers_are_those_of_spheres_that_joints_carry(arm_and_course):
    arm, course = arm_and_course
    centers = place_spheres(arm, course.placement)
    for node in range(0, len(arm.carrier), 7):
        assert find_center(arm, course.placement[0], node) == pytest.approx(centers[0, node])


def test_a_slab_is_around_its_middle_and_what_is_not_finite_is_told(arm_and_course):
    arm, course = arm_and_course
    assert set_slab(arm, course, 0, (0.3, 0.0, 0.5))
    half = course.half[0]
    np.testing.assert_array_equal(arm.box.span, [half, -half, half])
    assert not set_slab(arm, course, 0, (np.nan, 0.0, 0.5))
    assert not set_slab(arm, course, 0, (np.inf, 0.0, 0.5))
