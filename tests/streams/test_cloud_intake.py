import numpy as np
import pytest

from armguard.obstacles import FaultKind
from armguard.streams import SourceLimits, StampClock
from armguard.streams.cloud_intake import OwnPoints
from support.stream_messages import (
    MONOTONIC,
    Messages,
    World,
    joints,
)


def cloud(**changes):
    message = {"type": "cloud", "source": "cam0", "seq": 1, "stamp": MONOTONIC + 5.0}
    return message | {"origin": [0, 0, 0], "points": [[2.01, 0.01, 0.01]]} | changes


def make_cloud_world(**options):
    """One whose arm is at x < 1 m, at any position."""
    own = OwnPoints(lambda points, q, frame, origin: ~(points[:, 0] < 1.0), 0.01)
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
    own = OwnPoints(lambda points, q, *_: seen.append(q[0]) or points[:, 0] > 1.0, 0.002)
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
    assert world.kinds() == ["arm not removed"]


def test_without_a_joint_state_all_points_count():
    world = World(own_points=OwnPoints(lambda points, q, *_: points[:, 0] > 1.0, 1.0))
    world.send(cloud(points=[[0.51, 0.01, 0.01]]))
    assert "voxel 10 0 0" in world.obstacles.ids
    assert world.kinds() == ["arm not removed"]


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


@pytest.mark.parametrize(("error", "is_taken_out"), [(0.0, True), (0.004, True), (0.006, False)])
def test_what_a_camera_s_clock_may_be_off_by_counts_to_the_time_between_arm_and_cloud(
    error, is_taken_out
):
    world = make_cloud_world(stamp_clocks={"cam0": StampClock("monotonic", 0.0, error)})
    world.send(cloud(stamp=MONOTONIC + 5.005, points=[[0.51, 0.01, 0.01]]))
    assert ("voxel 10 0 0" in world.obstacles.ids) != is_taken_out
    assert world.kinds() == ([] if is_taken_out else ["arm not removed"])
