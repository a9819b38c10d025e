import math
import re

import numpy as np
import pytest

from armguard.clock import ManualClock
from armguard.exceptions import ObstacleError
from armguard.obstacles import FaultKind, Obstacles
from armguard.streams import SourceLimits, StampClock
from armguard.streams.cloud_intake import OwnPoints
from armguard.streams.other_arm_intake import OtherArm
from armguard.streams.sequence_watch import SequenceWatch
from armguard.streams.stamp_clocks import HELD_UP
from support.stream_messages import (
    JOINTS,
    MONOTONIC,
    UNIX,
    Messages,
    World,
    joints,
    obstacles,
    pack,
)

# Clouds through the edge


def cloud(**changes):
    message = {"type": "cloud", "source": "cam0", "seq": 1, "stamp": MONOTONIC + 5.0}
    return message | {"origin": [0, 0, 0], "points": [[2.01, 0.01, 0.01]]} | changes


def make_cloud_world(**options):
    """One whose arm is at x < 1 m, at any position."""
    own = OwnPoints(lambda points, q, frame: ~(points[:, 0] < 1.0), 0.01)
    world = World(**({"own_points": own} | options))
    world.edge.drain([Messages(joints())])
    return world


def count_voxels(world):
    return sum(name.startswith("voxel ") for name in world.obstacles.ids)


@pytest.mark.parametrize(
    "shown",
    [
        {"points": [[2.01, 0.01, 0.01], [0.5, 0.0, 0.0]]},
        {"points": np.array([[2.01, 0.01, 0.01], [0.5, 0.0, 0.0]]).tobytes()},
        {"points": [[2.01, 0.01, 0.01], [3.0, 0.0, 0.0]], "occupied": [True, False]},
        {"points": [[2.01, 0.01, 0.01], [3.0, 0.0, 0.0]], "occupied": b"\x01\x00"},
    ],
)
def test_a_cloud_becomes_voxels_without_the_arm_and_the_background(shown):
    world = make_cloud_world()
    world.send(cloud(**shown))
    assert world.faults.total == 0
    assert [name for name in world.obstacles.ids if name] == ["voxel 40 0 0"]


def test_the_arm_is_taken_out_by_the_joint_state_that_is_nearest_to_the_cloud():
    seen = []
    own = OwnPoints(lambda points, q, _: seen.append(q[0]) or points[:, 0] > 1.0, 0.002)
    world = World(own_points=own)
    for k in range(10):
        stamp = MONOTONIC + 4.9 + 0.01 * k
        world.edge.drain([Messages(joints(stamp=stamp, q=[0.0, 0.0, 0.1 * k]))])
    world.send(cloud(stamp=MONOTONIC + 4.951))
    assert seen == [pytest.approx(0.5)]
    # Where none is near enough, nothing is taken for the arm.
    world.send(cloud(seq=2, stamp=MONOTONIC + 4.955, points=[[0.51, 0.01, 0.01]]))
    assert len(seen) == 1
    assert "voxel 10 0 0" in world.obstacles.ids
    assert world.kinds() == ["arm not taken out"]


def test_without_a_joint_state_all_points_count():
    world = World(own_points=OwnPoints(lambda points, q, frame: points[:, 0] > 1.0, 1.0))
    world.send(cloud(points=[[0.51, 0.01, 0.01]]))
    assert "voxel 10 0 0" in world.obstacles.ids
    assert world.kinds() == ["arm not taken out"]


@pytest.mark.parametrize(
    ("changes", "options", "kind"),
    [
        ({}, {"own_points": None}, "beyond limit"),
        ({"points": [[2.0, 0, 0]] * 9}, {}, "beyond limit"),
        ({"points": b"123"}, {}, "malformed"),
        ({"points": [[1.0, 2.0]]}, {}, "malformed"),
        ({"origin": [1.0, 2.0]}, {}, "malformed"),
        ({"occupied": [True, True]}, {}, "malformed"),
        ({"occupied": b"\x02"}, {}, "malformed"),
        ({"voxel": 0.0}, {}, "refused"),
        ({"position_error": -1.0}, {}, "refused"),
        ({"frame": "moon"}, {}, "refused"),
    ],
)
def test_a_cloud_that_cannot_be_taken_is_counted_and_known_to_the_verdict(changes, options, kind):
    world = make_cloud_world(**({"limits": {"cam0": SourceLimits(points=8)}} | options))
    world.send(cloud(**changes))
    assert kind in world.kinds()
    assert count_voxels(world) == 0
    # Of a message whose form is wrong nothing is known, its kind included.
    if "origin" not in changes:
        faults = world.obstacles.take_faults()
        assert [(fault.kind, fault.source) for fault in faults] == [(FaultKind.MALFORMED, "cam0")]


