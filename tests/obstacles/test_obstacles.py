from __future__ import annotations

import contextlib
import copy
import math
import pickle

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armguard.exceptions import ObstacleError
from armguard.messages.batch import ObstacleBatch
from armguard.obstacles import FaultKind, Frame, Obstacles, Source
from support.obstacle_samples import check_invariants, kinds, see

INF = math.inf

# Taking


def test_a_message_fills_its_row():
    obstacles = Obstacles(accel=7.0, speed=3.0)
    obstacles.update(
        ["a", "b"],
        1.5,
        [[1, 2, 3], [4, 5, 6]],
        [[0.1, 0, 0], [0, 0.2, 0]],
        radius=[0.1, 0.2],
        accel=[1.0, INF],
        position_error=0.01,
        velocity_error=[0.0, 0.5],
        source="cam0",
    )
    table, row = obstacles.table, obstacles.row("b")
    assert obstacles.ids[row] == "b"
    assert obstacles.source_of(row) == "cam0"
    assert table.points[row, 0].tolist() == [4, 5, 6]
    assert table.velocities[row, 0].tolist() == [0, 0.2, 0]
    assert (table.point_count[row], table.radius[row], table.stamp[row]) == (1, 0.2, 1.5)
    assert (table.accel[row], table.speed[row]) == (INF, 3.0)
    assert (table.position_error[row], table.velocity_error[row]) == (0.01, 0.5)
    assert table.has_state[row]
    assert not table.refused[row]
    assert not obstacles.take_faults()
    assert obstacles.row("c") == -1
    check_invariants(obstacles)


def test_frames_turn_positions_and_velocities_and_add_their_error():
    turn = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    obstacles = Obstacles(frames={"cam": Frame(turn, [10, 0, 0], 0.02)})
    position, velocity = np.array([[1.0, 2, 3]]), np.array([[1.0, 0, 0]])
    obstacles.update(["a"], 0.0, position, velocity, radius=0.1, position_error=0.01, frame="cam")
    row = obstacles.row("a")
    assert np.allclose(obstacles.table.points[row, 0], [8, 1, 3], atol=1e-12)
    assert np.allclose(obstacles.table.velocities[row, 0], [0, 1, 0], atol=1e-12)
    assert obstacles.table.position_error[row] == pytest.approx(0.03)
    # The caller's arrays are the caller's.
    assert position.tolist() == [[1, 2, 3]]
    assert velocity.tolist() == [[1, 0, 0]]


def test_statics_stand_still_and_belong_to_nobody():
    obstacles = Obstacles()
    obstacles.add_static("table", [1, 2, 3], 0.5)
    obstacles.add_static("wall", np.zeros((8, 3)), 0.0)
    table, row = obstacles.table, obstacles.row("table")
    assert table.static[row]
    assert table.has_state[row]
    bounds = [table.accel, table.speed, table.position_error, table.velocity_error]
    assert all(bound[row] == 0.0 for bound in bounds)
    assert obstacles.source_of(row) == ""
    assert not obstacles.has_sources
    see(obstacles, 1.0, id="table")
    assert kinds(obstacles) == [FaultKind.SHARED_ID]
    assert obstacles.row("table") == obstacles.row("table", "") == row
    assert table.points[obstacles.row("table", "default"), 0].tolist() == [0, 0, 0]
    obstacles.update([], 1.5, snapshot=True)
    assert table.points[row, 0].tolist() == [1, 2, 3]
    obstacles.update([], 2.0, snapshot=True)
    assert obstacles.row("table") == row
    obstacles.remove(["table"])
    obstacles.add_static("table", [0, 0, 0], 0.5)
    for bad in [
        ("table", [0, 0, 0], 1.0),
        ("x", [0, 0, 1500.0], 1.0),
        ("x", [0, 0, math.nan], 1.0),
        ("x", [0, 0, 0], -1.0),
    ]:
        with pytest.raises(ObstacleError):
            obstacles.add_static(*bad)
    with pytest.raises(ObstacleError):
        obstacles.add_static("x", [[0, 0], [1]], 1.0)
    assert obstacles.row("x") == -1


