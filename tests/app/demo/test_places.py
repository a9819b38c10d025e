import numpy as np
import pytest

from armguard.app.demo.places import find_place
from armguard.robot import Robot
from armguard.robot.description import list_robots
from armguard.simulation.trajectory import keeps_within, random_trajectory


@pytest.mark.parametrize("name", list_robots())
def test_every_arm_has_room_to_work_in(name):
    robot, place = Robot.load(name), find_place(name)
    trajectory = random_trajectory(
        robot, 0, 30.0, speed_fraction=0.2, accept=keeps_within(robot, place.lower, place.upper)
    )
    assert trajectory.duration >= 30.0
    assert (np.array(place.lower) < place.upper).all()
