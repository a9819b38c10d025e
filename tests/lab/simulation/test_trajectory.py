"""Joint trajectories: their limits, their ends, what is none."""

import numpy as np
import pytest

from armguard.exceptions import ArmguardError
from armguard.lab.simulation import JointTrajectory, SimulatedArm, keeps_within, random_trajectory
from armguard.lab.simulation.trajectory import PEAK_ACCELERATION, PEAK_SPEED
from armguard.robot import Robot


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
    dt = 2.5e-4
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
    way = random_trajectory(panda, 0, 2.0)
    for refused, named in (
        (lambda: random_trajectory(panda, 0, float("inf")), "duration"),
        (lambda: random_trajectory(panda, 0, 5.0, accept=lambda q: False), "random waypoints"),
        (lambda: way.sample(float("nan")), "not finite"),
        *((lambda dt=dt: SimulatedArm(way).step(dt), "dt") for dt in (0.0, float("nan"))),
    ):
        with pytest.raises(ArmguardError, match=named):
            refused()
