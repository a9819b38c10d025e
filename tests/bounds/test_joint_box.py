"""The box of displacements, against configurations drawn from it."""

import numpy as np
import pinocchio
import pytest

from armguard.bounds import compute_levers
from armguard.bounds.joint_box import (
    _displacement_by_levers,
    _displacement_by_second_derivatives,
    displacement_in_box,
    make_box,
    set_columns,
    stays_within,
)
from armguard.bounds.sums import turning_joints
from support.example_arms import load_holding
from support.motion_questions import unit


class Question:
    """A point of an arm's last link, a direction, and a box of displacements."""

    def __init__(self, name):
        self.robot = load_holding(name)
        self.model, self.data = self.robot.model, self.robot.model.createData()
        link = self.robot.links[-1]
        self.joint = self.robot.joint_index(link)
        self.points = self.robot.cover.tree(link).spheres[:, :3]
        self.levers = compute_levers(self.robot, link, self.points)
        self.turning = turning_joints(self.robot, link)

    def place(self, q):
        pinocchio.forwardKinematics(self.model, self.data, q)
        return self.data.oMi[self.joint].act(self.point)

    def draw(self, random, low, high, error=0.0):
        """Take a configuration that is measured within an error, and a box around it."""
        lower = np.maximum(self.robot.lower_position_limit, -4.0)
        upper = np.minimum(self.robot.upper_position_limit, 4.0)
        count = self.model.nv
        self.start = random.uniform(lower, upper)
        self.true = self.start + error * random.choice([-1.0, 1.0], count)
        row = random.integers(len(self.points))
        self.point, self.lever = self.points[row], self.levers[row]
        self.along = unit(random)
        self.box = make_box(self.turning, np.full(count, error))
        self.box.span[:] = high, low, np.maximum(high, -low)
        # sum_j R_max(i, j) dq_j: the more distal of two joints decides.
        pairs = np.maximum.outer(np.arange(count), np.arange(count))
        moves = self.lever > 0.0
        self.error = (self.lever[pairs] * moves * error).sum(axis=1) * moves
        self.jacobian = np.array(
            pinocchio.computeJointJacobians(self.model, self.data, self.start)
        ).reshape(6, -1)
        set_columns(*self.place(self.start), self.jacobian, self.box)
        self.given = tuple(self.along), self.jacobian, self.lever, self.error, self.box
        return displacement_in_box(*self.given)

    def find_furthest(self, random, tries):
        """The furthest that the point gets, by configurations of the box and its corners."""
        high, low, _ = self.box.span
        first, furthest = self.place(self.true), -np.inf
        corners = np.where(random.random((tries, len(high))) < 0.5, high, low)
        slopes = np.where(self.along @ self.box.columns > 0.0, high, low)
        for moved in [slopes, *corners, *random.uniform(low, high, (tries, len(high)))]:
            furthest = max(furthest, self.along @ (self.place(self.true + moved) - first))
        return furthest


@pytest.fixture(scope="module", params=["panda", "kinova", "tiago"])
def question(request):
    return Question(request.param)


@pytest.mark.parametrize("size", [1e-4, 0.02, 0.1, 0.4])
@pytest.mark.parametrize("error", [0.0, 5e-3])
def test_no_configuration_in_the_box_is_further(question, size, error):
    """The box may lie beside the configuration, as that of a joint that cannot turn back does."""
    random, tightest = np.random.default_rng(0), np.inf
    for _ in range(40):
        low, high = np.sort(random.uniform(-size, size, (2, question.model.nv)), axis=0)
        bound = question.draw(random, low, high, error)
        furthest = question.find_furthest(random, 40)
        assert furthest <= bound
        most = question.lever @ np.maximum(high, -low)
        assert bound <= most * (1.0 + 1e-9)
        # What is said of it in two steps agrees.
        assert stays_within(bound + 1e-9 * most, *question.given)
        assert not stays_within(bound - 1e-9 * most, *question.given)
        tightest = min(tightest, (bound - furthest) / most)
    assert tightest < 0.05 + 3.0 * size + 10.0 * error


