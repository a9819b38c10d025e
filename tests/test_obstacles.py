from __future__ import annotations

import contextlib
import csv
import math
import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armguard import obstacle_table
from armguard.exceptions import ObstacleError
from armguard.frames import Frame
from armguard.obstacle_faults import CAPACITY
from armguard.obstacles import Fault, FaultKind, Obstacles, Source
from armguard.sources import MAXIMUM_SOURCES, MAXIMUM_TOMBSTONES

INF = math.inf
RECORDINGS = Path(
    os.environ.get("ARMGUARD_RECORDINGS", Path(__file__).parents[1] / "../shared/data/human-motion")
)


def see(obstacles, stamp, x=0.0, id="a", **fields):
    """One ball on the x axis, at rest unless told otherwise."""
    fields = {"velocity": [[0.0, 0.0, 0.0]], "radius": 0.1, **fields}
    obstacles.update([id], stamp, [[x, 0.0, 0.0]], **fields)
    return obstacles.row(id)


def kinds(obstacles):
    return [fault.kind for fault in obstacles.take_faults()]


def check_invariants(obstacles):
    table = obstacles.table
    alive = np.flatnonzero(table.alive)
    assert len(obstacles) == len(alive)
    assert len(obstacles.ids) == len(table.alive)
    for row in alive:
        assert obstacles.row(obstacles.ids[row]) == row
        assert 1 <= table.point_count[row] <= 8
        assert table.has_state[row] or table.refused[row]
    assert sum(name != "" for name in obstacles.ids) == len(alive)
    assert not table.refused[~table.alive].any()
    held = table.alive & table.has_state
    assert np.isfinite(table.points[held]).all()
    assert np.isfinite(table.velocities[held]).all()
    assert np.isfinite(table.stamp[held]).all()
    for field in (table.radius, table.position_error):
        assert (np.isfinite(field[held]) & (field[held] >= 0.0)).all()
    for field in (table.accel, table.speed, table.velocity_error):
        assert (field[held] >= 0.0).all()
    aside = table.alive & table.refused & table.refused_finite
    assert np.isfinite(table.refused_points[aside]).all()
    assert np.isfinite(table.refused_velocities[aside]).all()
    assert set(obstacles.refused_rows()) == set(np.flatnonzero(table.refused))


# Taking


def test_a_message_fills_its_row():
    obstacles = Obstacles(accel=7.0, speed=3.0)
    obstacles.update(
        ["a", "b"],
        1.5,
        [[1, 2, 3], [4, 5, 6]],
        [[0.1, 0, 0], [0, 0.2, 0]],
        radius=[0.1, 0.2],
        accel=[1.0, INF],
        position_error=0.01,
        velocity_error=[0.0, 0.5],
        source="cam0",
    )
    table, row = obstacles.table, obstacles.row("b")
    assert obstacles.ids[row] == "b"
    assert obstacles.source_of(row) == "cam0"
    assert table.points[row, 0].tolist() == [4, 5, 6]
    assert table.velocities[row, 0].tolist() == [0, 0.2, 0]
    assert (table.point_count[row], table.radius[row], table.stamp[row]) == (1, 0.2, 1.5)
    assert (table.accel[row], table.speed[row]) == (INF, 3.0)
    assert (table.position_error[row], table.velocity_error[row]) == (0.01, 0.5)
    assert table.has_state[row]
    assert not table.refused[row]
    assert not obstacles.take_faults()
    assert obstacles.row("c") == -1
    check_invariants(obstacles)


def test_unknown_velocity_is_zero_with_an_error_of_the_speed_bound():
    obstacles = Obstacles(speed=1.5)
    obstacles.update(["a", "b"], 0.0, np.zeros((2, 3)), radius=0.1)
    obstacles.update(["c"], 0.0, np.zeros((1, 3)), radius=0.1, speed=INF, velocity_error=0.1)
    assert not obstacles.table.velocities.any()
    rows = [obstacles.row(id) for id in "abc"]
    assert obstacles.table.velocity_error[rows].tolist() == [1.5, 1.5, INF]
    assert obstacles.table.has_state[rows].all()


