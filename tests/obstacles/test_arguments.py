from __future__ import annotations

import math

import numpy as np
import pytest

from armguard.exceptions import ObstacleError
from armguard.obstacles import FaultKind, Obstacles
from support.obstacle_samples import kinds

INF = math.inf


def test_unknown_velocity_is_zero_with_an_error_of_the_speed_bound():
    obstacles = Obstacles(speed=1.5)
    obstacles.update(["a", "b"], 0.0, np.zeros((2, 3)), radius=0.1)
    obstacles.update(["c"], 0.0, np.zeros((1, 3)), radius=0.1, speed=INF, velocity_error=0.1)
    assert not obstacles.table.velocities.any()
    rows = [obstacles.row(id) for id in "abc"]
    assert obstacles.table.velocity_error[rows].tolist() == [1.5, 1.5, INF]
    assert obstacles.table.has_state[rows].all()


@pytest.mark.parametrize(
    ("change", "offender"),
    [
        ({"ids": "ab"}, "ids"),
        ({"ids": ["a", 3]}, "ids"),
        ({"ids": ["a", "a"]}, "ids"),
        ({"ids": ["a", ""]}, "ids"),
        ({"ids": None}, "ids"),
        ({"ids": ["a", "\ud800"]}, "ids"),
        ({"ids": ["\ud83d", "\ude00"]}, "ids"),
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
