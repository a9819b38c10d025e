import numpy as np
import pytest

from armguard.bounds.limits import JointLimits
from armguard.bounds.planned.curve import (
    curve_range,
    evaluate_curve,
    find_excess,
    find_top_speeds,
)
from armguard.bounds.planned.findings import CURVE, FINE, POSITION, RATE, VELOCITY
from support.plan_cases import Hermite
from support.urdf_arms import hold

FREE = np.full(3, 1e6)


def random_samples(random, count=6, joints=3):
    times = np.concatenate([[0.0], np.cumsum(random.uniform(0.01, 0.5, count - 1))])
    return times, random.normal(size=(count, joints)), random.normal(size=(count, joints))


def test_the_curve_is_the_cubic_through_samples_and_velocities():
    random = np.random.default_rng(0)
    q, v = np.empty(3), np.empty(3)
    for _ in range(50):
        samples = random_samples(random)
        curve = Hermite(*samples)
        for t in [*random.uniform(0.0, samples[0][-1], 20), *samples[0]]:
            evaluate_curve(*samples, t, q, v)
            assert q == pytest.approx(curve(t), abs=1e-12)
            assert v == pytest.approx(curve(t, 1), abs=1e-10)


def test_outside_its_times_the_curve_stays_at_its_ends():
    samples = random_samples(np.random.default_rng(1))
    q, v = np.empty(3), np.empty(3)
    for t, k in ((-1.0, 0), (99.0, -1)):
        evaluate_curve(*samples, t, q, v)
        assert q == pytest.approx(samples[1][k], abs=1e-12)
        assert v == pytest.approx(samples[2][k], abs=1e-10)


@pytest.mark.parametrize(("order", "near"), [(0, 1e-4), (1, 1e-2)])
def test_ranges_are_those_of_dense_samples(order, near):
    random = np.random.default_rng(2)
    low, high = np.empty(3), np.empty(3)
    for _ in range(200):
        samples = random_samples(random)
        first, last = np.sort(random.uniform(0.0, samples[0][-1], 2))
        curve_range(*samples, first, last, order, low, high)
        dense = Hermite(*samples)(np.linspace(first, last, 4001), order)
        assert (low <= dense.min(axis=0)).all()
        assert (high >= dense.max(axis=0)).all()
        assert low == pytest.approx(dense.min(axis=0), abs=near, rel=1e-3)
        assert high == pytest.approx(dense.max(axis=0), abs=near, rel=1e-3)


def dense_peaks(samples):
    """Extremes of position, speed and acceleration of all joints, sampled."""
    times = np.linspace(samples[0][:-1], samples[0][1:], 2001).ravel()
    curve = Hermite(*samples)
    ends = np.abs([curve(samples[0][:-1], 2), curve(samples[0][1:] - 1e-12, 2)])
    return (
        curve(times).min(axis=0),
        curve(times).max(axis=0),
        np.abs(curve(times, 1)).max(axis=0),
        ends.max(axis=(0, 1)),
    )


def excess(samples, lower=-FREE, upper=FREE, fastest=FREE, acceleration=FREE):
    """What `find_excess` says of joints without errors; and the peaks that it fills."""
    zero, peaks = np.zeros(3), np.full((2, 3), np.nan)
    limits = JointLimits(
        lower, upper, fastest, acceleration, hold(FREE), zero, zero, fastest, acceleration
    )
    return find_excess(*samples, limits, *peaks), peaks


def test_excess_is_found_where_dense_samples_find_it():
    random = np.random.default_rng(3)
    for _ in range(100):
        samples = random_samples(random)
        low, high, pace, bend = dense_peaks(samples)
        more, less = 1.0 + 1e-5, 1.0 - 1e-5
        tight = low - 1e-5, high + 1e-5, pace * more, bend * more
        found, (acceleration, speed) = excess(samples, *tight)
        assert found[0] == FINE
        assert acceleration == pytest.approx(bend, rel=1e-6)
        assert (speed == find_top_speeds(*samples)).all()
        for row, change, kinds in (
            (0, low + 1e-5, [POSITION]),
            (1, high - 1e-5, [POSITION]),
            (2, pace * less, [VELOCITY]),
            (3, bend * less, [RATE, CURVE]),
        ):
            assert excess(samples, *tight[:row], change, *tight[row + 1 :])[0][0] in kinds


def test_velocities_apart_and_velocities_beside_positions_are_told_apart():
    times, still, moved = np.array([0.0, 0.1]), np.zeros((2, 3)), np.zeros((2, 3))
    moved[1, 2] = 0.5
    for q, v, kind in ((still, moved, RATE), (moved, still, CURVE)):
        assert excess((times, q, v), acceleration=np.full(3, 2.0))[0][:2] == (kind, 2)


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e308])
def test_nonsense_is_never_fine(bad):
    for place in range(2):
        samples = random_samples(np.random.default_rng(4))
        samples[1 + place][3, 1] = bad
        assert excess(samples)[0][0] != FINE


def test_times_too_close_to_tell_are_never_fine():
    q = np.zeros((2, 3))
    q[1] = 1e-3
    assert excess((np.array([0.0, 1e-200]), q, np.zeros((2, 3))))[0][0] != FINE