def test_boxes_and_capsules_keep_their_points():
    obstacles = Obstacles()
    points = np.arange(24.0).reshape(1, 8, 3)
    obstacles.update(["box"], 0.0, points, radius=0.0)
    obstacles.update(["capsule"], 0.0, points[:, :2], np.ones((1, 2, 3)), radius=0.0)
    table = obstacles.table
    assert np.array_equal(table.points[obstacles.row("box")], points[0])
    assert table.point_count[[obstacles.row("box"), obstacles.row("capsule")]].tolist() == [8, 2]


def test_the_table_grows_and_keeps_what_it_knows():
    obstacles = Obstacles()
    see(obstacles, 0.0, x=3.0, id="first")
    row = obstacles.row("first")
    names = [f"n{i}" for i in range(300)]
    obstacles.update(names, 0.0, np.zeros((300, 3)), radius=0.1)
    assert obstacles.row("first") == row
    assert obstacles.table.points[row, 0, 0] == 3.0
    assert len(obstacles.table.alive) == 512
    check_invariants(obstacles)


def test_frames_turn_positions_and_velocities_and_add_their_error():
    turn = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    obstacles = Obstacles(frames={"cam": Frame(turn, [10, 0, 0], 0.02)})
    position, velocity = np.array([[1.0, 2, 3]]), np.array([[1.0, 0, 0]])
    obstacles.update(["a"], 0.0, position, velocity, radius=0.1, position_error=0.01, frame="cam")
    row = obstacles.row("a")
    assert np.allclose(obstacles.table.points[row, 0], [8, 1, 3], atol=1e-12)
    assert np.allclose(obstacles.table.velocities[row, 0], [0, 1, 0], atol=1e-12)
    assert obstacles.table.position_error[row] == pytest.approx(0.03)
    # The caller's arrays are the caller's.
    assert position.tolist() == [[1, 2, 3]]
    assert velocity.tolist() == [[1, 0, 0]]


def test_statics_stand_still_and_belong_to_nobody():
    obstacles = Obstacles()
    obstacles.add_static("table", [1, 2, 3], 0.5)
    obstacles.add_static("wall", np.zeros((8, 3)), 0.0)
    table, row = obstacles.table, obstacles.row("table")
    assert table.static[row]
    assert table.has_state[row]
    bounds = [table.accel, table.speed, table.position_error, table.velocity_error]
    assert all(bound[row] == 0.0 for bound in bounds)
    assert obstacles.source_of(row) == ""
    assert not obstacles.has_sources
    see(obstacles, 1.0, id="table")
    assert kinds(obstacles) == [FaultKind.TWO_PUBLISHERS]
    assert table.points[row, 0].tolist() == [1, 2, 3]
    obstacles.update([], 2.0, snapshot=True)
    assert obstacles.row("table") == row
    obstacles.remove(["table"])
    obstacles.add_static("table", [0, 0, 0], 0.5)
    for bad in [("table", [0, 0, 0], 1.0), ("x", [0, 0, math.nan], 1.0), ("x", [0, 0, 0], -1.0)]:
        with pytest.raises(ObstacleError):
            obstacles.add_static(*bad)
    with pytest.raises(ObstacleError):
        obstacles.add_static("x", [[0, 0], [1]], 1.0)
    assert obstacles.row("x") == -1


# Refusing