def test_a_source_has_no_more_voxels_than_obstacles():
    world = make_cloud_world(limits={"cam0": SourceLimits(obstacles=3)})
    world.send(cloud(points=[[2.0 + k, 0, 0] for k in range(4)]))
    assert world.kinds() == ["beyond limit"]
    assert "has 4 obstacles; expected max_obstacles, 3 at most" in world.lines[0]
    (fault,) = world.obstacles.take_faults()
    assert (fault.kind, fault.source) == (FaultKind.MALFORMED, "cam0")
    assert count_voxels(world) == 0
    world.send(cloud(seq=2, points=[[2.0 + k, 0, 0] for k in range(3)]))
    assert count_voxels(world) == 3
    world.send(cloud(seq=3, points=[[9.0, 0, 0]]))
    assert world.edge.faults.count("beyond limit") == 2
    assert count_voxels(world) == 3


def test_clouds_that_add_no_voxel_are_taken_at_the_limit_and_clear():
    world = make_cloud_world(limits={"cam0": SourceLimits(obstacles=2)})
    across = np.arange(-0.4, 0.4, 0.01).tolist()
    behind = [[4.0, y, z] for y in across for z in across]
    at = [{"points": [[2.01, 0.01, 0.01], [5.0, 3.0, 0.0]]}, {"points": []}]
    at.append({"points": [[5.0, 3.0, 0.0]]})
    at.append({"points": behind, "occupied": [False] * len(behind)})
    stamp = MONOTONIC + 4.9
    for seq, change in enumerate(at[:3]):
        world.send(cloud(seq=seq, stamp=stamp + 0.01 * seq, **change))
        assert count_voxels(world) == 2
    world.send(cloud(seq=3, stamp=stamp + 0.03, **at[3]))
    assert count_voxels(world) == 1
    # What a cloud clears makes room for what it adds.
    world.send(cloud(seq=4, stamp=stamp + 0.04, points=[[2.01, 0.01, 0.01]]))
    seen = [True] + [False] * len(behind)
    world.send(cloud(seq=5, stamp=stamp + 0.05, points=[[3.9, 0.9, 0.0], *behind], occupied=seen))
    assert count_voxels(world) == 2
    assert "beyond limit" not in world.kinds()
    world.send(cloud(seq=6, stamp=stamp + 0.06, points=[[3.0, 2.9, 0.0]], snapshot=True))
    assert count_voxels(world) == 1


def test_a_usual_cloud_fits_the_limits_that_hold_by_default():
    world = make_cloud_world()
    points = np.random.default_rng(0).uniform([1.0, -4.0, -2.0], [9.0, 4.0, 3.0], (20_000, 3))
    world.send(cloud(points=points.tobytes(), voxel=0.05))
    assert world.kinds() == []
    assert count_voxels(world) > 10_000


def test_a_source_without_a_clock_widens_its_cloud():
    clocks = {"cam0": StampClock("monotonic", 0.0, 0.005)}
    world = make_cloud_world(stamp_clocks=clocks, bounds=[("voxel", 10.0, 3.0)])
    world.send(cloud(position_error=0.01))
    row = world.obstacles.row("voxel 40 0 0")
    assert world.obstacles.table.position_error[row] == pytest.approx(0.01 + 3.0 * 0.005)


# Obstacles through the edge


def test_a_good_message_reaches_the_table_in_monitor_time():
    world = World()
    world.send(obstacles(stamp=MONOTONIC + 4.75, frame="camera"))
    table, row = world.obstacles.table, world.obstacles.row("a")
    assert world.stamp() == pytest.approx(4.75, abs=1e-9)
    assert table.accepted.points[row, 0].tolist() == [2.0, 2.0, 3.0]
    assert table.accepted.position_error[row] == pytest.approx(0.01)
    assert world.faults.total == 0
    assert world.lines == []


@pytest.mark.parametrize(("clock", "stamp"), [("monotonic", MONOTONIC + 5.0), ("unix", UNIX + 5.0)])
def test_clocks_and_latencies_of_sources_are_applied(clock, stamp):
    world = World(stamp_clocks={"cam0": StampClock(clock, 0.25)})
    world.send(obstacles(stamp=stamp))
    assert world.stamp() == pytest.approx(4.75, abs=1e-6)


