"""Arms that are laid out ahead: found when the robot has become what they are for, and fresh."""

import pickle

import coal
import pytest

from armguard.exceptions import RobotError
from armguard.monitor import Monitor
from armguard.obstacles import Obstacles
from armguard.robot import Robot
from armguard.scheduling.layouts import MOST, Layouts
from support.panda_monitor import HOME, PERIOD, STILL


class Arm:
    """What stands for an arm; it fits what has its name."""

    def __init__(self, name):
        self.name, self.taken = name, 0

    def fits(self, robot):
        return self.name == robot

    def take_over(self, robot):
        self.taken += 1


def test_what_was_laid_out_is_made_once_and_found_once():
    made = []
    layouts = Layouts(lambda robot: made.append(robot) or Arm(robot))
    layouts.prepare("rod")
    layouts.prepare("rod")
    assert made == ["rod"]
    arm, is_prepared = layouts.find("rod")
    assert is_prepared
    assert arm.taken == 1
    other, is_prepared = layouts.find("rod")
    assert not is_prepared
    assert other is not arm
    layouts.keep(arm)
    assert layouts.find("rod") == (arm, True)


def test_of_too_many_the_first_is_forgotten():
    layouts = Layouts(Arm)
    for number in range(MOST + 1):
        layouts.prepare(number)
    assert not layouts.find(0)[1]
    assert layouts.find(1)[1]


@pytest.fixture(scope="module")
def rod():
    robot = Robot.load("panda")
    return robot.prepare("rod", "panda_hand", coal.Box(0.05, 0.05, 0.6))


def drive(monitor, robot, rod):
    """Verdicts while a rod is attached, taken off, and attached again."""
    obstacles, verdicts = monitor.obstacles, []
    for tick in range(40):
        if tick in (10, 30):
            robot.attach_prepared(rod)
        if tick == 20:
            robot.detach("rod")
        now = tick * PERIOD
        obstacles.update(["ball"], now, [[1.0 - now, 0.1, 0.5]], [[-1.0, 0, 0]], 0.1, source="eye")
        verdicts.append(monitor.step(now, HOME, STILL))
    return verdicts


@pytest.mark.parametrize("schedule", ["deadline", "full"])
def test_no_verdict_is_another_for_what_was_laid_out_ahead(schedule, rod):
    """To the bit, so that a replay need not know of it; among what changes, limits in force."""
    told = []
    for is_prepared in (False, True):
        robot = Robot.load("panda")
        obstacles = Obstacles(sources=["eye"])
        obstacles.add_static("post", [0.5, 0.6, 0.4], 0.1)
        monitor = Monitor(robot, obstacles, schedule=schedule)
        arms = []
        if is_prepared:
            monitor.prepare(rod)
            assert robot.links == Robot.load("panda").links
            arms = list(monitor._scheduler._layouts._kept)
        monitor.payload = 1.0
        told.append(drive(monitor, robot, rod))
        if is_prepared:
            assert monitor._scheduler.arm is arms[0]
            assert monitor._scheduler.arm.links[-1] == "rod"
    assert repr(told[0]) == repr(told[1])


def test_a_body_out_of_a_pickle_is_the_one_that_was_laid_out(rod):
    robot = Robot.load("panda")
    monitor = Monitor(robot, Obstacles(sources=[]))
    monitor.prepare(pickle.loads(pickle.dumps(rod)))
    (arm,) = monitor._scheduler._layouts._kept
    robot.attach_prepared(pickle.loads(pickle.dumps(rod)))
    assert arm.fits(robot)
    robot.detach("rod")
    robot.attach_prepared(robot.prepare("rod", "panda_hand", coal.Box(0.05, 0.05, 0.61)))
    assert not arm.fits(robot)


def test_a_body_that_does_not_fit_is_refused_when_it_is_prepared(rod):
    robot = Robot.load("panda")
    monitor = Monitor(robot, Obstacles(sources=[]))
    robot.attach_prepared(rod)
    with pytest.raises(RobotError, match=r"rod.*has the name of another"):
        monitor.prepare(rod)
    assert monitor._scheduler._layouts._kept == []