@pytest.mark.parametrize(
    ("field", "value", "kind"),
    [
        ("position", [[0, math.nan, 0]], FaultKind.NOT_FINITE),
        ("position", [[0, INF, 0]], FaultKind.NOT_FINITE),
        ("velocity", [[0, 0, math.nan]], FaultKind.NOT_FINITE),
        ("velocity", [[2.5, 0, 0]], FaultKind.BEYOND_SPEED),
        ("radius", math.nan, FaultKind.NOT_FINITE),
        ("radius", INF, FaultKind.NOT_FINITE),
        ("radius", -0.1, FaultKind.NEGATIVE),
        ("accel", math.nan, FaultKind.NOT_FINITE),
        ("accel", -1.0, FaultKind.NEGATIVE),
        ("accel", -INF, FaultKind.NOT_FINITE),
        ("speed", math.nan, FaultKind.NOT_FINITE),
        ("speed", -1.0, FaultKind.NEGATIVE),
        ("position_error", INF, FaultKind.NOT_FINITE),
        ("position_error", -1.0, FaultKind.NEGATIVE),
        ("velocity_error", INF, FaultKind.NOT_FINITE),
        ("velocity_error", -1.0, FaultKind.NEGATIVE),
    ],
)
def test_a_bad_row_is_refused_and_the_good_one_beside_it_taken(field, value, kind):
    good = {
        "position": [[0.0, 0, 0]],
        "velocity": [[0.0, 0, 0]],
        "radius": 0.1,
        "accel": 10.0,
        "speed": 2.0,
        "position_error": 0.0,
        "velocity_error": 0.0,
    }
    both = {
        name: np.concatenate([np.atleast_1d(one), np.atleast_1d(value if name == field else one)])
        for name, one in good.items()
    }
    for fresh in (True, False):
        obstacles = Obstacles()
        if not fresh:
            obstacles.update(
                ["good", "bad"],
                0.0,
                **{k: [v, v] for k, v in good.items()}
                | {"position": np.zeros((2, 3)), "velocity": np.zeros((2, 3))},
            )
        obstacles.update(["good", "bad"], 0.01, **both, source="default")
        table, row = obstacles.table, obstacles.row("bad")
        assert table.stamp[obstacles.row("good")] == 0.01
        assert not table.refused[obstacles.row("good")]
        assert table.refused[row]
        assert table.has_state[row] == (not fresh)
        assert table.refused_finite[row] == (kind is FaultKind.BEYOND_SPEED)
        (fault,) = obstacles.take_faults()
        assert (fault.kind, fault.source, fault.id) == (kind, "default", "bad")
        assert (fault.field, fault.stamp) == (field, 0.01)
        assert obstacles.refused_rows().tolist() == [row]
        check_invariants(obstacles)
        see(obstacles, 0.02, id="bad")
        assert table.has_state[row]
        assert not table.refused[row]
        assert not len(obstacles.refused_rows())


def test_a_jump_leaves_the_accepted_state_and_keeps_the_sample_aside():
    obstacles = Obstacles()
    row = see(obstacles, 0.0)
    revision = obstacles.table.revision[row]
    see(obstacles, 0.01, x=1.0, radius=0.2)
    table = obstacles.table
    assert table.points[row, 0, 0] == 0.0
    assert table.stamp[row] == 0.0
    assert table.revision[row] == revision
    assert table.refused[row]
    assert table.refused_finite[row]
    assert table.refused_points[row, 0, 0] == 1.0
    assert table.refused_radius[row] == 0.2
    assert table.refused_stamp[row] == 0.01
    assert obstacles.take_faults() == [
        Fault(FaultKind.BEYOND_ACCEL, "default", "a", "position", 1.0, 0.01)
    ]
    see(obstacles, 0.02, x=0.001)
    assert not table.refused[row]
    assert table.points[row, 0, 0] == 0.001
    assert table.revision[row] == revision + 1


def test_another_track_is_believed_after_five_samples_that_agree():
    obstacles = Obstacles()
    row = see(obstacles, 0.0)
    revision = obstacles.table.revision[row]
    for i in range(1, 5):
        see(obstacles, 0.01 * i, x=1.0)
        assert obstacles.table.refused[row]
    assert kinds(obstacles) == [FaultKind.BEYOND_ACCEL] * 4
    see(obstacles, 0.05, x=1.0)
    assert kinds(obstacles) == [FaultKind.TRACK_CHANGED]
    assert not obstacles.table.refused[row]
    assert obstacles.table.points[row, 0, 0] == 1.0
    assert obstacles.table.revision[row] == revision + 1


def test_samples_that_do_not_agree_never_make_a_track():
    obstacles = Obstacles()
    row = see(obstacles, 0.0)
    for i in range(1, 40):
        see(obstacles, 0.01 * i, x=2.0 + 2.0 * (i % 4 == 0))
        assert obstacles.table.refused[row]
        assert obstacles.table.points[row, 0, 0] == 0.0
    # A repeated message is no further evidence.
    for _ in range(10):
        see(obstacles, 0.5, x=9.0)
    assert obstacles.table.points[row, 0, 0] == 0.0
    # Nor is one that cannot be reckoned with.
    for i in range(10):
        see(obstacles, 0.6 + 0.01 * i, x=9.0, velocity=[[5.0, 0.0, 0.0]])
        assert obstacles.table.refused[row]


def test_a_larger_body_or_wider_bounds_are_news_not_implausible():
    obstacles = Obstacles()
    row = see(obstacles, 0.0)
    for i, change in enumerate(
        [{"radius": 0.5}, {"accel": 50.0}, {"speed": 5.0}, {"position_error": 0.1}]
    ):
        revision = obstacles.table.revision[row]
        see(obstacles, 0.01 * (i + 1), **change)
        assert not obstacles.table.refused[row]
        assert obstacles.table.revision[row] == revision + 1
    assert not obstacles.take_faults()


