"""The arm that follows a trajectory: limits, braking, recovery."""

import numpy as np
import pytest

from armguard.bounds.operating_history import OperatingHistory
from armguard.exceptions import ArmguardError
from armguard.lab.simulation import SimulatedArm, random_trajectory
from armguard.robot import Robot
from armguard.robot.operating_limits import LimitsInForce, OperatingLimits
from support.motion_questions import altered

ROUNDING = 1e-9


@pytest.fixture(scope="module")
def panda():
    return Robot.load("panda")


def check_steps(panda, q0, v0, q1, v1, dt):
    """Accelerations within the limits and positions consistent with velocities, for one step."""
    assert (np.abs(v1 - v0) <= panda.acceleration_limit * dt * (1 + 1e-9) + ROUNDING).all()
    slip = np.abs(q1 - q0 - (v0 + v1) / 2 * dt)
    assert (slip <= panda.acceleration_limit * dt * dt / 2 + ROUNDING).all()
    assert (q1 >= panda.lower_position_limit).all()
    assert (q1 <= panda.upper_position_limit).all()


@pytest.mark.parametrize("fraction", [0.3, 0.9])
def test_an_arm_at_any_scale_stays_within_its_limits(panda, fraction):
    random = np.random.default_rng(3)
    way = random_trajectory(panda, 1, 10.0, speed_fraction=fraction, acceleration_fraction=fraction)
    arm = SimulatedArm(way)
    dt, scale = 0.001, 1.0
    q0, v0 = arm.q, arm.v
    for tick in range(30_000):
        if tick % 300 == 0:
            scale = random.choice([0.0, 0.05, 0.2, 1.0, 1.0])
        q1, v1 = arm.step(dt, scale)
        check_steps(panda, q0, v0, q1, v1, dt)
        assert (np.abs(v1) <= fraction * panda.velocity_limit * (1 + 1e-9)).all()
        q0, v0 = q1, v1


def test_braking_is_exactly_the_guaranteed_deceleration_and_ends_before_the_waypoint(panda):
    way = random_trajectory(panda, 2, 12.0, speed_fraction=1.0, acceleration_fraction=0.95)
    b = panda.braking_deceleration
    for start in np.linspace(0.05, way.duration - 0.05, 40):
        arm = SimulatedArm(way)
        while start > 0.0:
            arm.step(min(start, 0.01))
            start -= 0.01
        ahead = way.next_stop(arm._time)[1]
        q0, v0 = arm.q, arm.v
        rest_time = (np.abs(v0) / b).max()
        for tick in range(1, 2000):
            q, v = arm.step(0.001, 0.0)
            t = tick * 0.001
            expected = np.sign(v0) * np.maximum(np.abs(v0) - b * t, 0.0)
            assert np.allclose(v, expected, atol=1e-12)
            until = np.minimum(t, np.abs(v0) / b)
            travel = v0 * until - np.sign(v0) * b * until**2 / 2
            assert np.allclose(q - q0, travel, atol=1e-12)
            if t > rest_time:
                break
        assert not v.any()
        assert arm.braking
        assert (np.abs(q - q0) <= np.abs(ahead - q0) + ROUNDING).all()


def test_an_arm_that_was_stopped_goes_on_to_the_waypoint_and_rejoins(panda):
    way = random_trajectory(panda, 7, 6.0)
    arm, free = SimulatedArm(way), SimulatedArm(way)
    for _ in range(700):
        arm.step(0.001)
    for _ in range(200):
        arm.step(0.001, 0.0)
    arm.step(0.001, 1.0)
    for _ in range(3000):
        arm.step(0.001, float("nan"))  # not a number brakes, too
    assert arm.braking
    target = way.next_stop(0.7)[1]
    reached = []
    for _ in range(int(2 * way.duration / 0.001)):
        q, _ = arm.step(0.001)
        reached.append(np.abs(q - target).max())
    assert min(reached) < 1e-4
    assert not arm.braking
    # From there on it is the trajectory again: some time of it gives this very state.
    times = np.arange(0.0, way.duration, 0.001)
    samples = np.array([way.sample(time)[0] for time in times])
    assert np.abs(samples - arm.q).max(axis=1).min() < 2e-3
    for _ in range(1234):
        free.step(0.001)
    assert np.allclose(free.q, way.sample(1.234)[0], atol=1e-9)


def test_a_preview_is_what_an_arm_does_that_goes_on_as_fast_as_it_may(panda):
    way = random_trajectory(panda, 7, 6.0)
    arm = SimulatedArm(way)
    for scale in (1.0, 0.0):
        for _ in range(500):
            arm.step(0.001, scale)
    arm.step(0.001, 1.0)  # from a stop, to the waypoint ahead, and on
    assert not arm.braking
    for _ in range(400):
        arm.step(0.001)
    ahead = np.arange(1, 5000, 50) * 0.001
    q, v = arm.preview(ahead)
    for k in range(len(ahead)):
        for _ in range(50 if k else 1):
            arm.step(0.001)
        assert np.allclose(arm.q, q[k], atol=1e-9)
        assert np.allclose(arm.v, v[k], atol=1e-9)


def test_a_brake_is_not_released_before_the_arm_rests(panda):
    arm = SimulatedArm(random_trajectory(panda, 0, 6.0, speed_fraction=0.8))
    while np.abs(arm.v).max() < 0.5:
        arm.step(0.001)
    arm.step(0.001, 0.0)
    while arm.v.any():
        assert arm.braking
        before = np.abs(arm.v)
        arm.step(0.001, 1.0)
        assert (np.abs(arm.v) <= before).all()
    arm.step(0.001, 1.0)
    assert not arm.braking


@pytest.mark.parametrize("name", ["panda", "ur5"])
def test_an_arm_that_is_told_operating_limits_keeps_them(name):
    robot, random = Robot.load(name), np.random.default_rng(5)
    operating = OperatingLimits.published(robot)
    velocity, _ = operating.resolve(robot)
    way = random_trajectory(robot, 1, 10.0, speed_fraction=0.5, acceleration_fraction=0.4)
    arm, free = SimulatedArm(way, operating), SimulatedArm(way)
    tested = [
        OperatingHistory(
            altered(robot, velocity_error=np.full(len(velocity), 2e-3)),
            LimitsInForce(robot, operating),
            0.3,
        )
        for _ in range(2)
    ]
    broken = [0, 0]
    for tick in range(20_000):
        if tick % 300 == 0:
            scale = random.choice([0.0, 0.05, 0.2, 1.0, 1.0])
            since = tick
        for k, one in enumerate((arm, free)):
            q, v = one.step(0.001, scale)
            broken[k] += not tested[k].accept(0.001 * tick, q, v)
            if k == 0 and tick - since > 250 and not one.braking:
                assert (np.abs(v) <= scale * velocity + 1e-9).all()
    assert broken[0] == 0
    assert broken[1] > 0


def test_a_trajectory_that_needs_more_than_the_operating_limits_is_refused(panda):
    gentle = OperatingLimits(acceleration=0.1)
    with pytest.raises(ArmguardError, match="within the operating limits"):
        SimulatedArm(random_trajectory(panda, 1, 6.0), gentle)