def test_a_source_without_a_clock_is_as_old_and_uncertain_as_it_may_be():
    world = World(stamp_clocks={"cam0": StampClock("arrival", 0.1)}, speed=2.0, accel=10.0)
    world.edge.drain([world.input])
    world.clock.sleep_until(5.05)
    world.send(obstacles(stamp=0.0), obstacles(stamp=0.0, seq=2, speed=[3.0]))
    accepted, row = world.obstacles.table.accepted, world.obstacles.row("a")
    # It arrived at some time since the last drain, and was measured up to 0.1 s before that.
    assert world.stamp() == pytest.approx(4.9, abs=1e-6)
    assert world.stamp() > 4.9 + 1e-9  # the second of two does not look simultaneous
    assert accepted.position_error[row] == pytest.approx(3.0 * 0.15, rel=1e-6)
    assert accepted.velocity_error[row] == pytest.approx(10.0 * 0.15, rel=1e-6)
    assert world.obstacles.take_faults() == []


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


class HeldUpClock(ManualClock):
    """The process is held up after each reading, as long as is written down; then not at all."""

    def __init__(self, *holds):
        super().__init__(5.0)
        self.holds = list(holds)
        self.readings = []

    def now(self):
        reading = super().now()
        self.readings.append(reading)
        if self.holds:
            self.sleep_until(reading + self.holds.pop(0))
        return reading


def make_held_up_world(**options):
    clock = HeldUpClock()
    true_time = lambda: ManualClock.now(clock)  # noqa: E731  # the readings of others take no time
    offsets = {"monotonic": lambda: true_time() + MONOTONIC, "unix": lambda: true_time() + UNIX}
    world = World(clock, **(offsets | options))
    clock.readings.clear()
    return world


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


@pytest.mark.parametrize(("holds", "is_taken"), [([0.008] * 100, False), ([0.008] * 3, True)])
def test_a_joint_state_is_dated_to_microseconds_or_refused(holds, is_taken):
    world = make_held_up_world(joint_clock=StampClock("unix"), drain_time=math.inf)
    world.clock.holds = [0.0, *holds]
    world.send(joints(stamp=UNIX + 4.999))
    if is_taken:
        assert 4.999 - 60e-6 <= world.edge.joints.state.stamp <= 4.999 + 3e-7
        assert world.faults.total == 0
    else:
        assert world.edge.joints.state is None
        assert world.kinds() == ["clocks held up"]
    assert len(world.clock.readings) < 30


def test_what_arrives_during_a_drain_may_be_as_new_as_its_end():
    world = make_held_up_world(stamp_clocks={"cam0": StampClock("arrival")}, speed=2.0, accel=10.0)
    world.clock.holds = [0.008]  # after the drain has read the time, before its first message
    world.send(obstacles(stamp=0.0))
    accepted, row = world.obstacles.table.accepted, world.obstacles.row("a")
    latest = world.stamp() + accepted.position_error[row] / 2.0
    assert latest >= ManualClock.now(world.clock) - 1e-12


def test_a_clock_error_needs_no_speed_bound_where_velocity_and_acceleration_are_known():
    world = World(stamp_clocks={"cam0": StampClock("monotonic", 0.0, 0.1)}, accel=10.0)
    world.send(obstacles(velocity_error=0.1))
    accepted, row = world.obstacles.table.accepted, world.obstacles.row("a")
    assert world.obstacles.take_faults() == []
    assert accepted.position_error[row] == pytest.approx((0.5 + 0.1 + 10.0 * 0.1) * 0.1)


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


def test_unbounded_obstacles_without_a_clock_are_refused():
    world = World(stamp_clocks={"cam0": StampClock("arrival", 0.1)})
    world.send(obstacles())
    assert [fault.kind for fault in world.obstacles.take_faults()] == [FaultKind.NOT_FINITE]


@pytest.mark.parametrize("error", [-0.1, -math.inf, [math.nan]])
def test_errors_that_make_no_sense_are_not_hidden_by_those_of_arrival(error):
    world = World(stamp_clocks={"cam0": StampClock("arrival", 0.1)}, speed=2.0, accel=10.0)
    world.send(obstacles(position_error=error, speed=math.inf if error == -math.inf else 2.0))
    assert [fault.field for fault in world.obstacles.take_faults()] == ["position_error"]


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