def test_another_shape_is_another_track():
    obstacles = Obstacles()
    row = see(obstacles, 0.0)
    for i in range(1, 6):
        obstacles.update(["a"], 0.01 * i, np.zeros((1, 2, 3)), radius=0.1)
    assert kinds(obstacles) == [FaultKind.SHAPE_CHANGED] * 4 + [FaultKind.TRACK_CHANGED]
    assert obstacles.table.point_count[row] == 2


def test_an_id_has_one_publisher():
    obstacles = Obstacles()
    row = see(obstacles, 0.0, source="cam0")
    for i in range(1, 10):
        see(obstacles, 0.01 * i, x=0.0, source="cam1")
        assert obstacles.table.refused[row]
    assert set(kinds(obstacles)) == {FaultKind.TWO_PUBLISHERS}
    assert obstacles.table.stamp[row] == 0.0
    see(obstacles, 0.2, source="cam0")
    assert not obstacles.table.refused[row]


def test_distrust_turns_the_state_into_a_refused_sample():
    obstacles = Obstacles()
    row = see(obstacles, 1000.0, x=0.5)
    assert obstacles.rows_ahead(10.0, 0.2).tolist() == [row]
    assert obstacles.ahead_sources(10.0, 0.2) == ["default"]
    revision = obstacles.table.revision[row]
    obstacles.distrust(row)
    table = obstacles.table
    assert not table.has_state[row]
    assert table.refused[row]
    assert table.refused_points[row, 0, 0] == 0.5
    assert table.refused_stamp[row] == 1000.0
    assert table.revision[row] > revision
    assert obstacles.refused_rows().tolist() == [row]
    assert not len(obstacles.rows_ahead(10.0, 0.2))
    see(obstacles, 10.0, x=3.0)
    assert table.has_state[row]
    assert not table.refused[row]
    assert not obstacles.ahead_sources(10.0, 0.2)
    assert not len(obstacles.rows_ahead(10.0, 0.2))


# Late


def test_late_messages_that_agree_are_ignored_and_counted():
    obstacles = Obstacles()
    row = see(obstacles, 1.0)
    for stamp in (0.9, 1.0, 0.95, 1.0):
        see(obstacles, stamp)
    assert obstacles.late_count == 4
    assert obstacles.table.stamp[row] == 1.0
    assert not obstacles.table.refused[row]
    assert not obstacles.take_faults()
    see(obstacles, 0.99, x=1.0)
    assert kinds(obstacles) == [FaultKind.BEYOND_ACCEL]
    assert obstacles.table.refused[row]


def test_a_stamp_far_ahead_does_not_lock_a_row():
    obstacles = Obstacles()
    row = see(obstacles, 1e6)
    for i in range(1, 6):
        assert obstacles.table.stamp[row] == 1e6
        see(obstacles, 0.01 * i)
    assert obstacles.table.stamp[row] == 0.05
    assert kinds(obstacles) == [FaultKind.TRACK_CHANGED]
    see(obstacles, 0.06)
    assert obstacles.table.stamp[row] == 0.06


def test_duplicates_between_new_messages_never_turn_a_row_back():
    obstacles = Obstacles()
    for i in range(100):
        row = see(obstacles, 0.01 * i)
        see(obstacles, 0.01 * (i - 7))
        assert obstacles.table.stamp[row] == 0.01 * i
    assert not obstacles.take_faults()
    assert obstacles.late_count == 100


def test_of_two_descriptions_with_one_stamp_the_larger_stands():
    obstacles = Obstacles()
    row = see(obstacles, 1.0)
    table, revision = obstacles.table, obstacles.table.revision[row]
    see(obstacles, 1.0)
    see(obstacles, 1.0, radius=0.05)
    assert table.revision[row] == revision
    see(obstacles, 1.0, x=0.01, radius=0.5, accel=20.0, position_error=0.02)
    assert table.revision[row] == revision + 1
    see(obstacles, 0.9, radius=0.7)
    assert (table.radius[row], table.accel[row], table.speed[row]) == (0.5, 20.0, 2.0)
    assert (table.points[row, 0, 0], table.position_error[row]) == (0.0, 0.02)
    see(obstacles, 1.1)
    assert table.radius[row] == 0.1
    assert not obstacles.take_faults()


