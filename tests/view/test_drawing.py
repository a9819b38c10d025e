import numpy as np
import pytest

from armguard.view import drawing
from armguard.view.colours import INK, Paints
from armguard.view.drawing import Look
from support.view_samples import read_command


def test_a_key_is_what_a_command_sets():
    paint, pose = Paints.of(INK, 1), np.eye(4)
    keys = [
        drawing.move("/a", pose).key,
        drawing.delete("/a").key,
        drawing.draw_balls("/a", [[0.0, 0.0, 0.0, 0.1]], paint, Look()).key,
        drawing.draw_lines("/a", [[[0, 0, 0], [1, 0, 0]]], paint).key,
        drawing.draw_surface("/a", np.zeros((1, 3, 3)), [1], paint, 1.0).key,
        drawing.draw_triangles("/a", np.zeros((1, 3, 3)), (0.0, 0.5, 1.0)).key,
        drawing.show("banner", {}).key,
        drawing.move("/b", pose).key,
    ]
    assert len(set(keys)) == len(keys)
    assert drawing.move("/a", 2.0 * pose).key == keys[0]


@pytest.mark.parametrize(
    "end", [(0.0, 0.0, 0.5), (0.0, 0.0, -0.5), (0.3, 0.4, 0.0), (1e-9, 0.2, 0.9)]
)
def test_a_rod_goes_from_end_to_end_with_its_radius(end):
    start, end = np.array([0.1, 0.2, 0.3]), np.array([0.1, 0.2, 0.3]) + end
    command = drawing.draw_rods("/a", [[start, end]], [0.05], Paints.of(INK, 1), Look())
    matrix = read_command(command.payload)["matrices"].reshape(4, 4).astype(float)
    # The page's cylinder has the radius 1 about the y axis, from -1/2 to 1/2.
    assert np.allclose(matrix[3, :3] - 0.5 * matrix[1, :3], start)
    assert np.allclose(matrix[3, :3] + 0.5 * matrix[1, :3], end)
    for across in (matrix[0, :3], matrix[2, :3]):
        assert np.linalg.norm(across) == pytest.approx(0.05, rel=1e-6)
        assert across @ matrix[1, :3] == pytest.approx(0.0, abs=1e-8)


def test_a_rod_without_length_has_no_number_that_is_none():
    command = drawing.draw_rods("/a", np.ones((1, 2, 3)), [0.05], Paints.of(INK, 1), Look())
    assert np.isfinite(read_command(command.payload)["matrices"]).all()


def test_nothing_to_draw_is_drawn_as_nothing():
    none = Paints.of(INK, 0)
    balls = read_command(drawing.draw_balls("/a", np.zeros((0, 4)), none, Look()).payload)
    lines = read_command(drawing.draw_lines("/a", np.zeros((0, 2, 3)), none).payload)
    assert balls["matrices"].size == balls["buckets"].size == 0
    assert lines["positions"].size == lines["buckets"].size == 0
