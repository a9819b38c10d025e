import numpy as np
import pytest

from armguard.bounds.planned.curve import (
    CURVE,
    FINE,
    POSITION,
    RATE,
    VELOCITY,
    CurvePeaks,
    curve_range,
    evaluate_curve,
    find_excess,
    find_top_speeds,
    speed_range,
)
from support.plan_cases import Hermite

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


def test_ranges_are_those_of_dense_samples():
    random = np.random.default_rng(2)
    low, high = np.empty(3), np.empty(3)
    for _ in range(200):
        samples = random_samples(random)
        first, last = np.sort(random.uniform(0.0, samples[0][-1], 2))
        curve_range(*samples, first, last, low, high)
        dense = Hermite(*samples)(np.linspace(first, last, 4001))
        assert (low <= dense.min(axis=0)).all()
        assert (high >= dense.max(axis=0)).all()
        assert low == pytest.approx(dense.min(axis=0), abs=1e-4)
        assert high == pytest.approx(dense.max(axis=0), abs=1e-4)
        speed_range(*samples, first, last, low, high)
        dense = Hermite(*samples)(np.linspace(first, last, 4001), 1)
        assert (low <= dense.min(axis=0)).all()
        assert (high >= dense.max(axis=0)).all()
        assert low == pytest.approx(dense.min(axis=0), abs=1e-2, rel=1e-3)
        assert high == pytest.approx(dense.max(axis=0), abs=1e-2, rel=1e-3)


@pytest.mark.parametrize("slope", [0.0, 1.0, -2.0])
def test_straight_lines_and_rest_have_no_turns(slope):
    times = np.array([0.0, 0.5, 1.0])
    q, v = np.repeat(slope * times[:, None], 3, axis=1), np.full((3, 3), slope)
    low, high = np.empty(3), np.empty(3)
    curve_range(times, q, v, 0.25, 0.75, low, high)
    assert low == pytest.approx(np.full(3, min(0.25 * slope, 0.75 * slope)))
    assert high == pytest.approx(np.full(3, max(0.25 * slope, 0.75 * slope)))
    assert low[0] <= high[0]


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


def test_excess_is_found_where_dense_samples_find_it():
    random = np.random.default_rng(3)
    peaks = CurvePeaks(*np.zeros((2, 3)))
    for _ in range(100):
        samples = random_samples(random)
        low, high, pace, bend = dense_peaks(samples)
        more, less = 1.0 + 1e-5, 1.0 - 1e-5
        tight = low - 1e-5, high + 1e-5, pace * more, bend * more
        assert find_excess(*samples, *tight, peaks)[0] == FINE
        assert peaks.acceleration == pytest.approx(bend, rel=1e-6)
        assert (peaks.speed == find_top_speeds(*samples)).all()
        assert find_excess(*samples, low + 1e-5, *tight[1:], peaks)[0] == POSITION
        assert find_excess(*samples, tight[0], high - 1e-5, *tight[2:], peaks)[0] == POSITION
        assert find_excess(*samples, *tight[:2], pace * less, tight[3], peaks)[0] == VELOCITY
        assert find_excess(*samples, *tight[:3], bend * less, peaks)[0] in (RATE, CURVE)


def test_velocities_apart_and_velocities_beside_positions_are_told_apart():
    times, peaks = np.array([0.0, 0.1]), CurvePeaks(*np.zeros((2, 3)))
    limits = -FREE, FREE, FREE, np.full(3, 2.0)
    still, moved = np.zeros((2, 3)), np.zeros((2, 3))
    moved[1, 2] = 0.5
    assert find_excess(times, still, moved, *limits, peaks)[:3] == (RATE, 2, 0)
    assert find_excess(times, moved, still, *limits, peaks)[:3] == (CURVE, 2, 0)


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e308])
def test_nonsense_is_never_fine(bad):
    peaks = CurvePeaks(*np.zeros((2, 3)))
    for place in range(2):
        samples = random_samples(np.random.default_rng(4))
        samples[1 + place][3, 1] = bad
        assert find_excess(*samples, -FREE, FREE, FREE, FREE, peaks)[0] != FINE


def test_times_too_close_to_tell_are_never_fine():
    times, peaks = np.array([0.0, 1e-200]), CurvePeaks(*np.zeros((2, 3)))
    q = np.zeros((2, 3))
    q[1] = 1e-3
    assert find_excess(times, q, np.zeros((2, 3)), -FREE, FREE, FREE, FREE, peaks)[0] != FINE