def test_late_messages_do_not_hide_a_track_that_is_about_to_be_believed():
    obstacles = Obstacles()
    row = see(obstacles, 1.0)
    for i in range(1, 6):
        see(obstacles, 0.9 + 0.01 * i)
        see(obstacles, 1.0 + 0.01 * i, x=1.0)
    assert obstacles.table.points[row, 0, 0] == 1.0
    assert not obstacles.table.refused[row]


# Removing


def test_removal_outlives_older_messages():
    obstacles = Obstacles()
    row = see(obstacles, 1.0)
    obstacles.remove(["a"], stamp=1.5)
    assert obstacles.row("a") == -1
    assert obstacles.ids[row] == ""
    for stamp in (1.1, 1.2, 1.3, 1.4, 1.45, 1.5):
        see(obstacles, stamp)
        assert obstacles.row("a") == -1
    assert obstacles.late_count == 6
    assert not obstacles.take_faults()
    see(obstacles, 1.51)
    assert obstacles.row("a") >= 0
    obstacles.remove(["a"])
    see(obstacles, 1.51)
    assert obstacles.row("a") == -1
    check_invariants(obstacles)


def test_removals_that_are_refused():
    obstacles = Obstacles()
    row = see(obstacles, 1.0, source="cam0")
    see(obstacles, 1.0, id="b", source="cam1")
    obstacles.remove(["a"], stamp=0.5)
    obstacles.remove(["a"], source="cam1")
    obstacles.remove(["a"], source="nobody")
    obstacles.remove(["ghost"])
    assert kinds(obstacles) == [
        FaultKind.STALE_REMOVAL,
        FaultKind.TWO_PUBLISHERS,
        FaultKind.TWO_PUBLISHERS,
        FaultKind.UNKNOWN_ID,
    ]
    assert obstacles.row("a") == row
    # The removal of what is still under way.
    obstacles.remove(["c"], stamp=2.0, source="cam1")
    obstacles.remove(["c"], stamp=1.5, source="cam1")
    see(obstacles, 1.9, id="c", source="cam1")
    assert obstacles.row("c") == -1


def test_a_snapshot_removes_what_its_source_no_longer_sees():
    obstacles = Obstacles()
    see(obstacles, 1.0, id="other", source="cam1")
    names = ["a", "b", "c"]
    obstacles.update(names, 1.0, np.zeros((3, 3)), radius=0.1, source="cam0")
    obstacles.update(["a"], 1.1, [[0, 0, 0]], radius=0.1, source="cam0")
    assert len(obstacles) == 4
    bad = [[0, 0, 0], [math.nan, 0, 0]]
    obstacles.update(["a", "b"], 1.2, bad, radius=0.1, source="cam0", snapshot=True)
    assert sorted(name for name in obstacles.ids if name) == ["a", "b", "other"]
    # A snapshot that comes late says nothing about what was seen since.
    obstacles.update(["a"], 1.15, [[0, 0, 0]], radius=0.1, source="cam0", snapshot=True)
    see(obstacles, 1.3, id="b", source="cam0")
    obstacles.update([], 1.25, source="cam0", snapshot=True)
    assert sorted(name for name in obstacles.ids if name) == ["b", "other"]
    obstacles.update([], 1.4, source="cam0", snapshot=True)
    assert [name for name in obstacles.ids if name] == ["other"]
    check_invariants(obstacles)


def test_a_removal_stamped_far_ahead_does_not_hide_an_id_for_ever():
    obstacles = Obstacles()
    see(obstacles, 1.0)
    obstacles.remove(["a"], stamp=1e9, source="default")
    assert obstacles.ahead_sources(1.0, 0.2) == ["default"]
    see(obstacles, 1.01)
    assert obstacles.row("a") >= 0


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


# Sources


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
    assert obstacles.ahead_sources(0.85, 0.2) == []
    assert obstacles.ahead_sources(0.5, 0.2) == ["cam0", "lidar", "new"]


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


@pytest.mark.parametrize("bound", [-1.0, math.nan, "2", None, True])
def test_default_bounds_are_checked(bound):
    with pytest.raises(ObstacleError):
        Obstacles(accel=bound)
    with pytest.raises(ObstacleError):
        Obstacles(speed=bound)


# Malformed calls