def test_entrances_never_age_and_belong_to_nobody():
    obstacles = Obstacles(accel=9.0, speed=1.5, bounds=[("gate*", 4.0, 3.0)])
    obstacles.add_entrance("door", [[1, 2, 0], [1, 2, 2]], 0.5, 0.2)
    obstacles.add_entrance("gate", [4, 2, 0], 0.25, 0.0)
    obstacles.add_entrance("hatch", [4, 2, 0], 0.0, 0.1, speed=1.0, accel=2.0)
    obstacles.add_static("wall", [9, 9, 0], 0.5)
    table = obstacles.table
    door, gate, hatch = (obstacles.row(id, "") for id in ("door", "gate", "hatch"))
    # Widened by how far it gets until it is found; as fast as it may be, whichever way.
    assert table.radius[door] == pytest.approx(0.5 + 1.5 * 0.2, abs=1e-12)
    assert table.radius[door] >= 0.5 + 1.5 * 0.2
    assert table.radius[gate] == 0.25
    assert table.speed[[door, gate, hatch]].tolist() == [1.5, 3.0, 1.0]
    assert table.velocity_error[[door, gate, hatch]].tolist() == [1.5, 3.0, 1.0]
    assert table.accel[[door, gate, hatch]].tolist() == [9.0, 4.0, 2.0]
    assert not table.velocities[door].any()
    assert obstacles.entrance_rows.tolist() == sorted([door, gate, hatch])
    assert not obstacles.is_entrance(obstacles.row("wall"))
    assert obstacles.is_untouched
    assert not obstacles.has_sources
    obstacles.update([], 5.0, source="camera", snapshot=True)
    see(obstacles, 6.0, id="door")
    assert kinds(obstacles) == [FaultKind.SHARED_ID]
    assert obstacles.row("door", "") == door
    obstacles.remove(["door"])
    assert obstacles.row("door", "") == -1
    obstacles.add_static("door", [1, 2, 0], 0.5)
    assert not obstacles.is_entrance(obstacles.row("door", ""))


@pytest.mark.parametrize(
    ("change", "offender"),
    [
        ({"position": [0, 0, math.nan]}, "door"),
        ({"position": np.zeros((9, 3))}, "position"),
        ({"position": [0, 0]}, "position"),
        ({"radius": -0.1}, "door"),
        ({"radius": math.inf}, "door"),
        ({"detection_time": -0.1}, "detection_time"),
        ({"detection_time": math.nan}, "detection_time"),
        ({"detection_time": "soon"}, "detection_time"),
        ({"detection_time": 60.0}, "door"),
        ({"speed": 0.0}, "door"),
        ({"speed": math.inf}, "door"),
        ({"speed": math.nan}, "speed"),
        ({"speed": 3e8}, "speed"),
        ({"accel": -1.0}, "accel"),
        ({"id": "post"}, "post"),
        ({"id": ""}, "ids"),
    ],
)
def test_entrances_that_make_no_sense_are_refused_by_name(change, offender):
    obstacles = Obstacles()
    obstacles.add_static("post", [3, 0, 0], 0.1)
    given = {"id": "door", "position": [2, 0, 1], "radius": 0.5, "detection_time": 0.1}
    with pytest.raises(ObstacleError, match=offender):
        obstacles.add_entrance(**(given | change))
    assert kinds(obstacles) == [FaultKind.MALFORMED]
    assert obstacles.row("door") == -1


def test_an_entrance_needs_a_bound_on_speed():
    with pytest.raises(ObstacleError, match=r"door.*speed of inf"):
        Obstacles(speed=math.inf).add_entrance("door", [2, 0, 1], 0.5, 0.1)


def test_a_message_that_adds_none_is_taken_whatever_the_limit():
    obstacles, positions = Obstacles(), np.zeros((3, 3))
    batch = ObstacleBatch(
        ["a", "b", "c"], 1.0, positions, None, 0.1, None, None, 0.0, 0.0, "cam0", "world", False
    )
    with pytest.raises(ObstacleError, match="has 3 obstacles; expected max_obstacles, 2 at most"):
        obstacles.take(batch, limit=2)
    assert (len(obstacles), kinds(obstacles)) == (0, [FaultKind.MALFORMED])
    assert obstacles.take(batch)
    assert obstacles.take(batch._replace(stamp=1.1), limit=2)
    jump = batch._replace(stamp=1.2, position=positions + 1.0)
    assert not obstacles.take(jump, limit=2), "it says that samples were refused"


