import numpy as np
import pytest

from armguard.exceptions import ArmguardError
from armguard.obstacles import Frame, Obstacles
from armguard.recording import bags as bags_module
from armguard.recording.bags import BagInputs, BagRun
from armguard.verdict import Level
from support.bags_made import (
    NAMES,
    READY,
    START,
    detections,
    joint_state,
    marker,
    markers,
    pose_array,
    usual,
    write_bag,
)
from support.panda_monitor import make_monitor

TOPICS = ["/joint_states", "camera=/people"]


def run(path, topics=TOPICS, *, settings=None, **options):
    """What a monitor says on a bag, and its table."""
    tilted = Frame([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], [1.0, 0.0, 0.0])
    table = Obstacles(frames={"tilted": tilted})
    obstacles, monitor = make_monitor(obstacles=table, **(settings or {}))
    bag = BagRun(path, monitor, BagInputs(topics, **options))
    return list(bag.ticks()), obstacles, bag


def place(obstacles, id, source):
    """Points and radius of an obstacle."""
    table, row = obstacles.table, obstacles.row(id, source)
    assert row >= 0, f"{id} is not there"
    return table.points[row, : table.point_count[row]], table.radius[row]


@pytest.mark.parametrize("plugin", ["mcap", "sqlite3"])
def test_a_bag_is_led_through_a_monitor(plugin, tmp_path):
    path = write_bag(tmp_path / "bag", usual(), plugin)
    ticks, obstacles, _ = run(path, radius=0.1)
    assert [tick.now for tick in ticks] == pytest.approx([0.01 * k for k in range(20)])
    assert [tick.nanoseconds - START for tick in ticks[:2]] == [2_000_000, 12_000_000]
    assert [tick.recorded.stamp for tick in ticks] == pytest.approx(
        [0.01 * k - 0.002 for k in range(20)]
    )
    assert {tick.recorded.obstacle for tick in ticks} == {"0"}
    assert len({tick.recorded.level for tick in ticks} - {Level.STOP}) >= 1
    points, radius = place(obstacles, "0", "camera")
    assert np.allclose(points, [[3.0 - 0.18, 0.0, 0.5]])
    assert radius == 0.1


def test_a_single_file_is_read_as_well(tmp_path):
    path = write_bag(tmp_path / "bag", usual())
    (file,) = path.glob("*.mcap")
    assert len(run(file, radius=0.1)[0]) == 20


def test_joints_may_come_in_any_order_among_others_and_beside_other_messages(tmp_path):
    order = [3, 0, 1, 6, 5, 4, 2]
    names = ["finger", *(NAMES[k] for k in order)]
    q = [9.0, *(READY[k] for k in order)]
    path = write_bag(
        tmp_path / "bag",
        [
            (0.0, "/joint_states", joint_state(0.0, ["finger"], [1.0])),
            (0.01, "/joint_states", joint_state(0.01, names, q)),
        ],
    )
    ticks, _, _ = run(path, ["/joint_states"])
    assert len(ticks) == 1
    assert "malformed" not in str(ticks[0].recorded.reasons)


SHAPES = {
    "cube": (1, {"scale": (2, 4, 6)}, {"0": (8, 0.0)}),
    "sphere": (2, {"scale": (0.2, 0.4, 0.3)}, {"0": (1, 0.2)}),
    "cylinder": (3, {"scale": (2, 2, 1)}, {"0": (8, 0.0)}),
    "strip": (4, {"scale": (0.2, 0, 0), "points": 3}, {"0#0": (2, 0.1), "0#1": (2, 0.1)}),
    "lines": (5, {"scale": (0.2, 0, 0), "points": 4}, {"0#0": (2, 0.1), "0#1": (2, 0.1)}),
    "cubes": (6, {"scale": (1, 1, 1), "points": 2}, {"0#0": (8, 0.0), "0#1": (8, 0.0)}),
    "spheres": (7, {"scale": (0.2, 0.2, 0.2), "points": 2}, {"0#0": (1, 0.1), "0#1": (1, 0.1)}),
    "points": (8, {"scale": (0.6, 0.8, 0), "points": 1}, {"0#0": (1, 0.5)}),
}


@pytest.mark.parametrize("shape", SHAPES)
def test_markers_become_bodies_that_contain_them(shape, tmp_path):
    kind, changes, expected = SHAPES[shape]
    changes = dict(changes)
    if "points" in changes:
        changes["points"] = [(0.5 * k, 0.0, 1.0) for k in range(changes["points"])]
    half = np.sqrt(0.5)
    one = marker(0.0, kind, at=(3, 0, 0), turn=(0, 0, half, half), **changes)
    path = write_bag(
        tmp_path / "bag",
        [(0.0, "/things", markers(one)), (0.01, "/joint_states", joint_state(0.01))],
    )
    _, obstacles, _ = run(path, ["/joint_states", "/things"])
    for id, (count, radius) in expected.items():
        points, found = place(obstacles, id, "things")
        assert (len(points), found) == (count, pytest.approx(radius))
    points, _ = place(obstacles, next(iter(expected)), "things")
    if count == 8 and shape != "cubes":
        # Turned by a quarter about z: its x lies along the world's y.
        size = np.array(changes["scale"])[[1, 0, 2]]
        assert np.allclose(np.ptp(points, axis=0), size)
        assert np.allclose(points.mean(axis=0), [3, 0, 0])
    if "points" in changes:
        assert np.allclose(points.mean(axis=0)[[0, 2]], [3, 1])
    assert len(obstacles) == len(expected)


