from __future__ import annotations

import math

import numpy as np
import pytest

from armguard.exceptions import ObstacleError
from armguard.obstacles import FaultKind, Obstacles, Source, table
from armguard.obstacles.faults import CAPACITY
from armguard.obstacles.sources import MAXIMUM_SOURCES, MAXIMUM_TOMBSTONES
from support.obstacle_samples import check_invariants, kinds, see


def test_membership_tells_the_monitor_which_rows_came_and_went():
    obstacles = Obstacles()
    a = see(obstacles, 0.0)
    added, removed = obstacles.drain_membership()
    assert (added.tolist(), removed.tolist()) == ([a], [])
    assert not any(map(len, obstacles.drain_membership()))
    obstacles.remove(["a"])
    b = see(obstacles, 0.0, id="b")
    assert a == b
    added, removed = obstacles.drain_membership()
    assert (added.tolist(), removed.tolist()) == ([a], [a])
    see(obstacles, 0.0, id="c")
    obstacles.remove(["c"])
    assert not any(map(len, obstacles.drain_membership()))


def test_named_sources_are_required_and_so_is_whoever_has_spoken():
    obstacles = Obstacles(sources=["cam0", Source("lidar", timeout=1.0), Source("b", None, False)])
    assert obstacles.has_sources
    assert obstacles.silent_sources(0.0, 0.2) == ["cam0", "lidar"]
    obstacles.update([], 1.0, source="cam0")
    obstacles.update([], 1.0, source="lidar")
    obstacles.update([], 1.0, source="new")
    assert obstacles.silent_sources(1.2, 0.2) == []
    assert obstacles.silent_sources(1.3, 0.2) == ["cam0", "new"]
    assert obstacles.silent_sources(2.1, 0.2) == ["cam0", "lidar", "new"]
    assert obstacles.silent_sources(math.nan, 0.2) == ["cam0", "lidar", "new"]
    assert [name for name, _ in obstacles.ahead_sources(0.85, 0.2)] == []
    assert [name for name, _ in obstacles.ahead_sources(0.5, 0.2)] == ["cam0", "lidar", "new"]


def test_without_sources_there_are_none():
    obstacles = Obstacles()
    assert not obstacles.has_sources
    assert obstacles.silent_sources(0.0, 0.2) == []
    see(obstacles, 0.0)
    assert obstacles.has_sources


@pytest.mark.parametrize("sources", ["cam0", ["a", "a"], [""], [3], [Source("a"), "a"]])
def test_source_names_are_checked(sources):
    with pytest.raises(ObstacleError):
        Obstacles(sources=sources)


def test_faults_are_bounded_and_counted():
    obstacles = Obstacles()
    for i in range(300):
        see(obstacles, float(i), x=math.nan)
    assert len(obstacles.take_faults()) == CAPACITY
    assert obstacles.fault_count == 300
    assert obstacles.take_dropped_faults() == 300 - CAPACITY
    assert obstacles.take_faults() == []


@pytest.fixture
def small_table(monkeypatch):
    monkeypatch.setattr(table, "MAXIMUM_ROWS", 64)
    obstacles = Obstacles()
    fill = [f"fill{i}" for i in range(64)]
    obstacles.update(fill, 0.0, np.zeros((64, 3)), radius=0.1, source="full")
    assert kinds(obstacles) == []
    return obstacles


def test_what_finds_no_room_is_missing_until_it_does(small_table):
    see(small_table, 0.0)
    assert kinds(small_table) == [FaultKind.TABLE_FULL]
    assert small_table.unplaced() == ["a"]
    small_table.update([], 0.1)
    assert small_table.unplaced() == ["a"]
    small_table.remove(["fill7"])
    assert small_table.unplaced() == ["a"]
    assert see(small_table, 0.2) >= 0
    assert small_table.unplaced() == []
    with pytest.raises(ObstacleError, match="no room"):
        small_table.add_static("pillar", [0.0, 0.0, 0.0], 0.1)
    assert small_table.unplaced() == ["pillar"]
    small_table.remove(["pillar"])
    assert small_table.unplaced() == []
    assert len(small_table) == 64