@pytest.mark.parametrize(("changes", "kind", "text"), BAD_OBSTACLES)
def test_bad_obstacles_are_named_and_the_verdict_hears_of_them(changes, kind, text):
    world = World()
    world.send(obstacles(seq=17, **changes))
    assert kind in world.kinds()
    line = next(line for line in world.lines if line.startswith(kind))
    assert "cam0 message 17" in line
    assert re.search(text, line)
    assert world.obstacles.take_faults(), "the table must know, so that the verdict is STOP"


@pytest.mark.parametrize("count", [1, 4000])
def test_no_sum_is_shared_out_among_threads_that_the_loop_would_wait_for(count, monkeypatch):
    """OpenBLAS does so beyond 10,000 numbers, and other processes may keep its threads waiting."""
    sizes, compute = [0], np.vdot
    monkeypatch.setattr(np, "vdot", lambda a, b: sizes.append(a.size) or compute(a, b))
    positions = np.full((count, 3), 5.0)
    message = {"ids": [f"b{i}" for i in range(count)], "velocity": ...}
    world = World()
    world.send(obstacles(seq=1, position=positions.tobytes(), **message))
    assert world.faults.total == 0
    positions[-1, 1] = math.nan
    world.send(obstacles(seq=2, position=positions.tobytes(), **message))
    assert any(f"position[{count - 1}, 1] is nan" in line for line in world.lines)
    assert max(sizes) <= 10_000


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


def test_more_sources_than_anybody_has_are_refused():
    world = World()
    for number in range(400):
        world.send(obstacles(source=f"made up {number}", ids=[f"id {number}"], seq=...))
    assert world.faults.count("too many sources") == 144
    assert len(world.obstacles) == 256


# Joints


def test_joint_names_in_any_order_with_extras():
    world = World()
    world.send(joints())
    state = world.edge.joints.state
    assert state.q.tolist() == [1.0, 2.0]
    assert state.v.tolist() == [0.1, 0.2]
    assert state.stamp == pytest.approx(5.0)
    packed = joints(names=JOINTS, q=np.array([3.0, 4.0]).tobytes(), v=[0.0, 0.0])
    world.send(packed)
    assert world.edge.joints.state.q.tolist() == [3.0, 4.0]
    assert world.faults.total == 0


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"names": ["elbow", "gripper", "wrist"]}, "'shoulder' .missing"),
        ({"names": ["elbow", "elbow", "shoulder"]}, "'elbow' .named twice"),
        ({"names": []}, "missing"),
        ({"q": [1.0, 2.0]}, "q is 2 values"),
        ({"v": b"\0" * 9}, "v is 9 bytes"),
    ],
)
def test_joints_that_do_not_fit_are_refused_by_name(changes, text):
    world = World()
    world.send(joints(seq=3, **changes))
    assert world.edge.joints.state is None
    assert world.kinds() == ["malformed"]
    assert "joints message 3" in world.lines[0]
    assert re.search(text, world.lines[0])


def test_an_impossible_joint_state_is_not_hidden_by_a_good_one_after_it():
    world = World()
    good = [joints(stamp=MONOTONIC + later) for later in (5.001, 5.0015)]
    world.send(joints(q=[math.nan, 0.0, 1.0]), *good)
    assert math.isnan(world.edge.joints.state.q[1])
    assert world.kinds() == ["not finite"]
    world.send(joints(stamp=MONOTONIC + 5.002))
    assert world.edge.joints.state.q.tolist() == [1.0, 2.0]


def test_joint_stamps_that_go_back_are_told():
    world = World()
    world.send(joints(), joints(stamp=MONOTONIC + 4.0))
    assert world.kinds() == ["stamp went back"]


def test_a_backlog_at_the_start_is_dropped_and_counted():
    world = World(joint_timeout=0.05)
    old = [joints(stamp=MONOTONIC + 5.0 - age, seq=n) for n, age in enumerate([8.0, 0.2, 0.051])]
    world.send(*old)
    assert world.edge.joints.state is None
    assert world.edge.joints.dropped_age == pytest.approx(0.051)
    assert world.faults.count("backlog") == 3
    assert "joints message 0: joint state is 8 s old, expected at most 0.05 s" in world.lines[0]
    # Obstacles of a backlog are states of some time ago, and go through.
    world.send(obstacles(stamp=MONOTONIC + 1.0))
    assert world.stamp() == pytest.approx(1.0)
    world.send(joints(stamp=MONOTONIC + 4.96, seq=3))
    assert world.edge.joints.state.stamp == pytest.approx(4.96)
    # From here on a state that is old is the monitor's business, whatever it says.
    world.clock.sleep_until(5.5)
    world.send(joints(stamp=MONOTONIC + 4.97, seq=4))
    assert world.edge.joints.state.stamp == pytest.approx(4.97)
    assert world.faults.total == 3


