import numpy as np
import pytest

from armguard.streams import StampClock
from support.manual_clock import ManualClock
from support.stream_messages import (
    MONOTONIC,
    UNIX,
    HeldUpClock,
    World,
    make_held_up_world,
    obstacles,
    pack,
)


@pytest.mark.parametrize(("clock", "stamp"), [("monotonic", MONOTONIC + 5.0), ("unix", UNIX + 5.0)])
def test_clocks_and_latencies_of_sources_are_applied(clock, stamp):
    world = World(stamp_clocks={"cam0": StampClock(clock, 0.25)})
    world.send(obstacles(stamp=stamp))
    assert world.stamp() == pytest.approx(4.75, abs=1e-6)


def test_a_source_without_a_clock_is_as_old_and_uncertain_as_it_may_be():
    world = World(stamp_clocks={"cam0": StampClock("arrival", 0.1)}, speed=2.0, accel=10.0)
    world.edge.drain([world.input])
    world.clock.sleep_until(5.05)
    first = obstacles(stamp=0.0, speed=[3.0])
    world.send(first, obstacles(stamp=0.0, seq=2), {**first, "ids": ["b"], "seq": 3})
    accepted, row = world.obstacles.table.accepted, world.obstacles.row("a")
    # It arrived at some time since the last drain, and was measured up to 0.1 s before that.
    assert world.stamp() == pytest.approx(4.9, abs=1e-6)
    assert world.stamp() > 4.9 + 1e-9  # the second of two does not look simultaneous
    assert accepted.position_error[row] == pytest.approx(2.0 * 0.15, rel=1e-6)
    assert accepted.position_error[world.obstacles.row("b")] == pytest.approx(0.45, rel=1e-6)
    assert accepted.velocity_error[row] == pytest.approx(10.0 * 0.15, rel=1e-6)
    assert world.obstacles.take_faults() == []


@pytest.mark.hazard("H-03")
@pytest.mark.parametrize("holds", [[0.008] * 100, [0.0, 0.008], [0.001, 0.008, 0.0005], [0.008]])
def test_a_hold_up_between_two_clocks_makes_nothing_newer_and_is_an_error(holds):
    options = {"speed": 2.0, "accel": 10.0}
    world = make_held_up_world(stamp_clocks={"cam0": StampClock("unix")}, **options)
    world.clock.holds = list(holds)
    world.send(obstacles(stamp=UNIX + 4.9))
    accepted, row = world.obstacles.table.accepted, world.obstacles.row("a")
    # Dates near 2^31 s are rounded to a quarter of a microsecond.
    late = 4.9 - world.stamp()
    assert -3e-7 <= late <= 0.008 + 3e-7
    # A body at 2 m/s, where it was at its true stamp, is within what is allowed around the old one.
    assert accepted.position_error[row] >= 2.0 * (late - 3e-7)
    assert accepted.velocity_error[row] >= 10.0 * (late - 3e-7)
    if len(holds) < 100:
        assert accepted.position_error[row] == pytest.approx(0.0, abs=1e-6)
    assert len(world.clock.readings) < 30


def test_the_monitors_clock_is_read_before_and_after_the_other():
    readings = []

    class Told(ManualClock):
        def now(self):
            readings.append("monitor")
            return super().now()

    def read(name, base):
        readings.append(name)
        return base + 5.0

    world = World(
        Told(5.0),
        stamp_clocks={"cam0": StampClock("unix")},
        unix=lambda: read("unix", UNIX),
        monotonic=lambda: read("monotonic", MONOTONIC),
    )
    assert readings == ["monitor", "monotonic", "monitor"]
    world.send(obstacles(stamp=UNIX + 4.9))
    place = readings.index("unix")
    assert readings[place - 1] == readings[place + 1] == "monitor"


@pytest.mark.parametrize("holds", [[0.008], [0.001, 0.0, 0.002]])
def test_a_hold_up_at_the_start_does_not_stay(holds):
    clock = HeldUpClock(*holds)
    true_time = lambda: ManualClock.now(clock)  # noqa: E731  # the readings of others take no time
    edge = World(clock, monotonic=lambda: true_time() + MONOTONIC).edge
    assert edge.times.offset == pytest.approx(MONOTONIC)
    assert edge.times.offset_error == 0.0
    # Where it is held up each time, stamps are too old by no more than it says.
    clock.holds = [0.008] * 100
    edge = World(clock, monotonic=lambda: true_time() + MONOTONIC, speed=2.0, accel=10.0).edge
    assert MONOTONIC <= edge.times.offset - 1e-9 <= MONOTONIC + edge.times.offset_error
    assert edge.times.offset_error == pytest.approx(0.008)


def test_what_arrives_during_a_drain_may_be_as_new_as_its_end():
    world = make_held_up_world(stamp_clocks={"cam0": StampClock("arrival")}, speed=2.0, accel=10.0)
    world.clock.holds = [0.008]  # after the drain has read the time, before its first message
    world.send(obstacles(stamp=0.0))
    accepted, row = world.obstacles.table.accepted, world.obstacles.row("a")
    latest = world.stamp() + accepted.position_error[row] / 2.0
    assert latest >= ManualClock.now(world.clock) - 1e-12


def test_stamps_by_arrival_grow_over_drains_that_were_cut_short():
    world = World(stamp_clocks={"cam0": StampClock("arrival", 0.1)}, speed=2.0, accel=10.0)
    stamps = []
    world.input.waiting += [pack(obstacles(seq=n)) for n in range(200)]
    for tick in range(6):
        world.clock.sleep_until(5.0 + 0.001 * tick)
        world.edge.drain([world.input])
        stamps.append(world.stamp())
    assert world.input.waiting == []
    assert (np.diff(stamps[:4]) > 0).all()
    assert world.obstacles.take_faults() == []


def test_what_a_hold_up_at_the_start_may_have_hidden_widens_obstacles_from_then_on():
    clock = HeldUpClock(*[0.008] * 100)
    true_time = lambda: ManualClock.now(clock)  # noqa: E731  # the readings of others take no time
    options = {"speed": 2.0, "accel": 10.0}
    world = World(clock, monotonic=lambda: true_time() + MONOTONIC, **options)
    clock.holds = []
    world.send(obstacles(stamp=MONOTONIC + 4.9))
    accepted, row = world.obstacles.table.accepted, world.obstacles.row("a")
    late = 4.9 - world.stamp()
    assert 0.0 < late <= 0.008 + 1e-9
    assert accepted.position_error[row] >= 2.0 * (late - 1e-9)
    assert accepted.velocity_error[row] >= 10.0 * (late - 1e-9)
