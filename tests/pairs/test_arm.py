import coal
import numpy as np
import pytest

from armguard.monitor import Monitor
from armguard.obstacles import Obstacles
from armguard.robot import Robot
from support.panda_monitor import HOME, STILL, make_monitor, panda, see, steps


def arm_of(monitor):
    return monitor._scheduler.arm


@pytest.fixture(scope="module")
def seen():
    """A monitor that has seen one ball, in its only row."""
    obstacles, monitor = make_monitor(ignore=[("panda_hand", "ba*")])
    see(obstacles, 0.0, [0.9, 0.0, 0.5])
    steps(monitor, 0, 1)
    return obstacles, monitor


def test_bounds_widen_once_when_a_joint_is_faster_than_its_limit():
    _, monitor = make_monitor()
    arm, top = arm_of(monitor), panda().velocity_limit
    before = arm.motion.isotropic.speed.copy()
    assert not arm.follow_limits(top)
    assert arm.follow_limits(1.05 * top)
    assert (arm.motion.isotropic.speed > before).all()
    assert not arm.follow_limits(1.02 * top)
    assert not arm.follow_limits(0.0 * top)
    assert np.array_equal(arm.motion.isotropic.speed, before)
    assert arm.follow_limits(1.02 * top)


def test_what_is_attached_later_does_not_reach_an_arm_that_is_laid_out():
    robot = Robot.load("panda")
    monitor = Monitor(robot, Obstacles(sources=[]))
    arm = arm_of(monitor)
    links = arm.links
    robot.attach("tool", "panda_hand", coal.Sphere(0.05))
    assert (arm.links, arm.revision) == (links, 0)
    monitor.step(0.0, HOME, STILL)
    assert arm_of(monitor).links == robot.links
    assert arm_of(monitor).revision == robot.revision


def test_a_proof_is_about_the_pair_that_was_asked_for(seen):
    obstacles, monitor = seen
    arm = arm_of(monitor)
    arm.kinematics.compute(HOME, STILL)
    links = len(arm.links)
    for link in range(links):
        pair = obstacles.row("ball") * links + link
        certificate, inputs = arm.prove(pair, int(arm.state.tree.root[link]))
        assert certificate.contact_time >= 0.0
        assert np.allclose(inputs["p2"], [[0.9, 0.0, 0.5]])
    see(obstacles, 0.001, [np.nan, 0.0, 0.0])
    steps(monitor, 1, 1)
    assert arm.prove(obstacles.row("ball") * links, 0) is None