def test_settings_are_those_that_it_was_made_with():
    frame = Frame([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]], [1.0, 2.0, 3.0], 0.01)
    source = Source("camera", timeout=0.5)
    bounds = [("hand*", 20.0, 3.0)]
    settings = Obstacles(
        5.0, 1.5, [source], frames={"tilted": frame}, extent=50.0, bounds=bounds
    ).settings
    assert (settings.accel, settings.speed, settings.extent) == (5.0, 1.5, 50.0)
    assert settings.sources == (source,)
    assert settings.bounds == (("hand*", 20.0, 3.0),)
    assert list(settings.frames) == ["tilted"]
    assert settings.frames["tilted"].rotation.tobytes() == frame.rotation.tobytes()
    assert Obstacles().settings.sources is None
    assert Obstacles(sources=[]).settings.sources == ()


# Removing


def test_removal_outlives_older_messages():
    obstacles = Obstacles()
    row = see(obstacles, 1.0)
    obstacles.remove(["a"], stamp=1.5)
    assert obstacles.row("a") == -1
    assert obstacles.ids[row] == ""
    for stamp in (1.1, 1.2, 1.3, 1.4, 1.45, 1.4999):
        see(obstacles, stamp)
        assert obstacles.row("a") == -1
    assert obstacles.late_count == 6
    assert not obstacles.take_faults()
    see(obstacles, 1.51)
    assert obstacles.row("a") >= 0
    obstacles.remove(["a"])
    see(obstacles, 1.505)
    assert obstacles.row("a") == -1
    assert obstacles.late_count == 7
    check_invariants(obstacles)


@pytest.mark.parametrize("stamp", [None, 1.0])
def test_what_is_told_of_the_moment_of_its_removal_is_there(stamp):
    obstacles = Obstacles()
    see(obstacles, 1.0)
    obstacles.remove(["a"], stamp=stamp)
    row = see(obstacles, 1.0, x=0.5)
    assert row >= 0
    assert obstacles.table.points[row, 0, 0] == 0.5
    assert (obstacles.late_count, obstacles.take_faults()) == (0, [])


def test_ids_belong_to_their_sources():
    obstacles = Obstacles()
    first = see(obstacles, 1.0, x=1.0, source="cam0")
    obstacles.update(["a"], 1.0, [[5.0, 0.0, 0.0]], radius=0.2, source="cam1")
    second = obstacles.row("a", "cam1")
    assert (first, len(obstacles)) == (obstacles.row("a", "cam0"), 2)
    assert second not in (-1, first)
    assert obstacles.table.points[[first, second], 0, 0].tolist() == [1.0, 5.0]
    (fault,) = obstacles.take_faults()
    assert (fault.kind, fault.source, fault.value) == (FaultKind.SHARED_ID, "cam1", "cam0")
    obstacles.remove(["a"], 1.0, source="cam1")
    assert [obstacles.row("a", source) for source in ("cam0", "cam1")] == [first, -1]
    obstacles.update(["a"], 1.1, [[5.0, 0.0, 0.0]], radius=0.2, source="cam1")
    obstacles.update([], 1.2, source="cam0", snapshot=True)
    assert obstacles.row("a", "cam0") == -1
    assert obstacles.row("a", "cam1") >= 0
    see(obstacles, 1.3, source="cam0")
    obstacles.remove(["a"])
    assert len(obstacles) == 0


@pytest.mark.parametrize(
    "bound", [{"speed": 2000.0}, {"accel": 10_000.0}, {"speed": 100.1}, {"extent": math.nan}]
)
def test_bounds_that_no_body_needs_are_refused_unless_there_is_none(bound):
    (name,) = bound
    with pytest.raises(ObstacleError, match=name):
        Obstacles(**bound)
    Obstacles(**{name: math.inf})


def test_removals_that_are_refused():
    obstacles = Obstacles()
    row = see(obstacles, 1.0, source="cam0")
    see(obstacles, 1.0, id="b", source="cam1")
    obstacles.remove(["a"], stamp=0.5)
    obstacles.remove(["a"], source="cam1")
    obstacles.remove(["a"], source="nobody")
    obstacles.remove(["ghost"])
    assert kinds(obstacles) == [
        FaultKind.STALE_REMOVAL,
        FaultKind.UNKNOWN_ID,
        FaultKind.UNKNOWN_ID,
        FaultKind.UNKNOWN_ID,
    ]
    assert obstacles.row("a") == row
    # The removal of what is still under way.
    obstacles.remove(["c"], stamp=2.0, source="cam1")
    obstacles.remove(["c"], stamp=1.5, source="cam1")
    see(obstacles, 1.9, id="c", source="cam1")
    assert obstacles.row("c") == -1


