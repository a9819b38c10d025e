from __future__ import annotations

import numpy as np

from armguard.obstacles import Obstacles
from armguard.obstacles import table as obstacle_table
from armguard.obstacles.possible_states import distrust
from armguard.obstacles.table import MOST_REFUSED, ObstacleTable
from support.obstacle_samples import check_invariants, refused, see


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


def test_distrust_turns_the_state_into_a_refused_sample():
    obstacles = Obstacles()
    row = see(obstacles, 1000.0, x=0.5)
    assert obstacles.rows_ahead(10.0, 0.2).tolist() == [row]
    assert [name for name, _ in obstacles.ahead_sources(10.0, 0.2)] == ["default"]
    revision = obstacles.table.revision[row]
    obstacles.distrust(row)
    table = obstacles.table
    assert not table.has_state[row]
    assert table.refused[row]
    assert refused(obstacles, row) == [0.5]
    assert table.refused_states.stamp[row * MOST_REFUSED] == 1000.0
    assert table.revision[row] > revision
    assert obstacles.refused_rows().tolist() == [row]
    assert not len(obstacles.rows_ahead(10.0, 0.2))
    # What nothing else is known of stays as it is, however long it was possible.
    for now in (10.0, 20.0):
        obstacles.forget_refused(now, 0.3)
        assert refused(obstacles, row) == [0.5]
    see(obstacles, 10.0, x=3.0)
    assert table.has_state[row]
    obstacles.forget_refused(20.0, 0.3)
    assert not table.refused[row]
    assert not obstacles.ahead_sources(10.0, 0.2)
    assert not len(obstacles.rows_ahead(10.0, 0.2))


def test_a_row_that_is_taken_again_has_nothing_of_the_one_before():
    table = ObstacleTable(4)
    row = table.take_row(3)
    table.place_static(row, np.ones((8, 3)), 0.5)
    table.refused[row] = table.unknown[row] = True
    table.refused_count[row] = 3
    revision = table.revision[row]
    table.free_row(row)
    assert not table.alive.any()
    assert table.take_row(5) == row
    assert (table.owner[row], table.point_count[row]) == (5, 1)
    assert not (table.static | table.has_state | table.refused | table.unknown)[row]
    assert table.refused_count[row] == 0
    assert table.revision[row] > revision


def test_rows_are_given_out_once_and_in_order_until_there_are_no_more(monkeypatch):
    monkeypatch.setattr(obstacle_table, "MAXIMUM_ROWS", 16)
    table = ObstacleTable(4)
    assert [table.take_row(0) for _ in range(17)] == [*range(16), -1]
    table.free_row(7)
    assert table.take_row(0) == 7


def test_what_stands_still_is_not_distrusted():
    table = ObstacleTable()
    row = table.take_row(0)
    table.place_static(row, np.zeros((1, 3)), 0.1)
    distrust(table.handle, row)
    assert table.has_state[row]
    assert not table.refused[row]


def drain(table):
    rows = table.changed[: table.changed_count[0]].tolist()
    assert table.is_changed.sum() == len(set(rows)) == len(rows)
    assert table.is_changed[rows].all()
    obstacle_table.clear_changed_rows(table.changed_rows)
    assert not table.is_changed.any()
    return rows


def test_a_changed_row_is_entered_once_until_it_is_drained():
    table = ObstacleTable(4)
    assert drain(table) == []
    for _ in range(3):
        table.take_row(0)
    assert drain(table) == [0, 1, 2]
    table.place_static(2, np.zeros((1, 3)), 0.1)
    table.has_state[1] = True
    distrust(table.handle, 1)
    distrust(table.handle, 1)
    distrust(table.handle, 2)
    assert drain(table) == [2, 1]
    table.free_row(1)
    assert table.take_row(0) == 1
    table.free_row(1)
    assert drain(table) == [1]
    assert drain(table) == []


def test_changed_rows_survive_growth():
    table = ObstacleTable(2)
    for _ in range(9):
        table.take_row(0)
    assert table.changed is table.changed_rows.changed
    assert len(table.changed) == len(table.is_changed) == len(table.alive)
    assert drain(table) == list(range(9))
    table.take_row(0)
    assert drain(table) == [9]


def test_changed_rows_are_never_more_than_rows(monkeypatch):
    monkeypatch.setattr(obstacle_table, "MAXIMUM_ROWS", 8)
    table = ObstacleTable(8)
    for _ in range(100):
        rows = [table.take_row(0) for _ in range(8)]
        for row in rows:
            table.free_row(row)
    assert sorted(drain(table)) == list(range(8))


def test_points_have_as_much_room_as_the_scene_requires():
    obstacles = Obstacles()
    ball = see(obstacles, 0.0, x=3.0)
    aside = see(obstacles, 0.0, x=1.0, id="aside")
    see(obstacles, 0.01, x=2.0, id="aside")
    table = obstacles.table
    widths = []
    for count in (1, 2, 3, 4, 5, 8, 2):
        points = np.arange(3.0 * count).reshape(1, count, 3)
        obstacles.update([f"hull{count}"], 0.01, points, radius=0.0)
        row = obstacles.row(f"hull{count}")
        assert table.point_count[row] == count
        assert np.array_equal(table.points[row, :count], points[0])
        assert not table.points[row, count:].any()
        shapes = {
            group._asdict()[field].shape
            for group in (table.accepted, table.candidates)
            for field in ("points", "velocities")
        }
        assert len(shapes) == 1
        widths.append(shapes.pop()[1])
        assert table.points is table.accepted.points
        assert table.refused_states.points.shape == (MOST_REFUSED * len(table.alive), widths[-1], 3)
        assert table.spreads.last.shape == (len(table.alive), widths[-1], 3)
        assert (table.points[ball, 0, 0], table.radius[ball]) == (3.0, 0.1)
        assert refused(obstacles, aside) == [2.0]
        place = aside * MOST_REFUSED
        assert table.refused_states.radius[place] == 0.1
        assert table.refused_states.point_count[place] == 1
        check_invariants(obstacles)
    assert widths == [1, 2, 4, 4, 8, 8, 8]


def test_a_track_about_to_be_believed_survives_a_larger_table():
    obstacles = Obstacles()
    row = see(obstacles, 1.0)
    see(obstacles, 1.01, x=1.0)
    assert obstacles.table.refused[row]
    kept = [array[row].copy() for array in obstacles.table.candidates]
    assert obstacles.table.confirmations[row] == 1
    names = [f"n{i}" for i in range(300)]
    obstacles.update(names, 1.0, np.zeros((300, 8, 3)), radius=0.1)
    for before, after in zip(kept, obstacles.table.candidates, strict=True):
        assert np.array_equal(np.ravel(before), np.ravel(after[row])[: np.size(before)])


def test_ten_thousand_balls_take_little_memory():
    table = ObstacleTable(10_000)
    # Of what was refused, and of the last samples, only what is written takes memory.
    groups = (table.accepted, table.marks, table.changed_rows)
    assert sum(array.nbytes for group in groups for array in group) < 180 * 10_000
    beside = (table.refused_states, table.candidates, table.spreads)
    assert sum(array.nbytes for group in beside for array in group) < 900 * 10_000
