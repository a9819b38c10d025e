import math

import numpy as np
import pytest

from armguard.exceptions import ObstacleError
from armguard.obstacles import Obstacles
from armguard.obstacles.pattern_bounds import PatternBounds

HAND = ("*_hand", 41.0, 3.5)


def test_without_patterns_one_number_is_for_all():
    bounds = PatternBounds(10.0, 2.0)
    assert bounds.find(["a", "b"]) == (10.0, 2.0)
    assert bounds.find(["a"], 5.0, math.inf) == (5.0, math.inf)


def test_the_first_pattern_that_fits_counts():
    bounds = PatternBounds(10.0, 2.0, [HAND, ("left_*", 1.0, 1.0), ("ball", math.inf, 12.0)])
    ids = ["left_hand", "left_foot", "ball", "Ball", "hand"]
    for _ in range(2):
        accel, speed = bounds.find(ids)
        assert accel.tolist() == [41.0, 1.0, math.inf, 10.0, 10.0]
        assert speed.tolist() == [3.5, 1.0, 12.0, 2.0, 2.0]
    accel, speed = bounds.find(ids, accel=7.0)
    assert accel.tolist() == [41.0, 1.0, math.inf, 7.0, 7.0]
    assert speed.tolist() == [3.5, 1.0, 12.0, 2.0, 2.0]
    assert [array.shape for array in bounds.find([])] == [(0,), (0,)]


def test_a_stream_of_new_ids_fills_no_memory():
    bounds = PatternBounds(10.0, 2.0, [HAND])
    for k in range(100):
        accel, _ = bounds.find([f"{k}-{i}{'_hand' * (i % 2)}" for i in range(100)])
        assert accel.tolist() == [10.0, 41.0] * 50
    assert len(bounds._known) <= 4096


@pytest.mark.parametrize(
    ("patterns", "message"),
    [
        ([("*", -1.0, 1.0)], r"bounds: pattern '\*': accel: is -1.0"),
        ([("*", 1.0, math.nan)], r"bounds: pattern '\*': speed: is nan"),
        ([("*", 2000.0, 1.0)], "accel: is 2000.0; expected at most 1000"),
        ([("*", "fast", 1.0)], "accel: is 'fast'"),
        ([("*", 1.0)], "bounds: is .*a list of"),
        ([("", 1.0, 1.0)], "bounds: has pattern ''"),
        ([(3, 1.0, 1.0)], "bounds: has pattern 3"),
        (7, "bounds: is 7"),
    ],
)
def test_malformed_patterns_are_refused_by_name(patterns, message):
    with pytest.raises(ObstacleError, match=message):
        Obstacles(bounds=patterns)


def test_messages_go_before_patterns_and_patterns_before_the_rest():
    obstacles = Obstacles(accel=10.0, speed=2.0, bounds=[HAND])
    table = obstacles.table
    ids, position = ["left_hand", "box"], np.zeros((2, 3))
    obstacles.update(ids, 0.0, position, radius=0.1)
    rows = [obstacles.row(id) for id in ids]
    assert table.accel[rows].tolist() == [41.0, 10.0]
    assert table.speed[rows].tolist() == [3.5, 2.0]
    # A velocity that is not known may be anything that the speed allows.
    assert table.velocity_error[rows].tolist() == [3.5, 2.0]
    obstacles.update(ids, 0.1, position, radius=0.1, accel=5.0)
    assert table.accel[rows].tolist() == [5.0, 5.0]
    assert table.speed[rows].tolist() == [3.5, 2.0]
    assert not obstacles.take_faults()


def test_a_hand_may_do_what_a_box_may_not():
    for id, is_taken in (("left_hand", True), ("box", False)):
        obstacles = Obstacles(bounds=[HAND])
        obstacles.update([id], 0.0, [[0.0, 0.0, 0.0]], [[0.0, 0.0, 0.0]], radius=0.1)
        # 30 m/s² for a tenth of a second.
        obstacles.update([id], 0.1, [[0.15, 0.0, 0.0]], [[3.0, 0.0, 0.0]], radius=0.1)
        assert bool(obstacles.take_faults()) != is_taken
        assert len(obstacles.refused_rows()) == (0 if is_taken else 1)
