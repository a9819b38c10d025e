"""What observers are shown must be what the monitor said, and their own to keep."""

import math

import numpy as np
import pytest

from armguard import Monitor, Obstacles, Robot
from armguard.monitor.reports import BUCKETS, bucket_of
from armguard.pairs.scene import BOUND_NAMES


def test_buckets():
    assert [bucket_of(time, 0.001) for time in (0.0, 0.001, 0.0019, 0.0021, 0.0041)] == [
        0, 0, 0, 1, 2,
    ]  # fmt: skip
    for time in (65.537, 1e9, 1e308, math.inf, math.nextafter(65.536, 0.0)):
        assert bucket_of(time, 0.001) == BUCKETS - 1
    assert bucket_of(math.nan, 0.001) == 0
    assert bucket_of(1e308, 5e-324) == BUCKETS - 1


READY = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
EVERYTHING = {"pair_limit": 10_000, "row_limit": 10_000}
PERIOD = 1e-3


@pytest.fixture(scope="module")
def robot():
    return Robot.load("panda")


def run_monitor(robot, count=12, ticks=1, **options):
    """A monitor after some ticks beside `count` balls and a capsule."""
    obstacles = Obstacles(sources=[])
    random = np.random.default_rng(1)
    monitor = Monitor(robot, obstacles, **options)
    positions = random.uniform(-2.5, 2.5, (count, 3))
    for tick in range(1, ticks + 1):
        now = PERIOD * tick
        names = [f"ball{number}" for number in range(count)]
        obstacles.update(names, now, positions, np.zeros((count, 3)), radius=0.1)
        limb = [[[0.9, 0.1, 0.2], [0.9, 0.1, 0.9]]]
        obstacles.update(["limb"], now, limb, np.zeros((1, 2, 3)), radius=0.05)
        verdict = monitor.step(now, READY, np.zeros(7))
    return monitor, verdict


@pytest.mark.parametrize("schedule", ["deadline", "full", "daa"])
def test_the_soonest_of_everything_is_the_verdict(robot, schedule):
    monitor, verdict = run_monitor(robot, schedule=schedule, ticks=20)
    snapshot = monitor.snapshot(**EVERYTHING)
    assert snapshot.pair_times[0] == pytest.approx(verdict.contact_time, abs=1e-12)
    assert snapshot.row_times[0] == snapshot.pair_times[0]
    row, link = divmod(int(snapshot.pairs[0]), len(robot.links))
    assert monitor.obstacles.ids[row] == verdict.obstacle
    assert robot.links[link] == verdict.link
    assert snapshot.sphere_times.min() <= verdict.contact_time + 1e-12


def test_rows_and_pairs_are_ordered_and_agree(robot):
    monitor, _ = run_monitor(robot)
    snapshot = monitor.snapshot(**EVERYTHING)
    assert len(snapshot.pairs) == 13 * len(robot.links)
    told = {(pair.link, pair.obstacle): pair.bound for pair in monitor.pairs(10_000)}
    for pair, bound in zip(snapshot.pairs, snapshot.pair_bounds, strict=True):
        row, link = divmod(int(pair), len(robot.links))
        assert told[robot.links[link], monitor.obstacles.ids[row]] == BOUND_NAMES[bound]
    assert np.array_equal(np.sort(snapshot.all_times), snapshot.pair_times)
    assert sorted(snapshot.rows) == sorted({pair // len(robot.links) for pair in snapshot.pairs})
    for times in (snapshot.pair_times, snapshot.row_times):
        assert np.all(np.diff(times) >= 0.0)
    for row, time in zip(snapshot.rows, snapshot.row_times, strict=True):
        of_row = snapshot.pair_times[snapshot.pairs // len(robot.links) == row]
        assert time == of_row.min()


@pytest.mark.parametrize("limit", [0, 1, 5, 13])
def test_limits_keep_the_most_imminent(robot, limit):
    monitor, _ = run_monitor(robot)
    everything = monitor.snapshot(**EVERYTHING)
    some = monitor.snapshot(pair_limit=limit, row_limit=limit)
    assert np.array_equal(some.pair_times, everything.pair_times[:limit])
    assert np.array_equal(some.pairs, everything.pairs[:limit])
    assert np.array_equal(some.pair_bounds, everything.pair_bounds[:limit])
    assert np.array_equal(some.row_times, everything.row_times[:limit])


def test_spheres_are_those_of_the_finest_cover(robot):
    monitor, _ = run_monitor(robot)
    count = sum(len(robot.cover.spheres(link)) for link in robot.links)
    times = monitor.snapshot(**EVERYTHING).sphere_times
    assert times.shape == (count,)
    assert not np.isnan(times).any()


def test_it_is_a_copy(robot):
    monitor, _ = run_monitor(robot)
    first = monitor.snapshot(**EVERYTHING)
    for array in first:
        array[...] = 0
    second = monitor.snapshot(**EVERYTHING)
    assert np.any(second.q)
    assert np.any(second.pair_times)


def test_before_the_first_tick_and_without_obstacles_there_is_little_to_see(robot):
    fresh = Monitor(robot, Obstacles(sources=[])).snapshot(**EVERYTHING)
    assert len(fresh.pairs) == len(fresh.rows) == 0
    alone = Monitor(robot, Obstacles(sources=[]))
    alone.step(0.0, READY, np.zeros(7))
    snapshot = alone.snapshot(**EVERYTHING)
    assert len(snapshot.pairs) == 0
    assert np.all(np.isinf(snapshot.sphere_times))
    assert np.array_equal(snapshot.q, READY)
