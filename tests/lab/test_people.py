import math
import os
from pathlib import Path

import numpy as np
import pytest

from armguard.exceptions import ArmguardError
from armguard.lab.people import JUMP_ACCEL
from armguard.lab.simulation.bodies import POINTS
from armguard.lab.simulation.recordings import read_vicon_csv
from armguard.people import BOUNDS, PartBounds, check_bounds, measure_motion

RECORDINGS = Path(os.environ.get("ARMGUARD_RECORDINGS", "/nowhere"))
RATE = 100.0
TIMES = np.arange(0.0, 5.0, 1.0 / RATE)
LOOSE = {"hand": PartBounds(1.0, 1.005, 0.0, "")}


def along_x(x):
    return np.stack([x, np.zeros_like(x), np.zeros_like(x)], axis=-1).reshape(-1, 1, 3)


def test_steady_acceleration_shows_whole():
    motion = measure_motion(along_x(0.5 * 7.0 * TIMES**2), RATE)
    assert np.allclose(motion.accel[3:-3], 7.0)
    assert np.allclose(motion.speed[3:-3, 0], 7.0 * TIMES[3:-3])
    assert np.isnan(motion.accel[:3]).all()
    assert np.isnan(motion.accel[-3:]).all()
    assert motion.is_clean[3:-3].all()
    assert motion.is_clean.sum() == len(TIMES) - 6


@pytest.mark.parametrize("frequency", [1.0, 4.0, 8.0])
def test_shakes_show_as_the_triangle_weighs_them(frequency):
    wave = 2.0 * math.pi * frequency
    motion = measure_motion(along_x(30.0 / wave**2 * np.sin(wave * TIMES)), RATE)
    seen = motion.accel[motion.is_clean].max()
    assert seen == pytest.approx(30.0 * np.sinc(0.03 * frequency) ** 2, rel=0.02)
    assert motion.is_clean.sum() == len(TIMES) - 6


def test_noise_is_told_and_adds():
    rng = np.random.default_rng(1)
    still = rng.normal(0.0, 2e-4, (5000, 2, 3))
    motion = measure_motion(still, RATE)
    measured = np.sqrt(np.nanmean(motion.accel**2, axis=0))
    assert measured == pytest.approx(math.sqrt(18.0) * 2e-4 / 0.03**2, rel=0.05)
    assert motion.noise == pytest.approx(measured, rel=0.05)
    # Nor do gaps, jumps and motion change what is said of it.
    moving = still + along_x(0.3 * np.sin(3.0 * np.arange(5000) / RATE))
    moving[::100] = np.nan
    moving[2000:] += 0.5
    assert measure_motion(moving, RATE).noise == pytest.approx(measured, rel=0.1)
    # Noise never makes hands look slower: what is there is in the mean below what is seen.
    assert np.nanmean(measure_motion(along_x(0.5 * TIMES**2) + still[:500, :1], RATE).accel) > 1.0