def test_the_bound_is_near_what_corners_of_a_wide_box_reach(question):
    """As wide as a stop, with all joints moving: Taylor's bound is twice as far off."""
    random, off = np.random.default_rng(2), []
    for _ in range(60):
        half = random.uniform(0.02, 0.08, question.model.nv)
        bound = question.draw(random, -half, half)
        furthest = question.find_furthest(random, 40)
        lever, slopes = question.lever, np.abs(question.along @ question.box.columns)
        moving = np.where(lever > 0.0, half, 0.0)
        before = np.cumsum(moving) - moving
        taylor = min(slopes, lever, key=lambda each: each @ half) @ half
        taylor += lever @ (moving * (0.5 * moving + before))
        off.append((taylor - furthest, bound - furthest))
    far, close = np.mean(off, axis=0)
    assert 0.0 < close < 0.5 * far


@pytest.mark.parametrize("spread", [0.0, 1.0])
@pytest.mark.parametrize("error", [0.0, 0.05])
@pytest.mark.parametrize("count", [1, 2, 4, 7])
def test_both_bounds_hold_for_a_point_that_turns_about_one_axis(count, error, spread):
    """Where all joints share an axis, all terms of every order add up: each is needed in full."""
    random = np.random.default_rng(count)
    jacobian = np.vstack([np.zeros((5, count)), np.ones(count)])
    box = make_box(np.ones(count, dtype=bool), np.full(count, error))
    lever, slope_error = np.ones(count), np.full(count, count * error)
    set_columns(1.0, 0.0, 0.0, jacobian, box)
    closest = {_displacement_by_levers: np.inf, _displacement_by_second_derivatives: np.inf}
    for _ in range(400):
        middle = random.uniform(-0.4, 0.4) * random.choice([0.1, 1.0])
        low, high = middle + spread * random.uniform(0.0, 0.3, (2, count)) * [[-1.0], [1.0]]
        box.span[:] = high, low, np.maximum(np.abs(high), np.abs(low))
        way = random.uniform(-np.pi, np.pi)
        normal = np.cos(way), np.sin(way), 0.0
        # The point is at an angle that is known within errors, and turns from there.
        start = count * error * np.linspace(-1.0, 1.0, 21)[:, None]
        end = start + np.linspace(low.sum(), high.sum(), 200)
        furthest = (np.cos(way - end) - np.cos(way - start)).max()
        bounds = {
            _displacement_by_levers: _displacement_by_levers(normal, lever, slope_error, box),
            _displacement_by_second_derivatives: _displacement_by_second_derivatives(
                normal, jacobian, lever, slope_error, box
            ),
        }
        for name, bound in bounds.items():
            assert furthest <= bound
            closest[name] = min(closest[name], bound - furthest)
    assert spread or max(closest.values()) < 0.02 + 5.0 * count * error


@pytest.mark.parametrize("count", [1, 3])
def test_position_errors_count_in_the_terms_of_third_order(count):
    """R (|D| + s dq) products, averaged along the path: D D dq / 2 and D dq dq / 2 in all."""
    size, error, ones = 0.2, 0.05, np.ones(count)
    jacobian = np.vstack([np.zeros((5, count)), ones])
    found = []
    for each in (0.0, error):
        box = make_box(np.ones(count, dtype=bool), each * ones)
        box.span[:] = size * ones, -size * ones, size * ones
        set_columns(1.0, 0.0, 0.0, jacobian, box)
        given = (0.0, 1.0, 0.0), jacobian, ones, 0.0 * ones, box
        found.append(_displacement_by_second_derivatives(*given))
    least = count**3 * (0.5 * size * size * error + 0.5 * size * error * error)
    assert found[1] - found[0] >= least * (1.0 - 1e-9)


def test_an_empty_box_moves_nothing_and_nan_has_no_bound(question):
    random, nothing = np.random.default_rng(1), np.zeros(question.model.nv)
    assert 0.0 <= question.draw(random, nothing, nothing) < 1e-10
    assert not question.draw(random, nothing + np.nan, nothing + np.nan) < np.inf
