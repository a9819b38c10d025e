"""The box of displacements, against configurations drawn from it."""

import numpy as np
import pinocchio
import pytest

from armguard.bounds import compute_levers
from armguard.bounds.joint_table import (
    displacement_in_span,
    make_table,
    set_columns,
    set_span,
    stays_within,
)
from armguard.bounds.sums import turning_joints
from support.example_arms import load_arm
from support.motion_questions import HAND_POINT, unit


@pytest.fixture
def table():
    table = make_table(np.array([0.0, 1.0]), np.array([True, True]), np.zeros(2), True)
    table.high[:] = [[0.0, 1.0], [2.0, 1.5]]
    table.low[:] = [[0.0, -1.0], [-4.0, -0.5]]
    return table


def test_a_table_without_content_allows_everything():
    table = make_table(np.array([0.0, 1.0]), np.array([True]), np.zeros(1), True)
    set_span(table, 0, 0, 1.0)
    assert table.span.tolist() == [[np.inf], [-np.inf], [np.inf]]


def test_a_span_is_up_to_the_chord_and_never_inside_its_start(table):
    set_span(table, 0, 1, 0.5)
    assert table.span.tolist() == [[1.0, 1.25], [-2.0, -1.0], [2.0, 1.25]]


def test_a_span_without_interpolation_is_the_whole_step(table):
    table = table._replace(interpolates=False)
    set_span(table, 0, 1, 0.5)
    assert table.span.tolist() == [[2.0, 1.5], [-4.0, -1.0], [4.0, 1.5]]


def test_a_span_ends_where_displacements_are_clipped(table):
    table.highest[:] = [0.3, 9.0]
    table.lowest[:] = [-9.0, -0.2]
    set_span(table, 0, 1, 1.0)
    assert table.span.tolist() == [[0.3, 1.5], [-4.0, -0.2], [4.0, 1.5]]


@pytest.mark.parametrize("name", ["panda", "tiago"])
@pytest.mark.parametrize("size", [1e-3, 0.05, 0.4])
def test_no_configuration_in_the_box_is_further(name, size):
    robot, random = load_arm(name), np.random.default_rng(0)
    model, count = robot.model, robot.model.nv
    data, link = model.createData(), robot.links[-1]
    joint = robot.joint_index(link)
    (lever,) = compute_levers(robot, link, HAND_POINT[None])
    table = make_table(np.zeros(1), turning_joints(robot, link), np.zeros(count), True)
    tightest = np.inf
    for _ in range(40):
        start = random.uniform(-2.0, 2.0, count)
        start = np.clip(start, robot.lower_position_limit, robot.upper_position_limit)
        along = unit(random)
        low, high = np.sort(random.uniform(-size, size, (2, count)), axis=0)
        high, low = np.maximum(high, 0.0), np.minimum(low, 0.0)
        table.high[0], table.low[0] = high, low
        set_span(table, 0, 0, 1.0)
        jacobian = np.array(pinocchio.computeJointJacobians(model, data, start))
        place = data.oMi[joint].act(HAND_POINT)
        set_columns(*place, jacobian, table)
        bound = displacement_in_span(*along, jacobian, lever, np.zeros(count), table)
        slopes = along @ table.columns
        furthest = 0.0
        for moved in [np.where(slopes > 0.0, high, low), *random.uniform(low, high, (50, count))]:
            pinocchio.forwardKinematics(model, data, start + moved)
            furthest = max(furthest, along @ (data.oMi[joint].act(HAND_POINT) - place))
        assert furthest <= bound
        # What is said of it without its dearer part agrees.
        rest = jacobian, lever, np.zeros(count), table
        for room, stays in ((1.0 + 1e-9, True), (furthest / bound - 1e-9, False)):
            assert stays_within(room * bound, *along, *rest) == stays
        assert bound <= lever @ np.maximum(high, -low) * (1.0 + 1e-9)
        tightest = min(tightest, bound / furthest)
    assert tightest < 1.0 + 3.0 * size