@pytest.mark.parametrize("rate", [1000.0, 500.0, 250.0])
@pytest.mark.parametrize("seconds", [0.055, 0.2, 8.0])
def test_the_first_joint_states_after_a_backlog_leave_no_gap(rate, seconds):
    """The first that is taken is fresh, and none after it is a gap: both would latch."""
    world = World(joint_timeout=0.05)
    waiting, number = int(seconds * rate), 0
    taken = []
    for tick in range(400):
        now = 5.0 + 0.001 * tick
        world.clock.sleep_until(now)
        while number / rate <= seconds + 0.001 * tick:
            stamp = MONOTONIC + 5.0 - seconds + number / rate
            world.input.waiting.append(pack(joints(stamp=stamp, seq=number)))
            number += 1
        before = world.edge.received
        end = world.edge.drain([world.input])
        assert world.edge.received - before <= 64
        if world.edge.joints.state is not None:
            taken.append(world.edge.joints.state.stamp)
            assert end - taken[-1] <= 0.05
    assert len(taken) > 100
    assert np.diff(taken).max() <= 0.05
    # Those that were sent while the backlog was worked off may have grown old, too.
    assert waiting - 51 <= world.faults.count("backlog") <= waiting + 150


def test_a_state_that_becomes_stale_in_its_drain_is_no_beginning():
    world = make_held_up_world(joint_timeout=0.05, drain_time=math.inf)
    world.clock.holds = [0.0, 0.2]  # between its message and the end of the drain
    world.send(joints(stamp=MONOTONIC + 4.999))
    assert world.edge.joints.state is None
    assert world.kinds() == ["backlog"]
    world.send(joints(stamp=MONOTONIC + 5.2))
    assert world.edge.joints.state.stamp == pytest.approx(5.2)


def test_a_joint_state_at_the_start_whose_time_is_no_number_is_for_the_monitor_to_refuse():
    world = World(joint_timeout=0.05)
    world.send(joints(stamp=math.nan))
    assert math.isnan(world.edge.joints.state.stamp)
    assert world.kinds() == ["not finite"]


# Resets


@pytest.mark.parametrize("age", [0.01, 3.0])
def test_after_a_reset_a_stale_joint_state_is_none(age):
    """The controller may come back after the reset: what it said before would latch again."""
    world = World(joint_timeout=0.05, reset_token="sesame")
    world.send(joints())
    world.clock.sleep_until(5.0 + age)
    world.send({"type": "reset", "token": "sesame"})
    assert world.edge.requests.is_reset
    assert (world.edge.joints.state is None) == (age > 0.05)
    world.edge.requests.is_reset = False
    world.send(joints(stamp=MONOTONIC + 5.0 + age))
    assert world.edge.joints.state.stamp == pytest.approx(5.0 + age)
    assert world.faults.total == 0


def test_a_reset_needs_the_token_of_the_run():
    closed, opened = World(), World(reset_token="sesame")
    for world in (closed, opened):
        world.send({"type": "reset", "token": "open"}, {"type": "reset", "token": ""})
        assert not world.edge.requests.is_reset
        assert world.faults.count("reset refused") == 2
    closed.send({"type": "reset", "token": "sesame"})
    opened.send({"type": "reset", "token": "sesame"})
    assert not closed.edge.requests.is_reset
    assert opened.edge.requests.is_reset


# Inputs


def test_work_in_one_drain_is_bounded_and_nothing_is_lost():
    world = World()
    world.input.waiting += [pack(obstacles(seq=n)) for n in range(1000)]
    world.edge.drain([world.input])
    assert 0 < world.edge.received < 200
    for _ in range(100):
        world.edge.drain([world.input])
    assert world.edge.received == 1000
    assert world.faults.total == 0


class SlowMessages(Messages):
    """Messages each of which takes 1 ms."""

    def __init__(self, clock, *messages):
        super().__init__(*messages)
        self._clock = clock

    def receive(self):
        self._clock.sleep_until(self._clock.now() + 0.001)
        return super().receive()


