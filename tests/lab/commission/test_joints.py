import numpy as np
import pytest

from armguard.bounds import Plan
from armguard.lab.commission.joints import (
    measure_errors,
    measure_limits,
    measure_tracking,
)
from armguard.lab.commission.observations import PlanAccepted
from support.commissioned_arms import Arm, sample

ARM = Arm([0.6, 1.0], [2.0, 3.0], [5.0, 4.0], 0.03)


@pytest.mark.parametrize(
    "seen",
    [
        {},
        {"velocity_noise": 0.004},
        {"velocity_noise": 0.001, "period": 2e-3},
        {"quantum": 2e-4, "velocity_noise": 0.002},
    ],
)
def test_what_the_controller_keeps_is_found_and_not_how_it_brakes(seen):
    """Brakes slow it down harder than it ever speeds up, and that is no operating limit."""
    found = sample(ARM, [0.7, 4.1], 7.5, **seen)
    for joint in range(2):
        kept = measure_limits(found, joint)
        assert 1.0 <= kept.velocity / ARM.velocity[joint] <= 1.1
        assert 1.0 <= kept.acceleration / ARM.acceleration[joint] <= 1.1


def test_limits_of_what_hardly_moved_or_is_hidden_are_not_made_up():
    still = Arm([0.01, 1.0], [2.0, 3.0], [5.0, 4.0], 0.03)
    found = sample(still, [], 3.0, velocity_noise=0.0005)
    assert measure_limits(found, 0) is None
    noisy = sample(ARM, [], 3.0, velocity_noise=0.2)
    assert np.isnan(measure_limits(noisy, 0).acceleration)


@pytest.mark.parametrize("off", [{"velocity_noise": 0.01}, {"velocity_bias": 0.01}])
def test_errors_of_stated_velocities_are_found(off):
    found = sample(ARM, [0.7, 4.1], 7.5, **off)
    for joint in range(2):
        assert 0.01 <= measure_errors(found, joint).velocity <= 0.011


@pytest.mark.parametrize("seed", range(3))
def test_errors_of_positions_widen_those_of_velocities_and_never_hide_them(seed):
    found = sample(ARM, [0.7], 5.0, velocity_noise=0.01, noise=2e-4, seed=seed)
    for joint in range(2):
        errors = measure_errors(found, joint)
        assert errors.velocity >= 0.01
        assert 2e-4 <= errors.position <= 3e-4


@pytest.mark.parametrize("quantum", [1.3e-4, 7.1e-4, 9.7e-4])
def test_the_steps_of_an_encoder_are_found(quantum):
    found = sample(ARM, [0.7], 5.0, quantum=quantum)
    for joint in range(2):
        assert 0.5 * quantum <= measure_errors(found, joint).position <= quantum


def make_followed(off, off_velocity=0.0):
    times = np.linspace(0.0, 2.0, 41)
    course = np.stack([np.sin(times), 0.5 * np.cos(times)], axis=1)
    speed = np.stack([np.cos(times), -0.5 * np.sin(times)], axis=1)
    plan = Plan(10.0, times, course, speed, np.full(2, 0.1))
    stamps = 10.0 + np.arange(0.0, 2.0, 0.001)
    s = stamps - 10.0
    wave = np.sin(40.0 * s)[:, None] * np.asarray(off)
    q = np.stack([np.sin(s), 0.5 * np.cos(s)], axis=1) + wave
    v = np.stack([np.cos(s), -0.5 * np.sin(s)], axis=1) + off_velocity
    seen = sample(ARM, [], 0.1)
    return seen._replace(
        stamps=stamps,
        q=q,
        v=v,
        plans=[PlanAccepted(plan, 100.0)],
    )


def test_tracking_errors_are_those_that_the_arm_was_off_its_plan():
    found = measure_tracking(make_followed([0.004, 0.009], 0.02))
    assert (found.position >= [0.004, 0.009]).all()
    assert (found.position <= [0.0044, 0.0099]).all()
    assert (found.velocity >= 0.02).all()
    assert (found.velocity <= 0.022).all()


def test_only_what_was_allowed_and_is_not_over_counts():
    seen = make_followed([0.004, 0.009])
    before = seen._replace(plans=[PlanAccepted(seen.plans[0].plan, 9.0)])
    assert measure_tracking(before) is None
    assert measure_tracking(seen._replace(plans=[])) is None


def make_pulses(shape, steepest, length, period, noise):
    """A joint that speeds up and slows down by short pulses, and keeps its speed in between."""
    times = np.arange(0.0, 4.0, 1e-4)
    phase = times % 0.5
    pulse = shape(np.pi * phase / length) * (phase < length)
    turn = np.where((times // 0.5) % 2 == 0, 1.0, -1.0)
    v = (np.cumsum(steepest * pulse * turn) * 1e-4)[3 :: round(period / 1e-4)]
    v = v + np.random.default_rng(0).uniform(-noise, noise, len(v))
    stamps = period * np.arange(len(v))
    seen = sample(Arm([1.0], [3.0], [4.0], 0.03), [], 0.1)
    return seen._replace(stamps=stamps, q=v[:, None], v=v[:, None])


@pytest.mark.parametrize("shape", [np.sin, np.ones_like])
@pytest.mark.parametrize("length", [0.02, 0.03, 0.05, 0.1, 0.2])
@pytest.mark.parametrize("noise", [0.0, 0.001, 0.003, 0.01, 0.02])
@pytest.mark.parametrize("period", [1e-3, 8e-3])
def test_an_acceleration_that_does_not_last_is_not_stated_lower(shape, length, noise, period):
    kept = measure_limits(make_pulses(shape, 8.0, length, period, noise), 0)
    assert np.isnan(kept.acceleration) or 8.0 <= kept.acceleration <= 8.0 * 1.15
    if period == 1e-3 and length >= 0.1 and noise <= 0.001:
        assert not np.isnan(kept.acceleration)
