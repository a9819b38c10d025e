import copy
import math

import numpy as np
import pytest

from armguard.exceptions import ObstacleError
from armguard.obstacles import Frame, Obstacles, Source
from support.told_journal import Journal


@pytest.fixture
def table():
    obstacles = Obstacles()
    obstacles.journal = Journal()
    return obstacles


def test_a_message_is_told_as_it_was_read_before_it_is_judged(table):
    position = np.array([[1.0, np.nan, 3.0], [1.0, 2.0, 3.0]])
    table.update(("a", "b"), 2, position, radius=0.1, speed=1.5, source="camera")
    ((name, (ids, stamp, samples), named),) = table.journal.told
    assert (name, ids, stamp) == ("note_update", ["a", "b"], 2.0)
    assert samples.points[:, 0].tobytes() == position.tobytes()
    assert samples.speed == 1.5, "one number for all"
    assert named == {
        "has_velocity": False,
        "has_accel": False,
        "has_speed": True,
        "source": "camera",
        "frame": "world",
        "snapshot": False,
    }


def test_all_calls_are_told_and_malformed_ones_as_what_was_wrong(table):
    table.add_static("post", [0.0, 0.0, 1.0], 0.1)
    table.add_entrance("door", [3.0, 0.0, 1.0], 0.1, 0.5, speed=2.0, accel=9.0)
    table.remove(["post"])
    table.remove(["thing"], 1.0, "camera")
    with pytest.raises(ObstacleError):
        table.update(["x", "x"], 3.0, [[0, 0, 0]] * 2, radius=0.1, source="camera")
    table.take_faults()
    assert [name for name, _, _ in table.journal.told] == [
        "note_static",
        "note_entrance",
        "note_removal",
        "note_removal",
        "note_malformed",
        "note_faults_taken",
    ]
    removals = [arguments for name, arguments, _ in table.journal.told if "removal" in name]
    assert removals == [(["post"], None, None), (["thing"], 1.0, "camera")]
    name, points, *numbers = table.journal.told[1][1]
    assert (name, points.tolist()) == ("door", [[3.0, 0.0, 1.0]])
    assert numbers == pytest.approx([1.1, 2.0, 9.0])
    source, offender, problem, stamp = table.journal.told[4][1]
    assert (source, stamp) == ("camera", 3.0)
    assert "twice" in problem
    other = Obstacles()
    other.leave_malformed(source, offender, problem, stamp)
    assert [fault.kind.value for fault in other.take_faults()] == ["malformed call"]


def test_a_copy_has_no_journal(table):
    assert copy.deepcopy(table).journal is None


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


def test_a_table_is_untouched_until_something_is_told_that_moves():
    for touch in (
        lambda table: table.update([], 0.0, source="camera"),
        lambda table: table.update(["a"], 0.0, [[1, 0, 0]], radius=0.1),
        lambda table: table.remove(["a"]),
        lambda table: table.leave_malformed("", "x", "y", math.nan),
    ):
        obstacles = Obstacles(sources=["camera"])
        obstacles.add_static("post", [0.0, 0.0, 1.0], 0.1)
        assert obstacles.is_untouched
        touch(obstacles)
        assert not obstacles.is_untouched


def test_rows_that_were_given_back_are_told_from_those_that_never_were():
    obstacles = Obstacles()
    for name in "abc":
        obstacles.add_static(name, [0.0, 0.0, 3.0], 0.1)
    obstacles.remove(["c"])
    assert obstacles.is_untouched, "the next row is that of a table that never had it"
    obstacles.remove(["b"])
    assert obstacles.is_untouched
    obstacles = Obstacles()
    for name in "abc":
        obstacles.add_static(name, [0.0, 0.0, 3.0], 0.1)
    for name in "bc":
        obstacles.remove([name])
    assert not obstacles.is_untouched, "the next row is another one"