@pytest.mark.parametrize(
    ("change", "offender"),
    [
        ({"ids": "ab"}, "ids"),
        ({"ids": ["a", 3]}, "ids"),
        ({"ids": ["a", "a"]}, "ids"),
        ({"ids": ["a", ""]}, "ids"),
        ({"ids": None}, "ids"),
        ({"ids": ["a"]}, "position"),
        ({"stamp": math.nan}, "stamp"),
        ({"stamp": INF}, "stamp"),
        ({"stamp": "now"}, "stamp"),
        ({"stamp": None}, "stamp"),
        ({"stamp": 10**400}, "stamp"),
        ({"position": [[0, 0], [0, 0]]}, "position"),
        ({"position": [[0, 0, 0], [0, 0]]}, "position"),
        ({"position": np.zeros((2, 9, 3))}, "position"),
        ({"position": np.zeros((2, 0, 3))}, "position"),
        ({"position": [["x", "y", "z"]] * 2}, "position"),
        ({"position": np.zeros((2, 3), dtype=complex)}, "position"),
        ({"velocity": np.zeros((1, 3))}, "velocity"),
        ({"velocity": np.zeros((2, 2, 3))}, "velocity"),
        ({"radius": None}, "radius"),
        ({"radius": [0.1]}, "radius"),
        ({"radius": [[0.1], [0.1]]}, "radius"),
        ({"accel": [1.0, 1.0, 1.0]}, "accel"),
        ({"speed": "fast"}, "speed"),
        ({"position_error": None}, "position_error"),
        ({"velocity_error": [None, 0.0]}, "velocity_error"),
        ({"source": ""}, "source"),
        ({"source": 3}, "source"),
        ({"source": None}, "source"),
        ({"frame": "moon"}, "frame"),
        ({"frame": ["world"]}, "frame"),
        ({"snapshot": "yes"}, "snapshot"),
    ],
)
def test_a_malformed_call_raises_and_leaves_a_fault_and_nothing_else(change, offender):
    obstacles = Obstacles()
    call = {"ids": ["a", "b"], "stamp": 1.0, "position": np.zeros((2, 3)), "radius": 0.1} | change
    with pytest.raises(ObstacleError) as caught:
        obstacles.update(**call)
    assert caught.value.offender == offender
    (fault,) = obstacles.take_faults()
    assert (fault.kind, fault.field, fault.id) == (FaultKind.MALFORMED, offender, "")
    assert obstacles.fault_count == 1
    assert len(obstacles) == 0
    assert not obstacles.has_sources


def test_masked_positions_were_not_measured():
    obstacles = Obstacles()
    position = np.ma.masked_array(np.zeros((1, 3)), mask=[[False, True, False]])
    obstacles.update(["a"], 0.0, position, radius=0.1)
    assert kinds(obstacles) == [FaultKind.NOT_FINITE]


# Bounded memory


def test_faults_are_bounded_and_counted():
    obstacles = Obstacles()
    for i in range(300):
        see(obstacles, float(i), x=math.nan)
    assert len(obstacles.take_faults()) == CAPACITY
    assert obstacles.fault_count == 300
    assert obstacles.dropped_faults == 300 - CAPACITY
    assert obstacles.take_faults() == []


@pytest.fixture
def small_table(monkeypatch):
    monkeypatch.setattr(obstacle_table, "MAXIMUM_ROWS", 64)
    obstacles = Obstacles()
    fill = [f"fill{i}" for i in range(64)]
    obstacles.update(fill, 0.0, np.zeros((64, 3)), radius=0.1, source="full")
    assert kinds(obstacles) == []
    return obstacles


def test_what_finds_no_room_is_missing_until_it_does(small_table):
    see(small_table, 0.0)
    assert kinds(small_table) == [FaultKind.TABLE_FULL]
    assert small_table.homeless() == ["a"]
    small_table.update([], 0.1)
    assert small_table.homeless() == ["a"]
    small_table.remove(["fill7"])
    assert small_table.homeless() == ["a"]
    assert see(small_table, 0.2) >= 0
    assert small_table.homeless() == []
    with pytest.raises(ObstacleError, match="no room"):
        small_table.add_static("pillar", [0.0, 0.0, 0.0], 0.1)
    assert small_table.homeless() == ["pillar"]
    small_table.remove(["pillar"])
    assert small_table.homeless() == []
    assert len(small_table) == 64