def test_a_drain_ends_when_its_time_is_over_and_each_input_has_its_part():
    world = World(drain_time=0.006)
    balls = SlowMessages(world.clock, *(obstacles(seq=n) for n in range(20)))
    states = SlowMessages(
        world.clock, *(joints(stamp=MONOTONIC + 5.0 + n, seq=n) for n in range(20))
    )
    for drains in range(1, 5):
        before = world.clock.now()
        assert world.edge.drain([balls, states]) - before <= 0.006 + 2 * 0.001
        assert world.edge.cut_short == 2 * drains
        # Half of the time is for each, and the first does not take that of the second.
        for source in (balls, states):
            assert 20 - 4 * drains <= len(source.waiting) <= 20 - 3 * drains
    while balls.waiting or states.waiting:
        world.edge.drain([balls, states])
    assert world.edge.received == 40
    assert world.faults.total == 0


def test_without_any_time_one_message_of_each_input_is_taken():
    world = World(drain_time=0.0)
    sources = [Messages(obstacles(seq=1), obstacles(seq=2)), Messages(joints(), joints())]
    world.edge.drain(sources)
    assert [len(source.waiting) for source in sources] == [1, 1]


# Verdicts


def test_the_table_raises_on_malformed_calls_as_the_edge_relies_on():
    with pytest.raises(ObstacleError):
        Obstacles().update(["a"], 0.0, b"\0" * 25, radius=0.1)


def follow(*numbers):
    watch = SequenceWatch()
    return [(kind, times) for n in numbers for kind, times, _ in watch.follow(n)]


def test_numbers_in_order_or_absent_are_no_fault():
    assert follow(5, 6, 7, None, 8) == []


def test_lost_messages_are_counted():
    assert follow(1, 2, 5, 6, 10) == [("lost", 2), ("lost", 3)]
    world = World()
    for number in (1, 2, 7):
        world.send(obstacles(seq=number))
    assert world.faults.count("lost") == 4


def test_a_restarted_publisher_is_one_fault():

    assert follow(70, 71, 1, 2, 3) == [("sequence went back", 1)]


@pytest.mark.parametrize("numbers", [(50, 3, 51, 4, 52, 5), (1, 1, 2, 2, 3, 3, 4, 4)])
def test_two_publishers_of_one_source_are_told(numbers):
    faults = follow(*numbers)
    assert ("two publishers", 1) in faults
    assert ("lost", 46) not in faults


def test_huge_numbers_do_no_harm():
    assert follow(-(2**63), 2**63 - 1) == [("lost", 2**64 - 2)]


ZONE = [[x, y, z] for x in (0.4, 0.8) for y in (-0.2, 0.2) for z in (0.0, 0.5)]


def test_contact_that_is_wanted_needs_the_token_and_its_end_does_not():
    world = World(reset_token="sesame")
    asked = {"type": "ignore", "number": 7, "token": "sesame", "link": "hand", "ids": "part*"}
    world.send(
        {**asked, "until": MONOTONIC + 9.0, "source": "eye"},
        {**asked, "number": 8, "zone": ZONE},
        {**asked, "number": 9, "zone": np.array(ZONE).tobytes()},
        {"type": "watch", "number": 7},
    )
    until, listed, packed, end = world.edge.requests.exemptions
    assert until[:5] == (7, False, "hand", "part*", "eye")
    # Never later than was meant.
    assert 9.0 - 1e-9 <= until.until <= 9.0
    assert until.zone is None
    for one in (listed, packed):
        assert one.until is None
        assert np.array_equal(one.zone, ZONE)
    assert (end.number, end.is_end) == (7, True)
    world.send({**asked, "token": "open", "until": 9.0}, {**asked, "zone": [[1.0, 2.0]]})
    assert world.edge.requests.exemptions == []
    assert world.faults.count("ignore refused") == 1
    assert world.faults.count("malformed") == 1
    closed = World()
    closed.send({**asked, "until": 9.0})
    assert closed.edge.requests.exemptions == []
    assert closed.faults.count("ignore refused") == 1


def test_contact_is_not_wanted_for_longer_because_clocks_differ():
    clock = StampClock("monotonic", 0.5, 0.02)
    world = World(reset_token="sesame", joint_clock=clock)
    asked = {"type": "ignore", "number": 7, "token": "sesame", "link": "hand", "ids": "part*"}
    world.send({**asked, "until": MONOTONIC + 9.0})
    assert 8.98 - 1e-9 <= world.edge.requests.exemptions[0].until <= 8.98


