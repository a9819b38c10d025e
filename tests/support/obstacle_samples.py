"""What tests of obstacles tell the table, and what always holds of it."""

from __future__ import annotations

import numpy as np

from armguard.obstacles.possible_states import list_states
from armguard.obstacles.table import MOST_REFUSED


def see(obstacles, stamp, x=0.0, id="a", **fields):
    """One ball on the x axis, at rest unless told otherwise."""
    fields = {"velocity": [[0.0, 0.0, 0.0]], "radius": 0.1, **fields}
    obstacles.update([id], stamp, [[x, 0.0, 0.0]], **fields)
    return obstacles.row(id, fields.get("source", "default"))


def possible(obstacles, row, now=0.0):
    """States of a row that may be true, each with its place and age."""
    table = obstacles.table
    return list_states(table.accepted, table.refused_states, table.marks, row, now)


def refused(obstacles, row):
    """Where samples of a row were refused that may be true: x of their first point, in order."""
    places = row * MOST_REFUSED + np.arange(obstacles.table.refused_count[row])
    return obstacles.table.refused_states.points[places, 0, 0].tolist()


def kinds(obstacles):
    return [fault.kind for fault in obstacles.take_faults()]


def check_invariants(obstacles):
    table = obstacles.table
    alive = np.flatnonzero(table.alive)
    assert len(obstacles) == len(alive)
    assert len(obstacles.ids) == len(table.alive)
    for row in alive:
        assert obstacles.row(obstacles.ids[row], obstacles.source_of(row)) == row
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
    assert (table.refused == (table.unknown | (table.refused_count > 0))).all()
    assert (table.refused_count <= MOST_REFUSED).all()
    for row in alive:
        for states, place, _ in possible(obstacles, row):
            count = states.point_count[place]
            assert 1 <= count <= 8
            assert np.isfinite(states.points[place, :count]).all()
            assert np.isfinite(states.velocities[place, :count]).all()
            assert 0.0 <= states.radius[place] < np.inf
    assert set(obstacles.refused_rows()) == set(np.flatnonzero(table.refused))