def test_a_marker_that_is_deleted_is_gone(tmp_path):
    told = [
        (0.0, "/things", markers(marker(0.0, 2, 1), marker(0.0, 2, 2))),
        (0.1, "/things", markers(marker(0.1, 2, 2, action=2))),
        (0.2, "/joint_states", joint_state(0.2)),
    ]
    _, obstacles, _ = run(write_bag(tmp_path / "bag", told), ["/joint_states", "/things"])
    assert {id for id in obstacles.ids if id} == {"1"}


def test_markers_without_a_body_are_passed_over_and_told(tmp_path):
    shown = markers(marker(0.0, 9), marker(0.0, 0, 1), marker(0.0, 9, 2))
    path = write_bag(
        tmp_path / "bag",
        [(0.0, "/things", shown), (0.01, "/joint_states", joint_state(0.01))],
    )
    _, obstacles, bag = run(path, ["/joint_states", "/things"])
    assert bag.passed_over == {"texts": 2, "arrows": 1}
    assert len(obstacles) == 0


def test_detections_become_boxes_in_their_frame(tmp_path):
    boxes = [("person 7", (1, 0, 1), (0.5, 0.6, 1.8)), ("", (2, 0, 1), (1, 1, 1))]
    path = write_bag(
        tmp_path / "bag",
        [
            (0.0, "/seen", detections(0.0, boxes, "tilted")),
            (0.01, "/joint_states", joint_state(0.01)),
        ],
    )
    _, obstacles, _ = run(path, ["/joint_states", "/seen"])
    points, _ = place(obstacles, "person 7", "seen")
    assert np.allclose(points.mean(axis=0), [1, 1, 1])
    assert np.allclose(np.ptp(points, axis=0), [0.6, 0.5, 1.8])
    assert obstacles.row("1", "seen") >= 0


def test_what_a_snapshot_does_not_show_is_gone(tmp_path):
    seen = [[(3, 0, 0), (4, 0, 0)], [(3, 0, 0)]]
    messages = [(0.1 * k, "/people", pose_array(0.1 * k, one)) for k, one in enumerate(seen)]
    path = write_bag(tmp_path / "bag", [*messages, (0.2, "/joint_states", joint_state(0.2))])
    for snapshot, count in ((False, 2), (True, 1)):
        _, obstacles, _ = run(path, radius=0.1, snapshot=snapshot)
        assert len(obstacles) == count


def test_stamps_of_another_clock_are_refused_unless_the_recordings_count(tmp_path):
    path = write_bag(tmp_path / "bag", [(50.0, "/joint_states", joint_state(0.0))])
    with pytest.raises(ArmguardError, match=r"-50 s from when it was recorded.*--stamps recorded"):
        run(path, ["/joint_states"])
    ticks, _, _ = run(path, ["/joint_states"], stamps="recorded")
    assert [tick.recorded.stamp for tick in ticks] == [0.0]


def with_joints(topic, message):
    return [(0.0, topic, message), (0.01, "/joint_states", joint_state(0.01))]


@pytest.mark.parametrize(
    ("messages", "topics", "words"),
    [
        (usual(2), ["/joint_states", "/persons"], "'/persons': is not there; expected one of: /jo"),
        (usual(2), ["/people"], "poses without sizes"),
        (usual(2), [], "name 0 of joint states"),
        (usual(2), TOPICS, "poses without sizes; give --radius"),
        (
            [(0.0, "/joint_states", joint_state(0.0, NAMES[:6], READY[:6]))],
            ["/joint_states"],
            "lacks panda_joint7",
        ),
        ([(0.0, "/joint_states", joint_state(0.0, ["a"], [1.0]))], ["/joint_states"], "none of"),
        (
            [(0.0, "/joint_states", joint_state(0.0, v=[]))],
            ["/joint_states"],
            "0 values of velocity for 7 joints",
        ),
        (
            with_joints("/seen", detections(0.0, [("a", (1, 1, 1), (1, 1, 1))], "lidar")),
            ["/joint_states", "/seen"],
            "in the frame 'lidar'; expected one of tilted, world",
        ),
        (
            with_joints("/things", markers(marker(0.0, 10))),
            ["/joint_states", "/things"],
            "of type 10, whose extent is not known",
        ),
        (
            with_joints("/clock", joint_state(0.0).header.stamp),
            ["/joint_states", "/clock"],
            "is of type 'builtin_interfaces/msg/Time'",
        ),
    ],
)
def test_what_cannot_be_input_is_told_by_name(messages, topics, words, tmp_path):
    path = write_bag(tmp_path / "bag", messages)
    with pytest.raises(ArmguardError, match=words) as caught:
        run(path, topics)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)


def test_a_file_that_is_no_bag_is_told_by_name(tmp_path):
    for name, content in (("a.mcap", b"nonsense"), ("b.mcap", b""), ("c.db3", b"nonsense")):
        path = tmp_path / name
        path.write_bytes(content)
        with pytest.raises(ArmguardError, match=name) as caught:
            run(path)
        assert "\n" not in str(caught.value)
    for path in (tmp_path, tmp_path / "nothing"):
        with pytest.raises(ArmguardError, match="does not exist"):
            run(path)


def test_a_damaged_bag_is_one_line(tmp_path):
    (file,) = write_bag(tmp_path / "bag", usual()).glob("*.mcap")
    whole, cut = file.read_bytes(), tmp_path / "cut.mcap"
    for length in range(9, len(whole), len(whole) // 12):
        cut.write_bytes(whole[:length])
        with pytest.raises(ArmguardError) as caught:
            run(cut, radius=0.1)
        assert "\n" not in str(caught.value)


def test_without_its_package_it_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setattr(bags_module.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(ArmguardError, match=r"pip install 'armguard\[record\]'"):
        run(tmp_path)


def test_a_radius_is_a_number_of_metres(tmp_path):
    path = write_bag(tmp_path / "bag", usual(3))
    with pytest.raises(ArmguardError, match="radius: is -1"):
        run(path, radius=-1.0)