def test_a_reset_ends_what_was_asked_for_a_time_before_it_in_the_same_drain():
    world = World(reset_token="sesame")
    asked = {"type": "ignore", "token": "sesame", "link": "hand", "ids": "part*"}
    until = {"until": MONOTONIC + 9.0}
    world.send(
        {**asked, **until, "number": 1},
        {**asked, "number": 2, "zone": ZONE},
        {"type": "watch", "number": 7},
        {"type": "reset", "token": "sesame"},
        {**asked, **until, "number": 3},
        {"type": "reset", "token": "guess"},
    )
    assert world.edge.requests.is_reset
    assert [one.number for one in world.edge.requests.exemptions] == [2, 7, 3]


# Joint states of several arms


def two_arms(**options):
    told = []
    other = OtherArm(
        ["base", "tip"], lambda *state: told.append(state), lambda *plan: told.append(plan)
    )
    return World(arm="left", others={"right": other}, **options), told


def test_joint_states_go_to_the_arm_that_they_name():
    world, told = two_arms()
    state = {"names": ["tip", "base"], "q": [0.2, 0.1], "v": [0.4, 0.3]}
    world.send(joints(arm="left"), joints(arm="right", **state))
    assert world.edge.joints.state.q.tolist() == [1.0, 2.0]
    ((stamp, q, v),) = told
    assert stamp == pytest.approx(5.0, abs=1e-6)
    assert stamp <= world.clock.now()
    assert (q.tolist(), v.tolist()) == ([0.1, 0.2], [0.3, 0.4])
    assert world.faults.total == 0


def test_of_several_states_of_another_arm_each_is_told():
    world, told = two_arms()
    names = {"arm": "right", "names": ["base", "tip"], "v": [0.0, 0.0]}
    states = [[0.1, 0.0], [math.nan, 0.0], [0.2, 0.0], [0.3, 0.0]]
    world.send(*(joints(q=q, **names) for q in states))
    nan = pytest.approx(math.nan, nan_ok=True)
    assert [q[0] for _, q, _ in told] == [0.1, nan, 0.2, 0.3]
    assert world.kinds() == ["not finite"]


def other_state(ahead):
    state = {"names": ["base", "tip"], "q": [0.0, 0.0], "v": [0.0, 0.0]}
    return joints(arm="right", stamp=MONOTONIC + 5.0 + ahead, **state)


def test_a_state_of_another_arm_that_is_ahead_by_the_clock_error_counts_as_of_now():
    world, told = two_arms(joint_clock=StampClock("monotonic", 0.0, 0.01))
    world.send(other_state(0.009))
    assert told[0][0] == 5.0
    assert world.kinds() == ["stamp ahead"]
    assert world.obstacles.fault_count == 0


@pytest.mark.parametrize("ahead", [0.011, 3600.0, math.inf])
def test_a_state_of_another_arm_from_the_future_is_none_and_reaches_the_verdict(ahead):
    world, told = two_arms(joint_clock=StampClock("monotonic", 0.0, 0.01))
    world.send(other_state(ahead))
    assert told == []
    assert "stamp ahead" in world.kinds()
    (fault,) = world.obstacles.take_faults()
    assert (fault.kind, fault.source) == (FaultKind.MALFORMED, "right")
    assert f"{ahead:.3g} s ahead" in fault.value


@pytest.mark.parametrize("named", [{}, {"arm": "middle"}])
def test_a_joint_state_of_no_arm_of_the_cell_moves_none(named):
    world, told = two_arms()
    world.send(joints(**named))
    assert world.edge.joints.state is None
    assert not told
    assert world.kinds() == ["malformed"]


def test_a_joint_state_that_names_an_arm_is_refused_where_there_is_one():
    world = World()
    world.send(joints(arm="left"))
    assert world.edge.joints.state is None
    assert world.kinds() == ["malformed"]


def test_a_malformed_state_of_another_arm_and_obstacles_in_its_name_reach_the_verdict():
    world, told = two_arms()
    world.send(joints(arm="right"), obstacles(source="right"))
    assert not told
    assert len(world.obstacles) == 0
    assert [fault.kind for fault in world.obstacles.take_faults()] == [FaultKind.MALFORMED] * 2


