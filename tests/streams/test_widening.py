import math

import pytest

from armguard.obstacles import FaultKind
from armguard.streams import StampClock
from support.stream_messages import (
    UNIX,
    World,
    obstacles,
)


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


@pytest.mark.parametrize("error", [-0.1, -math.inf, [math.nan]])
def test_errors_that_make_no_sense_are_not_hidden_by_those_of_arrival(error):
    world = World(stamp_clocks={"cam0": StampClock("arrival", 0.1)}, speed=2.0, accel=10.0)
    world.send(obstacles(position_error=error, speed=math.inf if error == -math.inf else 2.0))
    assert [fault.field for fault in world.obstacles.take_faults()] == ["position_error"]
