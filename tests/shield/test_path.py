import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armguard.exceptions import ArmguardError
from armguard.shield.path import SHARE, MotionLimits, Path, TimedPath

LIMITS = MotionLimits(
    np.array([1.0, 0.5, 2.0]),
    np.array([3.0, 4.0, 2.0]),
    np.array([5.0, 2.0, 4.0]),
    np.array([60.0, 40.0, 90.0]),
)


def differences(path, count=40001):
    """Positions and derivatives by differences, at the middles of small steps."""
    at = np.linspace(0.0, path.duration * (1.0 - 1e-12), count)
    q = path.evaluate(at)[0]
    return q, np.diff(q, axis=0) / at[1], np.diff(q, 2, axis=0) / at[1] ** 2


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 10**6), st.integers(2, 8), st.booleans())
def test_a_timed_path_keeps_its_limits_and_leaves_something_for_the_pace(seed, count, timed):
    random = np.random.default_rng(seed)
    places = np.cumsum(random.uniform(-1.0, 1.0, (count, 3)) * 10 ** random.uniform(-3, 0), axis=0)
    path = TimedPath(Path(places), LIMITS)
    if timed:
        # A faster timing of the same motion is slowed down as a whole.
        at = np.linspace(0.0, path.duration * (1.0 - 1e-12), 200)
        path = TimedPath(Path(path.evaluate(at)[0], at * random.uniform(0.2, 1.0)), LIMITS)
    q, v, a = differences(path)
    assert (np.abs(v) <= LIMITS.velocity * (1.0 + 1e-6)).all()
    most = np.minimum(LIMITS.acceleration, SHARE * LIMITS.braking)
    assert (np.abs(a) <= most * (1.0 + 1e-3) + 1e-6).all()
    at = np.linspace(0.0, path.duration, 5001)
    _, slope, bend, turn = path.evaluate(at)
    assert (np.abs(slope) <= LIMITS.velocity * (1.0 + 1e-9)).all()
    assert (np.abs(bend) <= most * (1.0 + 1e-9)).all()
    assert (np.abs(turn) <= SHARE * LIMITS.jerk * (1.0 + 1e-9)).all()
    assert q[0] == pytest.approx(places[0], abs=1e-9)
    assert q[-1] == pytest.approx(places[-1], abs=1e-6)


def test_derivatives_are_those_of_the_positions():
    path = TimedPath(Path([[0.0, 0.0, 0.0], [0.5, 0.2, -0.1], [0.3, 0.4, 0.4]]), LIMITS)
    h = 1e-4
    at = np.linspace(0.1, path.duration - 0.1, 300)
    for order in range(3):
        before, after = (path.evaluate(at + sign * h)[order] for sign in (-1.0, 1.0))
        slope = path.evaluate(at)[order + 1]
        size = np.abs(slope).max()
        # Where a knot lies between, the third derivative jumps.
        off = np.abs((after - before) / (2.0 * h) - slope) > 1e-3 * size
        assert off.mean() < (0.05 if order == 2 else 0.001)


def test_a_short_way_takes_as_long_as_its_limits_say():
    # The first joint alone: at 0.9 of the time that a bang-bang of the jerk would take at best.
    way = 0.4
    path = TimedPath(Path([[0.0, 0.0, 0.0], [way, 0.0, 0.0]]), LIMITS)
    accel, jerk = min(3.0, SHARE * 5.0), SHARE * 60.0
    best = 2.0 * np.sqrt(way / accel) + accel / jerk
    assert best * 0.9 <= path.duration <= 1.5 * best


@pytest.mark.parametrize("size", [1e-6, 1e-3, 0.5])
def test_a_path_rests_without_a_jump_and_more_jerk_makes_none_slower(size):
    places = size * np.array([[0.0, 0.0, 0.0], [1.0, 0.4, -0.2], [0.6, 0.8, 0.8]])
    lasting = []
    for jerk in (50.0, 200.0, 1000.0, 5000.0):
        limits = LIMITS._replace(jerk=np.full(3, jerk))
        path = TimedPath(Path(places), limits)
        end = path.evaluate(np.array([path.duration - 1e-9]))[2]
        # Of what the greatest jerk makes in half a millisecond.
        assert (np.abs(end) <= 5e-4 * limits.jerk).all()
        lasting.append(path.duration)
    assert (np.diff(lasting) <= 1e-2).all(), lasting


def test_the_nearest_place_of_a_path_is_found():
    path = TimedPath(Path([[0.0, 0.0, 0.0], [0.5, 0.2, -0.1], [0.3, 0.4, 0.4]]), LIMITS)
    for at in np.linspace(0.1, path.duration - 0.1, 7):
        q = path.evaluate(np.array([at]))[0][0]
        found, apart = path.find_nearest(q, 0.0, path.duration)
        assert apart < 1e-5
        assert found == pytest.approx(at, abs=1e-3)


@pytest.mark.parametrize(
    ("q", "times", "named"),
    [
        ([[0.0, 0.0, 0.0]], None, "shape"),
        ([0.0, 1.0], None, "shape"),
        ([[0.0, 0.0, np.nan], [0.0, 0.0, 0.0]], None, "finite"),
        ("way", None, "numbers"),
        ([[0.0] * 3] * 2, [0.0, 0.0], "rising"),
        ([[0.0] * 3] * 2, [0.0], "rising"),
        ([[0.0] * 3] * 2, [0.0, np.inf], "finite"),
    ],
)
def test_what_is_no_path_is_refused(q, times, named):
    with pytest.raises(ArmguardError, match=named):
        Path(q, times)


def test_a_path_of_other_joints_or_one_that_sets_off_in_motion_is_refused():
    with pytest.raises(ArmguardError, match="2 joints"):
        TimedPath(Path(np.zeros((3, 2))), LIMITS)
    times = np.linspace(0.0, 1.0, 101)
    with pytest.raises(ArmguardError, match="beginning of the path"):
        TimedPath(Path(0.3 * times[:, None] * np.ones(3), times), LIMITS)
    slow = 0.3 * (1.0 - np.cos(0.7 * np.pi * times))[:, None] * np.ones(3)
    with pytest.raises(ArmguardError, match="end of the path"):
        TimedPath(Path(slow, times), LIMITS)


@pytest.mark.parametrize("far", [1e5, 9e99])
def test_a_path_that_takes_for_ever_is_refused_at_once(far):
    with pytest.raises(ArmguardError, match=r"path: takes .*; expected 2000 s at most"):
        TimedPath(Path([[0.0] * 3, [far, 0.0, 0.0]]), LIMITS)


def test_a_path_that_leads_nowhere_is_a_moment_at_rest():
    path = TimedPath(Path([[0.1, 0.2, 0.3]] * 4), LIMITS)
    q, slope, _, _ = path.evaluate(np.linspace(0.0, path.duration, 9))
    assert q == pytest.approx(np.tile([0.1, 0.2, 0.3], (9, 1)))
    assert not slope.any()
