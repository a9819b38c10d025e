import math
import re

import numpy as np
import pytest

from armguard.exceptions import ObstacleError
from armguard.obstacles import FaultKind, Obstacles
from armguard.streams import StampClock
from support.stream_messages import (
    MONOTONIC,
    UNIX,
    World,
    obstacles,
)


def test_a_good_message_reaches_the_table_in_monitor_time():
    world = World()
    world.send(obstacles(stamp=MONOTONIC + 4.75, frame="camera"))
    table, row = world.obstacles.table, world.obstacles.row("a")
    assert world.stamp() == pytest.approx(4.75, abs=1e-9)
    assert table.accepted.points[row, 0].tolist() == [2.0, 2.0, 3.0]
    assert table.accepted.position_error[row] == pytest.approx(0.01)
    assert world.faults.total == 0
    assert world.lines == []


def test_heartbeat_snapshot_and_removal():
    world = World()
    world.send(obstacles(ids=["a", "b"], position=[[1, 2, 3], [4, 5, 6]], velocity=...))
    assert len(world.obstacles) == 2
    world.send(obstacles(seq=2, ids=[], position=b"", velocity=..., radius=...))
    assert len(world.obstacles) == 2
    later = MONOTONIC + 5.1
    world.send(obstacles(seq=3, stamp=later, velocity=..., snapshot=True))
    assert len(world.obstacles) == 1
    remove = {"type": "remove", "source": "cam0", "seq": 4, "stamp": later + 0.1, "ids": ["a"]}
    world.send(remove)
    assert len(world.obstacles) == 0
    assert world.faults.total == 0
    assert world.obstacles.take_faults() == []


BAD_OBSTACLES = [
    ({"position": [[1.0, math.nan, 3.0]]}, "not finite", r"position\[0, 1\] is nan"),
    ({"position": np.array([1, np.inf, 3.0]).tobytes()}, "not finite", r"position\[0, 1\] is inf"),
    ({"velocity": [[math.nan, 0.0, 0.0]]}, "not finite", r"velocity\[0, 0\] is nan"),
    ({"radius": math.nan}, "not finite", "radius is nan"),
    ({"radius": [math.inf]}, "not finite", r"radius\[0\] is inf"),
    ({"speed": math.nan}, "not finite", "speed is nan"),
    ({"stamp": math.nan}, "not finite", "stamp is nan"),
    ({"stamp": math.inf}, "not finite", "stamp is inf"),
    ({"frame": "moon"}, "refused", "moon"),
    ({"ids": ["a", "a"], "position": [[1, 2, 3]] * 2, "velocity": ...}, "refused", "'a'"),
    ({"ids": ["a", "b"]}, "malformed", "position is 1 rows"),
    ({"radius": ...}, "refused", "radius"),
    ({"radius": [0.1, 0.2]}, "malformed", "radius is 2 values"),
    ({"position": b"\0" * 25}, "malformed", "25 bytes"),
    ({"velocity": [[[0, 0, 0]] * 2]}, "refused", "velocity"),
    ({"position": [[1, 2]]}, "malformed", r"shape \(1, 2\)"),
]


@pytest.mark.hazard("H-05")
@pytest.mark.parametrize(("changes", "kind", "text"), BAD_OBSTACLES)
def test_bad_obstacles_are_named_and_the_verdict_hears_of_them(changes, kind, text):
    world = World()
    world.send(obstacles(seq=17, **changes))
    assert kind in world.kinds()
    line = next(line for line in world.lines if line.startswith(kind))
    assert "cam0 message 17" in line
    assert re.search(text, line)
    assert world.obstacles.take_faults(), "the table must know, so that the verdict is STOP"


def test_good_rows_beside_a_bad_one_are_taken():
    world = World()
    bad = obstacles(ids=["a", "b"], position=[[1, 2, 3], [math.nan, 5, 6]], velocity=...)
    world.send(bad)
    table = world.obstacles.table
    assert table.has_state[world.obstacles.row("a")]
    assert not table.has_state[world.obstacles.row("b")]


def test_infinite_bounds_say_that_there_is_none():
    world = World()
    world.send(obstacles(accel=math.inf, speed=[math.inf], velocity=...))
    assert world.faults.total == 0


def test_the_table_raises_on_malformed_calls_as_the_edge_relies_on():
    with pytest.raises(ObstacleError):
        Obstacles().update(["a"], 0.0, b"\0" * 25, radius=0.1)