def test_a_snapshot_removes_what_its_source_no_longer_sees():
    obstacles = Obstacles()
    see(obstacles, 1.0, id="other", source="cam1")
    names = ["a", "b", "c"]
    obstacles.update(names, 1.0, np.zeros((3, 3)), radius=0.1, source="cam0")
    obstacles.update(["a"], 1.1, [[0, 0, 0]], radius=0.1, source="cam0")
    assert len(obstacles) == 4
    bad = [[0, 0, 0], [math.nan, 0, 0]]
    obstacles.update(["a", "b"], 1.2, bad, radius=0.1, source="cam0", snapshot=True)
    assert sorted(name for name in obstacles.ids if name) == ["a", "b", "other"]
    # A snapshot that comes late says nothing about what was seen since.
    obstacles.update(["a"], 1.15, [[0, 0, 0]], radius=0.1, source="cam0", snapshot=True)
    see(obstacles, 1.3, id="b", source="cam0")
    obstacles.update([], 1.25, source="cam0", snapshot=True)
    assert sorted(name for name in obstacles.ids if name) == ["b", "other"]
    obstacles.update([], 1.4, source="cam0", snapshot=True)
    assert [name for name in obstacles.ids if name] == ["other"]
    check_invariants(obstacles)


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("bad", [{"velocity": [[7.0, 0.0, 0.0]]}, {"x": math.nan}])
def test_what_was_refused_after_a_removal_or_a_snapshot_is_there(bad, known):
    obstacles = Obstacles()
    if known:
        see(obstacles, 1.0)
    row = see(obstacles, 1.2, **bad)
    kinds(obstacles)
    obstacles.update([], 1.1, snapshot=True)
    obstacles.remove(["a"], stamp=1.1, source="default")
    assert kinds(obstacles) == [FaultKind.STALE_REMOVAL]
    obstacles.remove(["a"], stamp=1.1)
    assert kinds(obstacles) == [FaultKind.STALE_REMOVAL]
    assert obstacles.row("a") == row
    assert obstacles.table.refused[row]
    obstacles.remove(["a"], stamp=1.2, source="default")
    assert obstacles.row("a") == -1
    check_invariants(obstacles)


def test_a_snapshot_is_the_whole_cell_at_its_stamp():
    """What the same source has told of the same moment is over too, if it is not in it."""
    obstacles = Obstacles()
    see(obstacles, 1.0, id="other", source="cam1")
    obstacles.update(["a", "b"], 1.0, np.zeros((2, 3)), radius=0.1, source="cam0")
    obstacles.update(["a"], 1.0, [[0, 0, 0]], radius=0.1, source="cam0", snapshot=True)
    assert sorted(name for name in obstacles.ids if name) == ["a", "other"]
    obstacles.update([], 1.0, source="cam0", snapshot=True)
    assert [name for name in obstacles.ids if name] == ["other"]
    check_invariants(obstacles)


def test_a_removal_stamped_far_ahead_does_not_hide_an_id_for_ever():
    obstacles = Obstacles()
    see(obstacles, 1.0)
    obstacles.remove(["a"], stamp=1e9, source="default")
    assert [name for name, _ in obstacles.ahead_sources(1.0, 0.2)] == ["default"]
    see(obstacles, 1.01)
    assert obstacles.row("a") >= 0


# Sources


@pytest.mark.parametrize("bound", [-1.0, math.nan, "2", None, True])
def test_default_bounds_are_checked(bound):
    with pytest.raises(ObstacleError):
        Obstacles(accel=bound)
    with pytest.raises(ObstacleError):
        Obstacles(speed=bound)


numbers = st.floats(allow_nan=True, allow_infinity=True)
anything = st.one_of(numbers, st.none(), st.text(max_size=2), st.integers())
row_numbers = st.one_of(numbers, st.floats(0.0, 3.0))
names = st.lists(st.sampled_from(["a", "b", "c", "d"]), max_size=4, unique=True)
stamps = st.floats(-10.0, 10.0)


