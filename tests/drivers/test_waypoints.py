"""Laws of a way between waypoints: its speed, its accelerations, and rest at each of them."""

import numpy as np
import pytest

from armguard.drivers.waypoints import Waypoints

PERIOD = 0.001
VELOCITIES, ACCELERATIONS, DECELERATION = np.array([0.8, 0.5, 0.3]), np.array([2.0, 1.0, 3.0]), 2.5
POINTS = [[0.3, -0.2, 0.1], [-0.3, 0.2, 0.1], [0.0, 0.0, 0.0]]
START = [0.05, 0.0, 0.0]


@pytest.fixture
def way():
    way = Waypoints(POINTS, VELOCITIES, ACCELERATIONS, DECELERATION, PERIOD)
    way.begin(START)
    return way


def run(way, fractions):
    return np.array([START, START, *(way.advance(fraction) for fraction in fractions)])


def test_it_goes_through_all_waypoints_again_and_again_within_its_limits(way):
    path = run(way, np.full(10_000, 1.0))
    order = []
    for q in path:
        for number, point in enumerate(POINTS):
            if np.abs(q - point).max() < 1e-12 and (not order or order[-1] != number):
                order.append(number)
    assert order[:5] == [0, 1, 2, 0, 1]
    v = np.diff(path, axis=0) / PERIOD
    a = np.diff(v, axis=0) / PERIOD
    assert (np.abs(v) <= VELOCITIES + 1e-9).all()
    assert (np.abs(v).max(0) > 0.45 * VELOCITIES).any()
    hardest = np.maximum(ACCELERATIONS, DECELERATION)
    is_hard = (np.abs(a) > hardest * 1.001 + 1e-6).any(axis=1)
    # At a waypoint it may stop and begin within one period.
    assert (np.abs(a) <= ACCELERATIONS + DECELERATION + 1e-6).all()
    corners = [np.abs(path[1:-1] - point).max(1) < 1e-12 for point in POINTS]
    assert not (is_hard & ~np.any(corners, axis=0)).any()


@pytest.mark.parametrize("after", [50, 300, 480, 600, 900])
def test_a_fraction_of_nothing_brings_it_to_rest_in_time_wherever_it_is(way, after):
    path = run(way, [*np.full(after, 1.0), *np.zeros(500)])
    v = np.diff(path, axis=0) / PERIOD
    longest = VELOCITIES.max() / DECELERATION
    assert (v[after + 2 + int(longest / PERIOD) :] == 0.0).all()
    a = np.diff(v[after:], axis=0) / PERIOD
    assert np.abs(a).max() <= DECELERATION * 1.05
    assert way.pace == 0.0


def test_a_fraction_is_that_of_the_speed(way):
    slow = run(way, np.full(3000, 0.25))
    assert (np.abs(np.diff(slow, axis=0)) / PERIOD <= 0.25 * VELOCITIES + 1e-9).all()


def test_a_waypoint_where_the_joints_are_already_is_passed(way):
    way.begin(POINTS[0])
    first = way.advance(1.0)
    path = np.array([way.advance(1.0) for _ in range(3000)])
    assert np.isfinite([*first, *path.ravel()]).all()
    assert np.abs(path - POINTS[1]).max(1).min() < 1e-12
