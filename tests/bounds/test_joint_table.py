import numpy as np
import pytest

from armguard.bounds.joint_table import make_table, set_span


@pytest.fixture
def table():
    table = make_table(
        np.array([0.0, 1.0]),
        np.array([True, True]),
        np.zeros(2),
        interpolates=True,
        with_velocities=False,
    )
    table.high[:] = [[0.0, 1.0], [2.0, 1.5]]
    table.low[:] = [[0.0, -1.0], [-4.0, -0.5]]
    return table


def test_a_table_without_content_allows_everything():
    table = make_table(
        np.array([0.0, 1.0]),
        np.array([True]),
        np.zeros(1),
        interpolates=True,
        with_velocities=False,
    )
    set_span(table, 0, 0, 1.0)
    assert table.box.span.tolist() == [[np.inf], [-np.inf], [np.inf]]


def test_a_span_is_up_to_the_chord_and_never_inside_its_start(table):
    set_span(table, 0, 1, 0.5)
    assert table.box.span.tolist() == [[1.0, 1.25], [-2.0, -1.0], [2.0, 1.25]]


def test_a_span_without_interpolation_is_the_whole_step(table):
    table = table._replace(interpolates=False)
    set_span(table, 0, 1, 0.5)
    assert table.box.span.tolist() == [[2.0, 1.5], [-4.0, -1.0], [4.0, 1.5]]


def test_a_span_ends_where_displacements_are_clipped(table):
    table.highest[:] = [0.3, 9.0]
    table.lowest[:] = [-9.0, -0.2]
    set_span(table, 0, 1, 1.0)
    assert table.box.span.tolist() == [[0.3, 1.5], [-4.0, -0.2], [4.0, 1.5]]