@pytest.mark.parametrize("rate", [50.0, 100.0, 240.0])
def test_no_motion_within_the_jump_bound_is_left_out(rate):
    """Pushes as hard as allowed, changing as they like: nothing of it may count as a glitch."""
    rng = np.random.default_rng(2)
    dt, count = 1.0 / rate, 2000
    for hold in (1, 2, 3, 5, 40):
        signs = np.repeat(rng.choice([-1.0, 1.0], (-(-count // hold), 1, 3)), hold, axis=0)[:count]
        push = signs * JUMP_ACCEL / math.sqrt(3.0) * 0.999
        # Exact second differences, on each axis as large as a bounded acceleration can make them.
        push[: count // 2] *= math.sqrt(3.0) * np.eye(3)[rng.integers(0, 3, count // 2), None]
        position = np.cumsum(np.cumsum(push * dt**2, axis=0), axis=0)
        motion = measure_motion(position, rate)
        assert (motion.is_clean == np.isfinite(motion.accel)).all()


def test_gaps_and_jumps_are_left_out_with_what_is_around_them():
    position = along_x(0.1 * np.sin(TIMES))
    position[100:103] = np.nan
    position[200:] += [0.0, 0.03, 0.0]
    position[300] += [0.0, 0.0, 0.1]
    clean = measure_motion(position, RATE).is_clean[:, 0]
    dirty = np.flatnonzero(~clean)
    expected = [*range(3), *range(95, 108), *range(194, 206), *range(294, 307), *range(497, 500)]
    assert dirty.tolist() == expected
    # What could be a hard push stays in, and is measured.
    position = along_x(0.1 * np.sin(TIMES))
    position[200:] += [0.0, 0.015, 0.0]
    motion = measure_motion(position, RATE)
    assert motion.is_clean[3:-3].all()
    assert np.nanmax(motion.accel) > 15.0


def test_shares_are_of_clean_samples_and_pool_recordings():
    slow, fast = along_x(0.5 * 0.5 * TIMES**2), along_x(0.5 * 2.0 * TIMES**2)
    both = measure_motion(np.concatenate([slow, fast], axis=1), RATE)
    (report,) = check_bounds([(both, ("hand", "hand"))], LOOSE).values()
    assert (report.seen, report.clean) == (1000, 2 * 494)
    assert report.accel_broken == 0.5
    assert report.accel == pytest.approx((2.0, 2.0, 2.0))
    assert report.speed[2] == pytest.approx(2.0 * TIMES[-4])
    too_fast = (0.5 * TIMES[3:-3] > 1.005).sum() + (2.0 * TIMES[3:-3] > 1.005).sum()
    assert report.speed_broken == pytest.approx(too_fast / 988)
    assert max(report.accel_broken, report.speed_broken) <= report.broken <= 1.0
    one = measure_motion(slow, RATE)
    again = check_bounds([(one, ["hand"]), (measure_motion(fast, RATE), ["hand"])], LOOSE)
    assert again["hand"] == report


def test_nothing_clean_is_unknown_not_kept():
    motion = measure_motion(np.full((50, 1, 3), np.nan), RATE)
    assert math.isnan(motion.noise[0])
    report = check_bounds([(motion, ["hand"])], LOOSE)["hand"]
    assert (report.seen, report.clean) == (0, 0)
    numbers = [*report.accel, *report.speed]
    numbers += [report.accel_broken, report.speed_broken, report.broken]
    assert np.isnan(numbers).all()
    assert check_bounds([(measure_motion(np.zeros((2, 1, 3)), RATE), ["hand"])])["hand"].clean == 0
    assert check_bounds([]) == {}


@pytest.mark.parametrize(
    ("position", "rate", "half_window", "message"),
    [
        (np.zeros((10, 3)), 100.0, 0.03, r"position: has shape \(10, 3\)"),
        (np.zeros((10, 1, 3)), 24.0, 0.03, "rate: is 24.0; expected at least 25 Hz"),
        (np.zeros((10, 1, 3)), math.nan, 0.03, "rate: is nan"),
        (np.zeros((10, 1, 3)), math.inf, 0.03, "rate: is inf"),
        (np.zeros((10, 1, 3)), 100.0, 0.0, "half_window: is 0.0"),
        (np.zeros((10, 1, 3)), 100.0, 0.2, "half_window: is 0.2"),
    ],
)
def test_what_cannot_be_measured_is_refused_by_name(position, rate, half_window, message):
    with pytest.raises(ArmguardError, match=message):
        measure_motion(position, rate, half_window)


def test_parts_that_do_not_fit_are_refused_by_name():
    motion = measure_motion(along_x(TIMES), RATE)
    with pytest.raises(ArmguardError, match="parts: has 2 names; expected one for 1"):
        check_bounds([(motion, ["hand", "hand"])])
    with pytest.raises(ArmguardError, match="part 'paw': has no bounds; expected one of head"):
        check_bounds([(motion, ["paw"])])


@pytest.mark.skipif(not RECORDINGS.is_dir(), reason="no recordings on this machine")
def test_people_keep_to_the_bounds_as_often_as_said():
    parts = [name.rpartition("_")[2] for name in POINTS]
    parts = [{"collar": "trunk", "hip": "trunk"}.get(part, part) for part in parts]
    motions = []
    for path in sorted(RECORDINGS.glob("*.csv")):
        rate, position = read_vicon_csv(path)
        motions.append((measure_motion(position, rate), parts))
    assert motions
    reports = check_bounds(motions)
    assert set(reports) == {"head", "trunk", "shoulder", "elbow", "hand"}
    for part, report in reports.items():
        assert report.clean > 0.98 * report.seen, part
        assert 100.0 * (1.0 - report.broken) >= BOUNDS[part].percentile, part
    # And one bound for all would not do: what hands keep to is far above what the trunk does.
    assert reports["hand"].accel[1] > 3.0 * reports["trunk"].accel[1]