def test_clock_errors_of_sources_widen_what_they_say():
    world = World(stamp_clocks={"cam0": StampClock("unix", 0.25, 0.02)}, speed=2.0, accel=10.0)
    world.send(obstacles(stamp=UNIX + 5.0, position_error=0.01, velocity_error=0.1))
    accepted, row = world.obstacles.table.accepted, world.obstacles.row("a")
    assert world.stamp() == pytest.approx(4.75, abs=1e-6)  # the stamp itself stays
    assert accepted.position_error[row] == pytest.approx(0.01 + 2.0 * 0.02)
    assert accepted.velocity_error[row] == pytest.approx(0.1 + 10.0 * 0.02)
    # It adds to what an arrival does not tell.
    world = World(stamp_clocks={"cam0": StampClock("arrival", 0.1, 0.02)}, speed=2.0, accel=10.0)
    world.edge.drain([world.input])
    world.send(obstacles())
    accepted, row = world.obstacles.table.accepted, world.obstacles.row("a")
    assert accepted.position_error[row] == pytest.approx(2.0 * 0.12, rel=1e-6)


def test_clock_errors_widen_a_hand_by_what_hands_do():
    clocks = {"cam0": StampClock("monotonic", 0.0, 0.02)}
    bounds = [("*_hand", 40.0, 3.0)]
    world = World(bounds=bounds, stamp_clocks=clocks, speed=2.0, accel=10.0)
    position, velocity = [[1.0, 2.0, 3.0]] * 2, [[0.0, 0.0, 0.5]] * 2
    world.send(obstacles(ids=["left_hand", "a"], position=position, velocity=velocity))
    accepted = world.obstacles.table.accepted
    rows = [world.obstacles.row(id) for id in ("left_hand", "a")]
    assert accepted.position_error[rows] == pytest.approx([3.0 * 0.02, 2.0 * 0.02])
    assert accepted.velocity_error[rows] == pytest.approx([40.0 * 0.02, 10.0 * 0.02])
    assert world.obstacles.take_faults() == []


def test_a_clock_error_does_not_hide_a_broken_speed_bound():
    world = World(stamp_clocks={"cam0": StampClock("monotonic", 0.0, 0.1)}, speed=2.0, accel=10.0)
    world.send(obstacles(velocity=[[0.0, 0.0, 2.5]], velocity_error=0.1))
    assert [fault.kind for fault in world.obstacles.take_faults()] == [FaultKind.BEYOND_SPEED]
    table = world.obstacles.table
    assert (table.refused_states.position_error >= 2.6 * 0.1).any()  # as fast as it was measured
    world.send(obstacles(seq=2, velocity=[[math.nan, 0.0, 0.5]]))
    assert "velocity" in [fault.field for fault in world.obstacles.take_faults()]


def test_a_clock_error_needs_no_acceleration_bound():
    world = World(stamp_clocks={"cam0": StampClock("monotonic", 0.0, 0.1)}, speed=2.0)
    world.send(obstacles(velocity_error=0.1))
    accepted, row = world.obstacles.table.accepted, world.obstacles.row("a")
    assert world.obstacles.take_faults() == []
    assert accepted.velocity_error[row] == 0.1


def test_a_clock_error_needs_no_speed_bound_where_velocity_and_acceleration_are_known():
    world = World(stamp_clocks={"cam0": StampClock("monotonic", 0.0, 0.1)}, accel=10.0)
    world.send(obstacles(velocity_error=0.1))
    accepted, row = world.obstacles.table.accepted, world.obstacles.row("a")
    assert world.obstacles.take_faults() == []
    assert accepted.position_error[row] == pytest.approx((0.5 + 0.1 + 10.0 * 0.1) * 0.1)


def test_unbounded_obstacles_without_a_clock_are_refused():
    world = World(stamp_clocks={"cam0": StampClock("arrival", 0.1)})
    world.send(obstacles())
    assert [fault.kind for fault in world.obstacles.take_faults()] == [FaultKind.NOT_FINITE]


def test_a_source_is_told_what_it_has_sent_and_not_what_became_of_it():
    world = World(stamp_clocks={"cam0": StampClock("arrival", 0.1)}, speed=2.0, accel=10.0)
    world.send(obstacles(speed=math.inf, accel=math.inf))
    assert [fault.kind for fault in world.obstacles.take_faults()] == [FaultKind.NOT_FINITE]
    (line,) = world.lines
    assert line.startswith("refused: cam0 message 1: speed has no bound, and stamps may be 0.1 s")
    world.send(obstacles(seq=2, speed=math.inf, accel=math.inf, radius=math.nan))
    assert world.lines[1:] == [
        "not finite: cam0 message 2: radius is nan; expected a finite number"
    ]


@pytest.mark.parametrize("error", [-0.1, -math.inf, [math.nan]])
def test_errors_that_make_no_sense_are_not_hidden_by_those_of_arrival(error):
    world = World(stamp_clocks={"cam0": StampClock("arrival", 0.1)}, speed=2.0, accel=10.0)
    world.send(obstacles(position_error=error, speed=math.inf if error == -math.inf else 2.0))
    assert [fault.field for fault in world.obstacles.take_faults()] == ["position_error"]