def test_what_found_no_room_is_missing_until_it_is_removed(small_table):
    see(small_table, 0.5)
    see(small_table, 0.4)
    small_table.take_faults()
    small_table.remove(["a"], source="nobody")
    small_table.remove(["a"], stamp=0.6, source="full")
    small_table.remove(["a"], stamp=0.45, source="default")
    assert kinds(small_table) == [FaultKind.UNKNOWN_ID] * 3
    assert small_table.unplaced() == ["a"]
    small_table.remove(["a"], stamp=0.5, source="default")
    assert kinds(small_table) == []
    assert small_table.unplaced() == []


def test_a_snapshot_says_anew_who_is_missing(small_table):
    many = [f"many{i}" for i in range(CAPACITY + 10)]
    small_table.update(many, 1.0, np.zeros((len(many), 3)), radius=0.1)
    see(small_table, 1.0, id="other", source="cam1")
    assert small_table.unplaced() == [*many[:CAPACITY], "more obstacles"]
    small_table.update([], 0.5, snapshot=True)
    assert len(small_table.unplaced()) == CAPACITY + 1
    see(small_table, 1.1, id="a", snapshot=True)
    # The other source's obstacle came too late to be known by name.
    assert small_table.unplaced() == ["a", "more obstacles"]
    small_table.update([], 1.2, source="cam1", snapshot=True)
    assert small_table.unplaced() == ["a"]
    small_table.update([], 1.2, snapshot=True)
    assert small_table.unplaced() == []


def test_sources_are_bounded():
    obstacles = Obstacles()
    for i in range(MAXIMUM_SOURCES):
        obstacles.update([], 0.0, source=f"s{i}")
    with pytest.raises(ObstacleError, match="one too many"):
        obstacles.update([], 0.0, source="one more")
    obstacles.update([], 1.0, source="s0")


def test_ids_that_come_and_go_leave_nothing_behind():
    obstacles = Obstacles()
    for i in range(300):
        names = [f"{i}-{j}" for j in range(40)]
        obstacles.update(names, float(i), np.zeros((40, 3)), radius=0.1, snapshot=True)
    assert len(obstacles) == 40
    assert len(obstacles.table.alive) == 128
    assert len(obstacles._tombstones._stones) <= MAXIMUM_TOMBSTONES
    assert len(obstacles._added) + len(obstacles._removed) <= 256
    check_invariants(obstacles)
    assert not obstacles.take_faults()
    # What fell out of the list of removed ids still cannot come back.
    see(obstacles, 0.5, id="0-0")
    assert obstacles.row("0-0") == -1
    assert kinds(obstacles) == [FaultKind.LATE]


def test_a_table_is_untouched_until_something_is_told_that_moves():
    for touch in (
        lambda table: table.update([], 0.0, source="camera"),
        lambda table: table.update(["a"], 0.0, [[1, 0, 0]], radius=0.1),
        lambda table: table.remove(["a"]),
        lambda table: table.leave_malformed("", "x", "y", math.nan),
    ):
        obstacles = Obstacles(sources=["camera"])
        obstacles.add_static("post", [0.0, 0.0, 1.0], 0.1)
        assert obstacles.is_untouched
        touch(obstacles)
        assert not obstacles.is_untouched


def test_rows_that_were_given_back_are_told_from_those_that_never_were():
    obstacles = Obstacles()
    for name in "abc":
        obstacles.add_static(name, [0.0, 0.0, 3.0], 0.1)
    obstacles.remove(["c"])
    assert obstacles.is_untouched, "the next row is that of a table that never had it"
    obstacles.remove(["b"])
    assert obstacles.is_untouched
    obstacles = Obstacles()
    for name in "abc":
        obstacles.add_static(name, [0.0, 0.0, 3.0], 0.1)
    for name in "bc":
        obstacles.remove([name])
    assert not obstacles.is_untouched, "the next row is another one"
