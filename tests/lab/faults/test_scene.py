import numpy as np
import pytest

from armguard.lab.faults.scene import (
    PEOPLE,
    make_trajectory,
    sample_people,
    visit_period,
)
from armguard.lab.faults.truth import Witness
from armguard.robot import Robot

SPEED, ACCEL = 2.0, 10.0  # what a cell takes bodies to be capable of unless told otherwise


@pytest.fixture(scope="module")
def robot():
    return Robot.load("panda")


def test_people_keep_to_the_bounds_that_the_cell_states_of_them(robot):
    period = visit_period(make_trajectory(robot))
    times = np.linspace(0.0, 2.0 * period, 4001)
    position = np.array([sample_people(time, period)[0] for time in times])
    velocity = np.array([sample_people(time, period)[1] for time in times])
    step = times[1] - times[0]
    assert np.gradient(position, step, axis=0)[1:-1] == pytest.approx(velocity[1:-1], abs=1e-3)
    assert np.linalg.norm(velocity, axis=-1).max() < SPEED
    accel = np.gradient(velocity, step, axis=0)
    assert np.linalg.norm(accel, axis=-1).max() < ACCEL
    assert position.shape[1:] == (len(PEOPLE), 2, 3)


def test_whoever_obeys_nothing_is_hit_in_every_visit(robot):
    trajectory = make_trajectory(robot)
    period = visit_period(trajectory)
    witness = Witness(robot)
    for visit in range(2):
        times = np.arange(visit * period, (visit + 1) * period, 0.005)
        states = [trajectory.sample(time) for time in times]
        found = witness.follow(
            times,
            np.array([q for q, _ in states]),
            np.array([v for _, v in states]),
            lambda time: sample_people(time, period)[0],
            only_first=True,
        )
        assert found.contacts == 1