def plan(**changes):
    still = [[0.0, 0.0]] * 2
    message = {"type": "plan", "ask": "commit", "number": 3, "stamp": MONOTONIC + 5.0}
    message |= {"names": ["shoulder", "elbow"], "times": [0.0, 1.0], "q": still, "v": still}
    return message | {"tracking_error": 0.01} | changes


def test_plans_and_wanted_contact_go_to_the_arm_that_they_name():
    world, _ = two_arms(reset_token="sesame")
    asked = {"type": "ignore", "token": "sesame", "link": "hand", "ids": "part*", "zone": ZONE}
    for arm, number in (("right", 1), ("left", 2)):
        world.send(plan(arm=arm, number=number), {**asked, "arm": arm, "number": number})
    assert [(one.number, one.problem) for one in world.edge.requests.plans] == [(2, "")]
    assert [one.number for one in world.edge.requests.exemptions] == [2]
    assert world.faults.total == 0


@pytest.mark.parametrize("named", [{}, {"arm": "middle"}])
def test_plans_and_wanted_contact_of_no_arm_of_the_cell_are_refused(named):
    world, _ = two_arms(reset_token="sesame")
    asked = {"type": "ignore", "token": "sesame", "link": "hand", "ids": "part*", "zone": ZONE}
    world.send(plan(**named), {**asked, **named, "number": 2})
    (request,) = world.edge.requests.plans
    assert "arm" in request.problem
    assert world.edge.requests.exemptions == []
    assert world.faults.count("malformed") == 2


def test_a_plan_that_is_shared_goes_to_the_other_arms_and_is_no_question():
    world, told = two_arms(joint_clock=StampClock("monotonic", 0.03, 0.01))
    shared = plan(ask="share", until=MONOTONIC + 5.5, names=["tip", "base"])
    shared |= {"q": [[0.0, 0.1], [0.2, 0.3]], "velocity_tracking_error": [0.4, 0.5]}
    world.send(shared | {"arm": "right"}, shared | {"arm": "left"})
    ((request, until, clock_error),) = told
    assert request.stamp == pytest.approx(5.0, abs=1e-6)
    assert until == pytest.approx(5.5, abs=1e-6)
    assert clock_error == pytest.approx(0.04 + HELD_UP), "joint states may be younger by latency"
    assert request.q.tolist() == [[0.1, 0.0], [0.3, 0.2]]
    assert request.velocity_tracking_error.tolist() == [0.5, 0.4]
    assert world.edge.requests.plans == []
    assert world.faults.total == 0


@pytest.mark.parametrize("named", [{}, {"arm": "middle"}, {"arm": "right", "names": ["tip"]}])
def test_a_plan_that_no_other_arm_can_share_is_counted(named):
    world, told = two_arms()
    world.send(plan(ask="share", until=MONOTONIC + 5.5) | named)
    assert told == []
    assert world.kinds() == ["malformed"]


def test_nothing_is_promised_by_arrival():
    world, told = two_arms(joint_clock=StampClock("arrival", 0.03))
    shared = plan(ask="share", until=MONOTONIC + 5.5, names=["tip", "base"])
    shared |= {"q": [[0.0, 0.1], [0.2, 0.3]], "velocity_tracking_error": [0.4, 0.5]}
    world.send(shared | {"arm": "right"})
    assert told == []
    assert world.kinds() == ["plan refused"]


def test_ends_of_exemptions_and_resets_go_to_the_arm_that_they_name():
    world, _ = two_arms(reset_token="sesame")
    reset = {"type": "reset", "token": "sesame"}
    world.send({"type": "watch", "number": 7, "arm": "right"}, reset | {"arm": "right"})
    assert world.edge.requests.exemptions == []
    assert not world.edge.requests.is_reset
    assert world.faults.total == 0
    world.send({"type": "watch", "number": 8}, reset, reset | {"arm": "middle"})
    assert world.edge.requests.exemptions == []
    assert not world.edge.requests.is_reset
    assert world.faults.count("malformed") == 1
    assert world.faults.count("reset refused") == 2
    world.send({"type": "watch", "number": 9, "arm": "left"}, reset | {"arm": "left"})
    assert [one.number for one in world.edge.requests.exemptions] == [9]
    assert world.edge.requests.is_reset


def test_a_reset_that_names_an_arm_is_refused_where_there_is_one():
    world = World(reset_token="sesame")
    world.send({"type": "reset", "token": "sesame", "arm": "left"})
    assert not world.edge.requests.is_reset
    assert world.faults.count("reset refused") == 1