@st.composite
def calls(draw):
    ids = draw(names)
    count = len(ids)
    points = draw(st.integers(1, 2))
    vectors = st.lists(row_numbers, min_size=count * points * 3, max_size=count * points * 3)
    fields = st.one_of(row_numbers, st.lists(row_numbers, min_size=count, max_size=count))
    shape = (count, points, 3)
    return {
        "ids": ids,
        "stamp": draw(stamps),
        "position": np.array(draw(vectors)).reshape(shape),
        "velocity": draw(st.none() | vectors.map(lambda flat: np.array(flat).reshape(shape))),
        "radius": draw(fields),
        "accel": draw(st.none() | fields),
        "speed": draw(st.none() | fields),
        "position_error": draw(fields),
        "velocity_error": draw(fields),
        "source": draw(st.sampled_from(["cam0", "cam1"])),
        "frame": draw(st.sampled_from(["world", "cam"])),
        "snapshot": draw(st.booleans()),
    }


# Laws


@settings(max_examples=150)
@given(
    st.lists(
        st.one_of(
            calls(),
            st.tuples(names, st.none() | stamps, st.none() | st.just("cam0")),
            st.integers(0, 63),
        ),
        max_size=20,
    )
)
def test_well_formed_calls_never_raise_whatever_their_numbers(actions):
    turn = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    obstacles = Obstacles(frames={"cam": Frame(turn, [1, 0, 0], 0.1)})
    members = set()
    for action in actions:
        if isinstance(action, dict):
            obstacles.update(**action)
        elif isinstance(action, tuple):
            obstacles.remove(*action)
        elif obstacles.table.alive[action]:
            obstacles.distrust(action)
        check_invariants(obstacles)
        obstacles.silent_sources(0.0, 0.2)
        obstacles.ahead_sources(0.0, 0.2)
        obstacles.rows_ahead(0.0, 0.2)
        added, removed = obstacles.drain_membership()
        members = (members - set(removed.tolist())) | set(added.tolist())
        assert members == set(np.flatnonzero(obstacles.table.alive).tolist())
        obstacles.take_faults()


@settings(max_examples=300)
@given(st.tuples(*[anything | st.lists(anything, max_size=3)] * 12))
def test_hostile_calls_raise_nothing_but_obstacle_errors(arguments):
    obstacles = Obstacles()
    try:
        obstacles.update(*arguments)
    except ObstacleError:
        assert kinds(obstacles) == [FaultKind.MALFORMED]
    with contextlib.suppress(ObstacleError):
        obstacles.remove(*arguments[:3])
    with contextlib.suppress(ObstacleError):
        obstacles.add_static(*arguments[:3])
    check_invariants(obstacles)


def test_a_frame_is_as_it_was_when_the_table_was_made():
    camera = Frame(np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.0, 2.0]))
    obstacles = Obstacles(frames={"camera": camera})
    camera.rotation, camera.translation = np.zeros((1, 1)), np.asfortranarray(np.ones((3, 2)))
    obstacles.update(["a"], 0.0, [[1.0, 2.0, 3.0]], radius=0.1, frame="camera")
    assert obstacles.table.points[obstacles.row("a"), 0].tolist() == [1.0, -2.0, -1.0]


@pytest.mark.parametrize("clone", [copy.deepcopy, lambda table: pickle.loads(pickle.dumps(table))])
def test_a_copy_is_a_table_of_its_own(clone):
    original = Obstacles()
    see(original, 0.0, 1.0)
    see(original, 0.0, 2.0, "b")
    copied = clone(original)
    for number, table in enumerate((original, copied)):
        see(table, 0.1, 1.0 + 0.01 * number)
        table.update(["box"], 0.1, np.full((1, 8, 3), 4.0), radius=0.1)
        table.update([f"{k}" for k in range(100)], 0.1, np.zeros((100, 3)), radius=0.1)
        assert table.table.points[table.row("a"), 0, 0] == 1.0 + 0.01 * number
        assert not table.take_faults()
        check_invariants(table)
    kinds_of_arrays = [numba.typeof(array) for array in original.table.accepted]
    assert [numba.typeof(array) for array in clone(copied).table.accepted] == kinds_of_arrays
