import math

import numpy as np
import pinocchio
import pytest

from armguard.lab.extremes.adversary import HORIZON, STEP, Adversary, Body
from armguard.obstacles import Obstacles
from support.panda_monitor import HOME, STILL, make_monitor, ranged_panda


def make(velocity=None, acceleration=None):
    robot = ranged_panda()
    velocity = robot.velocity_limit if velocity is None else np.full(7, velocity)
    acceleration = robot.acceleration_limit if acceleration is None else np.full(7, acceleration)
    return Adversary(robot, None, velocity, acceleration)


def body(place, velocity=(0.0, 0.0, 0.0), radius=0.1, accel=10.0, speed=2.0):
    ends = np.reshape(np.asarray(place, dtype=float), (-1, 3))
    return Body(ends, np.array(velocity, dtype=float), radius, accel, speed)


def test_no_contact_comes_before_the_time_that_a_monitor_gives():
    random = np.random.default_rng(5)
    adversary, ratios = make(), []
    for _ in range(6):
        q = HOME + random.uniform(-0.3, 0.3, 7)
        v = random.uniform(-0.4, 0.4, 7)
        angle = random.uniform(-math.pi, math.pi)
        place = [1.1 * math.cos(angle), 1.1 * math.sin(angle), random.uniform(0.2, 0.9)]
        velocity = random.uniform(-0.8, 0.8, 3)
        obstacles, monitor = make_monitor("full", obstacles=Obstacles(), robot=ranged_panda())
        obstacles.update(["ball"], 0.0, [place], [velocity], radius=0.1, accel=10.0, speed=2.0)
        told = monitor.step(0.0, q, v).contact_time
        found = adversary.find_contact(q, v, body(place, velocity))
        assert told <= found
        ratios.append(told / found)
    assert np.median(ratios) > 0.3, "a poor adversary says nothing of tightness"


def test_a_body_that_hunts_alone_takes_as_long_as_its_bounds_say():
    adversary = make(velocity=1e-9, acceleration=1e-9)
    corners = ranged_panda().hull("panda_hand")
    far = np.array([0.55 + 1.0, 0.0, 0.5])
    found = adversary.find_contact(HOME, STILL, body(far, speed=1.0), horizon=3.0)
    arm = adversary._arm
    arm.place(HOME)
    gap = arm.gap(far[None], 0.1, 9.0)[0]
    # A tenth of a second up to full speed, then straight on.
    assert found == pytest.approx(0.1 + (gap - 0.05) / 1.0, abs=2 * STEP)
    assert adversary.find_contact(HOME, STILL, body(far, speed=1.0), horizon=0.3) == math.inf
    assert len(corners)


def test_a_contact_at_once_is_at_once():
    adversary = make()
    adversary._arm.place(HOME)
    corner = adversary._arm.corners(7)[0]
    assert adversary.find_contact(HOME, STILL, body(corner)) == 0.0
    segment = corner + np.array([[-0.5, 0.0, 0.0], [0.5, 0.0, 0.0]])
    assert adversary.find_contact(HOME, STILL, body(segment)) == 0.0


def test_joints_keep_to_their_limits_while_they_hunt(monkeypatch):
    """Full speed at a limit would not be possible: they brake before it."""
    robot, positions = ranged_panda(), []
    compute = pinocchio.computeJointJacobians
    monkeypatch.setattr(
        pinocchio,
        "computeJointJacobians",
        lambda model, data, q: (positions.append(q), compute(model, data, q)),
    )
    place = np.array([1.6, 0.9, 0.5])
    make().find_contact(robot.upper_position_limit - 0.3, STILL, body(place, accel=0.0, speed=0.0))
    q = np.array(positions[: int(HORIZON / STEP)])
    assert (q <= robot.upper_position_limit + 1e-9).all()
    assert (q >= robot.lower_position_limit - 1e-9).all()
    change = np.abs(np.diff(q, 2, axis=0)) / STEP**2
    assert (change <= robot.acceleration_limit * (1.0 + 1e-6)).all()
    assert np.abs(np.diff(q, axis=0)).max() > 0.0
