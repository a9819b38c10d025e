"""What tests of obstacles tell the table, and what always holds of it."""

from __future__ import annotations

import numpy as np


def see(obstacles, stamp, x=0.0, id="a", **fields):
    """One ball on the x axis, at rest unless told otherwise."""
    fields = {"velocity": [[0.0, 0.0, 0.0]], "radius": 0.1, **fields}
    obstacles.update([id], stamp, [[x, 0.0, 0.0]], **fields)
    return obstacles.row(id, fields.get("source", "default"))


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
    aside = table.alive & table.refused & table.refused_finite
    assert np.isfinite(table.refused_points[aside]).all()
    assert np.isfinite(table.refused_velocities[aside]).all()
    assert set(obstacles.refused_rows()) == set(np.flatnonzero(table.refused))