def test_what_found_no_room_is_missing_until_it_is_removed(small_table):
    see(small_table, 0.5)
    see(small_table, 0.4)
    small_table.take_faults()
    small_table.remove(["a"], source="nobody")
    small_table.remove(["a"], stamp=0.6, source="full")
    small_table.remove(["a"], stamp=0.45, source="default")
    assert kinds(small_table) == [FaultKind.UNKNOWN_ID] * 3
    assert small_table.homeless() == ["a"]
    small_table.remove(["a"], stamp=0.5, source="default")
    assert kinds(small_table) == []
    assert small_table.homeless() == []


def test_a_snapshot_says_anew_who_is_missing(small_table):
    many = [f"many{i}" for i in range(CAPACITY + 10)]
    small_table.update(many, 1.0, np.zeros((len(many), 3)), radius=0.1)
    see(small_table, 1.0, id="other", source="cam1")
    assert small_table.homeless() == [*many[:CAPACITY], "more obstacles"]
    small_table.update([], 0.5, snapshot=True)
    assert len(small_table.homeless()) == CAPACITY + 1
    see(small_table, 1.1, id="a", snapshot=True)
    # The other source's obstacle came too late to be known by name.
    assert small_table.homeless() == ["a", "more obstacles"]
    small_table.update([], 1.2, source="cam1", snapshot=True)
    assert small_table.homeless() == ["a"]
    small_table.update([], 1.2, snapshot=True)
    assert small_table.homeless() == []


def test_a_hundred_thousand_obstacles_find_room():
    obstacles = Obstacles()
    names = [f"part{i}" for i in range(100_000)]
    obstacles.update(names, 0.0, np.zeros((len(names), 3)), radius=0.01)
    assert len(obstacles) == 100_000
    assert obstacles.take_faults() == []


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


# Laws


def test_feasible_motions_with_errors_are_never_refused():
    rng = np.random.default_rng(7)
    count, accel, speed = 30, 10.0, 2.0
    position_error, velocity_error = 0.01, 0.1
    obstacles = Obstacles(accel=accel, speed=speed)
    names = [f"n{i}" for i in range(count)]
    position, velocity = rng.normal(size=(count, 3)), np.zeros((count, 3))
    stamp = 50.0
    for step in range(500):
        noise = [rng.normal(size=(count, 3)) for _ in range(2)]
        noise = [e / np.linalg.norm(e, axis=1, keepdims=True) * (1 - 1e-9) for e in noise]
        obstacles.update(
            names,
            stamp,
            position + noise[0] * position_error,
            velocity + noise[1] * velocity_error if step % 3 else None,
            radius=0.1,
            position_error=position_error,
            velocity_error=velocity_error,
        )
        assert not obstacles.table.refused.any()
        h = rng.choice([0.001, 0.01, 0.05])
        push = rng.normal(size=(count, 3))
        push *= accel / np.linalg.norm(push, axis=1, keepdims=True) * (1 - 1e-9)
        after = velocity + push * h
        push[np.linalg.norm(after, axis=1) > speed] = 0.0
        position = position + velocity * h + push * h * h / 2
        velocity = velocity + push * h
        stamp += h
    assert obstacles.take_faults() == []


def test_jumps_beyond_bounds_and_errors_are_always_refused():
    rng = np.random.default_rng(8)
    count = 500
    obstacles = Obstacles()
    names = [f"n{i}" for i in range(count)]
    position = rng.normal(size=(count, 3))
    obstacles.update(names, 0.0, position, np.zeros((count, 3)), radius=0.1, position_error=0.01)
    h = 0.02
    away = rng.normal(size=(count, 3))
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    reach = (10.0 * h * h / 2 + 0.02) * rng.uniform(1.0 + 1e-9, 3.0, size=(count, 1))
    obstacles.update(names, h, position + away * reach, radius=0.1, position_error=0.01)
    assert obstacles.table.refused.sum() == count


numbers = st.floats(allow_nan=True, allow_infinity=True)
anything = st.one_of(numbers, st.none(), st.text(max_size=2), st.integers())
row_numbers = st.one_of(numbers, st.floats(0.0, 3.0))
names = st.lists(st.sampled_from(["a", "b", "c", "d"]), max_size=4, unique=True)
stamps = st.floats(-10.0, 10.0)


