import numpy as np
import pytest

from armguard.lab.demo.nodes import SPEED_FRACTION, choose_acceleration
from armguard.lab.demo.places import find_place
from armguard.lab.simulation.arm import SimulatedArm
from armguard.lab.simulation.trajectory import keeps_within, random_trajectory
from armguard.robot import Robot
from armguard.robot.description import list_robots
from armguard.robot.operating_limits import OperatingLimits


@pytest.mark.parametrize("name", list_robots())
def test_every_arm_has_room_to_work_in(name):
    robot, place = Robot.load(name), find_place(name)
    # Its controller can slow it down and speed it up again.
    trajectory = random_trajectory(
        robot,
        0,
        30.0,
        speed_fraction=SPEED_FRACTION,
        acceleration_fraction=choose_acceleration(robot),
        accept=keeps_within(robot, place.lower, place.upper),
    )
    q, _ = SimulatedArm(trajectory, OperatingLimits.published(robot)).step(0.01, 0.5)
    assert np.isfinite(q).all()
    assert (np.array(place.lower) < place.upper).all()
