import numpy as np
import pytest

import armguard
from armguard.certificate import verify

READY = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]


@pytest.fixture(scope="module")
def robot():
    return armguard.Robot.load("panda")


def judge(robot, schedule, position, velocity, **options):
    obstacles = armguard.Obstacles()
    monitor = armguard.Monitor(robot, obstacles, certify=True, schedule=schedule)
    obstacles.update(["it"], -0.004, position, velocity, radius=0.1, **options)
    return monitor, monitor.step(0.0, READY, np.full(7, 0.1), 0.001)


@pytest.mark.parametrize("schedule", ["deadline", "full", "daa"])
@pytest.mark.parametrize(
    ("position", "velocity"),
    [
        ([[1.8, 0.2, 0.6]], [[-1.0, 0.0, 0.0]]),
        ([[-1.5, 1.0, 0.2]], [[0.5, 0.0, 1.0]]),
        ([[[1.8, 0.2, 0.6], [1.8, 0.4, 0.9]]], [[[-1.0, 0.0, 0.0], [-1.0, 0.1, 0.0]]]),
        ([[6.0, 0.0, 0.5]], [[0.0, 0.0, 0.0]]),
    ],
)
def test_the_certificate_proves_the_verdicts_time(robot, schedule, position, velocity):
    monitor, verdict = judge(robot, schedule, position, velocity, velocity_error=0.05)
    assert verify(verdict.certificate, **monitor.certificate_inputs)
    # Deadlines end a little early, and daa may prove a later time by an exact distance.
    assert verdict.certificate.contact_time >= verdict.contact_time * (1.0 - 1e-9) > 0.0
    later = verdict.certificate._replace(contact_time=1.5 * verdict.certificate.contact_time)
    assert not verify(later, **monitor.certificate_inputs)


def test_nothing_is_attached_unless_asked_for(robot):
    obstacles = armguard.Obstacles()
    monitor = armguard.Monitor(robot, obstacles)
    obstacles.update(["it"], 0.0, [[3.0, 0.0, 0.5]], [[0.0, 0.0, 0.0]], radius=0.1)
    assert monitor.step(0.0, READY, np.zeros(7)).certificate is None
    assert monitor.certificate_inputs is None


def test_nothing_is_attached_where_nothing_can_be_proved(robot):
    obstacles = armguard.Obstacles()
    monitor = armguard.Monitor(robot, obstacles, certify=True)
    assert monitor.step(0.0, READY, np.zeros(7)).certificate is None
    obstacles.update(["it"], 0.0, [[np.nan, 0.0, 0.5]], [[0.0, 0.0, 0.0]], radius=0.1)
    assert monitor.step(0.001, READY, np.zeros(7)).certificate is None
    assert monitor.step(np.nan, READY, np.zeros(7)).certificate is None
    assert monitor.certificate_inputs is None
