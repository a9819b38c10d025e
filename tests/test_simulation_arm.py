"""Joint trajectories and the arm that follows them: limits, braking, recovery."""

import numpy as np
import pytest

from armguard.exceptions import ArmguardError
from armguard.robot import Robot
from armguard.simulation import JointTrajectory, SimulatedArm, keeps_within, random_trajectory
from armguard.simulation.trajectory import PEAK_ACCELERATION, PEAK_SPEED

ROUNDING = 1e-9


@pytest.fixture(scope="module")
def panda():
    return Robot.load("panda")


def blend(u):
    return 10 * u**3 - 15 * u**4 + 6 * u**5


def test_the_peaks_of_the_blend_are_what_dense_samples_show():
    u = np.linspace(0.0, 1.0, 400_001)
    slope = 30 * u**2 - 60 * u**3 + 30 * u**4
    curvature = 60 * u - 180 * u**2 + 120 * u**3
    assert slope.max() <= PEAK_SPEED + 1e-12
    assert slope.max() == pytest.approx(PEAK_SPEED, rel=1e-9)
    assert np.abs(curvature).max() <= PEAK_ACCELERATION + 1e-12
    assert np.abs(curvature).max() == pytest.approx(PEAK_ACCELERATION, rel=1e-9)
    # Why a joint that brakes at the peak acceleration rests before the waypoint ahead.
    left = 1 - blend(u[:-1000])
    assert (slope[:-1000] ** 2 / (2 * left)).max() < 0.95 * PEAK_ACCELERATION


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(("speed_fraction", "acceleration_fraction"), [(0.3, 0.5), (1.0, 1.0)])
def test_a_random_trajectory_keeps_its_fractions_and_uses_them(
    panda, seed, speed_fraction, acceleration_fraction
):
    way = random_trajectory(
        panda,
        seed,
        8.0,
        speed_fraction=speed_fraction,
        acceleration_fraction=acceleration_fraction,
    )
    assert way.duration >= 8.0
    dt = 1e-4
    times = np.arange(0.0, way.duration, dt)
    q, v = (np.array(part) for part in zip(*(way.sample(time) for time in times), strict=True))
    speed = speed_fraction * panda.velocity_limit
    accel = acceleration_fraction * np.minimum(panda.acceleration_limit, panda.braking_deceleration)
    assert (np.abs(v) <= speed).all()
    acceleration = np.diff(v, axis=0) / dt
    assert (np.abs(acceleration) <= accel * (1 + 1e-9) + 1e-9).all()
    assert (q > panda.lower_position_limit).all()
    assert (q < panda.upper_position_limit).all()
    # The velocity is the derivative of the position, and the mean over a step lies in between.
    assert np.abs(np.diff(q, axis=0) / dt - (v[1:] + v[:-1]) / 2).max() < 1e-5
    # No segment is slower than it must be: some joint reaches a limit in each.
    for start, end in zip(way.stops[:-1], way.stops[1:], strict=True):
        inside = (times[:-1] >= start) & (times[:-1] < end)
        at_speed = (np.abs(v[:-1][inside]) / speed).max()
        at_accel = (np.abs(acceleration[inside]) / accel).max()
        assert max(at_speed, at_accel) > 0.999


def test_a_trajectory_holds_at_its_end_or_loops(panda):
    middle = (panda.lower_position_limit + panda.upper_position_limit) / 2
    points = [middle, middle + 0.2, middle - 0.1]
    once = JointTrajectory(panda, points)
    q, v = once.sample(once.duration + 5.0)
    assert np.array_equal(q, points[-1])
    assert not v.any()
    assert np.array_equal(once.sample(-1.0)[0], points[0])
    loop = JointTrajectory(panda, points, loop=True)
    assert len(loop.stops) == 4
    for time in (0.3, 1.7, loop.duration - 0.01):
        for part, again in zip(
            loop.sample(time), loop.sample(time + 3 * loop.duration), strict=True
        ):
            assert np.allclose(part, again, atol=1e-12)
    standing = JointTrajectory(panda, [middle, middle], loop=True)
    assert standing.duration == 0.0
    assert np.array_equal(standing.sample(3.0)[0], middle)


def test_random_trajectories_are_deterministic_and_can_keep_off_the_floor(panda):
    accept = keeps_within(panda, (-np.inf, -np.inf, 0.02), (np.inf, np.inf, np.inf))
    first = random_trajectory(panda, 5, 10.0, accept=accept)
    again = random_trajectory(panda, 5, 10.0, accept=accept)
    assert np.array_equal(first.waypoints, again.waypoints)
    assert not np.array_equal(first.waypoints, random_trajectory(panda, 6, 10.0).waypoints)
    times = np.linspace(0.0, first.duration, 500)
    above = keeps_within(panda, (-np.inf, -np.inf, 0.0), (np.inf, np.inf, np.inf))
    assert all(above(first.sample(time)[0]) for time in times)


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


def test_a_speed_scale_caps_joint_speeds_once_the_rate_has_come_down(panda):
    arm = SimulatedArm(random_trajectory(panda, 4, 10.0, speed_fraction=0.5))
    for _ in range(1000):
        arm.step(0.001)
    for tick in range(5000):
        _, v = arm.step(0.001, 0.1)
        if tick > 1000:
            assert (np.abs(v) <= 0.1 * panda.velocity_limit * (1 + 1e-9)).all()
    assert not arm.braking


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"speed_fraction": 0.0}, "speed_fraction"),
        ({"speed_fraction": float("nan")}, "speed_fraction"),
        ({"acceleration_fraction": 1.5}, "acceleration_fraction"),
        ({"waypoints": np.zeros((2, 6))}, "shape"),
        ({"waypoints": np.empty((0, 7))}, "shape"),
        ({"waypoints": np.full((2, 7), np.nan)}, "waypoint 0"),
        ({"waypoints": np.zeros((1, 7))}, "joint 3"),
    ],
)
def test_what_cannot_be_a_trajectory_is_refused(panda, change, named):
    middle = (panda.lower_position_limit + panda.upper_position_limit) / 2
    arguments = {"waypoints": [middle, middle + 0.1], **change}
    with pytest.raises(ArmguardError, match=named):
        JointTrajectory(panda, **arguments)


def test_other_bad_input_is_refused(panda):
    with pytest.raises(ArmguardError, match="duration"):
        random_trajectory(panda, 0, float("inf"))
    with pytest.raises(ArmguardError, match="random waypoints"):
        random_trajectory(panda, 0, 5.0, accept=lambda q: False)
    way = random_trajectory(panda, 0, 2.0)
    with pytest.raises(ArmguardError, match="not finite"):
        way.sample(float("nan"))
    arm = SimulatedArm(way)
    for dt in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(ArmguardError, match="dt"):
            arm.step(dt)