@st.composite
def calls(draw):
    ids = draw(names)
    count = len(ids)
    points = draw(st.integers(1, 2))
    vectors = st.lists(row_numbers, min_size=count * points * 3, max_size=count * points * 3)
    fields = st.one_of(row_numbers, st.lists(row_numbers, min_size=count, max_size=count))
    shape = (count, points, 3)
    return {
        "ids": ids,
        "stamp": draw(stamps),
        "position": np.array(draw(vectors)).reshape(shape),
        "velocity": draw(st.none() | vectors.map(lambda flat: np.array(flat).reshape(shape))),
        "radius": draw(fields),
        "accel": draw(st.none() | fields),
        "speed": draw(st.none() | fields),
        "position_error": draw(fields),
        "velocity_error": draw(fields),
        "source": draw(st.sampled_from(["cam0", "cam1"])),
        "frame": draw(st.sampled_from(["world", "cam"])),
        "snapshot": draw(st.booleans()),
    }


@settings(max_examples=150, deadline=None)
@given(
    st.lists(
        st.one_of(
            calls(),
            st.tuples(names, st.none() | stamps, st.none() | st.just("cam0")),
            st.integers(0, 63),
        ),
        max_size=20,
    )
)
def test_well_formed_calls_never_raise_whatever_their_numbers(actions):
    turn = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    obstacles = Obstacles(frames={"cam": Frame(turn, [1, 0, 0], 0.1)})
    members = set()
    for action in actions:
        if isinstance(action, dict):
            obstacles.update(**action)
        elif isinstance(action, tuple):
            obstacles.remove(*action)
        elif obstacles.table.alive[action]:
            obstacles.distrust(action)
        check_invariants(obstacles)
        obstacles.silent_sources(0.0, 0.2)
        obstacles.ahead_sources(0.0, 0.2)
        obstacles.rows_ahead(0.0, 0.2)
        added, removed = obstacles.drain_membership()
        members = (members - set(removed.tolist())) | set(added.tolist())
        assert members == set(np.flatnonzero(obstacles.table.alive).tolist())
        obstacles.take_faults()


@settings(max_examples=300, deadline=None)
@given(st.tuples(*[anything | st.lists(anything, max_size=3)] * 12))
def test_hostile_calls_raise_nothing_but_obstacle_errors(arguments):
    obstacles = Obstacles()
    try:
        obstacles.update(*arguments)
    except ObstacleError:
        assert kinds(obstacles) == [FaultKind.MALFORMED]
    with contextlib.suppress(ObstacleError):
        obstacles.remove(*arguments[:3])
    with contextlib.suppress(ObstacleError):
        obstacles.add_static(*arguments[:3])
    check_invariants(obstacles)


# Real people


def read_recording(path):
    """Names, times and positions in [m] of a Vicon table. Shape (frames, bodies, 3)."""
    with path.open(encoding="utf-8-sig", newline="") as file:
        lines = list(csv.reader(file))
    bodies = [cell.split(":")[-1] for cell in lines[2] if cell]
    frames = [
        [float(cell) if cell else math.nan for cell in line[2 : 2 + 6 * len(bodies)]]
        for line in lines[5:]
        if len(line) >= 2 + 6 * len(bodies)
    ]
    positions = np.array(frames).reshape(len(frames), len(bodies), 6)[:, :, 3:] / 1000.0
    return bodies, np.arange(len(frames)) / float(lines[1][0]), positions


@pytest.mark.skipif(not RECORDINGS.is_dir(), reason="no recordings on this machine")
@pytest.mark.parametrize(
    ("name", "glitches"),
    [
        ("handball-0", False),
        ("stacking-2", False),
        ("handover-0", True),
        ("hammering-0", True),
        ("pick-place-close-6", True),
    ],
)
def test_glitches_in_recordings_are_refused_and_people_are_not(name, glitches):
    bodies, times, positions = read_recording(RECORDINGS / f"{name}.csv")
    obstacles = Obstacles(accel=10.0, speed=2.0)
    refused = set()
    for time, position in zip(times, positions, strict=True):
        seen = np.isfinite(position).all(axis=1)
        ids = [body for body, there in zip(bodies, seen, strict=True) if there]
        obstacles.update(ids, time, position[seen], radius=0.1, position_error=0.005)
        refused.update(obstacles.ids[row] for row in obstacles.refused_rows())
        check_invariants(obstacles)
    assert bool(refused) == glitches
    assert len(obstacles) == len(bodies)
