"""Bodies and joint states of messages that `rosbags` makes; all shapes are tested with bags."""

import types

import numpy as np
import pytest

from armguard import Robot
from armguard.bridges import messages
from armguard.bridges.messages import (
    MARKERS,
    PEOPLE,
    POSES,
    JointStateReader,
    ObstacleReader,
    make_batches,
    read_pose,
)
from armguard.exceptions import ArmguardError
from support.bags_made import (
    NAMES,
    READY,
    joint_state,
    marker,
    markers,
    people,
    pose_array,
)


@pytest.fixture(scope="module")
def panda():
    return Robot.load("panda")


def test_people_have_their_names_and_poses_their_places():
    who = people(0.0, [("anna", (1, 2, 3)), ("", (4, 5, 6))])
    _, (shown,) = ObstacleReader("/people", PEOPLE, 0.3).read(who)
    assert [(one.id, one.points.tolist(), one.radius) for one in shown.bodies] == [
        ("anna", [[1, 2, 3]], 0.3),
        ("1", [[4, 5, 6]], 0.3),
    ]
    _, (shown,) = ObstacleReader("/poses", POSES, 0.2).read(pose_array(0.0, [(1, 2, 3)], "eye"))
    assert [one.id for one in shown.bodies] == ["0"]
    assert shown.header.frame_id == "eye"


def test_bodies_of_several_kinds_are_grouped_or_made_alike():
    shown = markers(
        marker(0.0, 1, 1), marker(0.0, 2, 2), marker(0.0, 4, 3, points=[(0, 0, 0), (1, 0, 0)])
    )
    _, (whole,) = ObstacleReader("/things", MARKERS).read(shown)
    batches = make_batches(whole, "camera", 0.5, snapshot=False)
    assert [len(batch.position[0]) for batch in batches] == [1, 2, 8]
    (batch,) = make_batches(whole, "camera", 0.5, snapshot=True)
    assert (batch.source, batch.stamp, batch.frame) == ("camera", 0.5, "world")
    assert batch.position.shape == (3, 8, 3)
    for body, points in zip(whole.bodies, batch.position, strict=True):
        assert {tuple(one) for one in points} == {tuple(one) for one in body.points}
    (empty,) = make_batches(whole._replace(bodies=[]), "camera", 0.5, snapshot=True)
    assert empty.ids == []


def balls(count):
    return [(place, 0, 0) for place in range(count)]


@pytest.mark.parametrize(
    ("other", "one"),
    [
        (marker(0.0, 2, 0, ns="people/1"), marker(0.1, 2, 1, ns="people")),
        (marker(0.0, 2, 0, ns="1"), marker(0.1, 7, 1, points=balls(2))),
        (marker(0.0, 2, 0, ns="1"), marker(0.1, 2, 1, action=2)),
        (marker(0.0, 7, 1, points=balls(1)), marker(0.1, 2, 0, ns="1", action=2)),
    ],
)
def test_a_marker_removes_nothing_of_another(other, one):
    reader = ObstacleReader("/things", MARKERS)
    _, (before,) = reader.read(markers(other))
    gone, after = reader.read(markers(one))
    assert gone == []
    assert not {body.id for body in before.bodies} & {body.id for s in after for body in s.bodies}
    assert reader.read(markers(marker(0.2, 2, action=3)))[0]


def test_a_marker_leaves_nothing_of_its_former_kind():
    reader = ObstacleReader("/things", MARKERS)
    single = marker(0.0, 2, 1, ns="a")
    several = marker(0.0, 7, 1, ns="a", points=balls(2))
    fewer = marker(0.0, 7, 1, ns="a", points=balls(1))
    gone = [reader.read(markers(one))[0] for one in (single, several, fewer, single)]
    assert gone == [[], ["a/1"], ["a/1#1"], ["a/1#0"]]


def test_a_refused_message_of_markers_changes_nothing():
    reader = ObstacleReader("/things", MARKERS)
    reader.read(markers(marker(0.0, 2, 1)))
    with pytest.raises(ArmguardError, match="type 10"):
        reader.read(markers(marker(0.1, 0, action=3), marker(0.1, 10, 2)))
    with pytest.raises(ArmguardError, match="'3' twice"):
        reader.read(markers(marker(0.1, 2, 3), marker(0.1, 2, 3)))
    assert reader.read(markers(marker(0.2, 0, action=3)))[0] == ["1"]


def test_markers_that_are_never_deleted_are_not_remembered_without_end(monkeypatch):
    monkeypatch.setattr(messages, "MOST_BODIES", 3)
    reader = ObstacleReader("/things", MARKERS)
    for number in range(3):
        reader.read(markers(marker(0.0, 2, number)))
    with pytest.raises(ArmguardError, match="4 bodies that were not deleted"):
        reader.read(markers(marker(0.1, 2, 3)))
    # It goes on with those that it knows, and with another for one that has gone.
    reader.read(markers(marker(0.2, 2, 2)))
    gone, (shown,) = reader.read(markers(marker(0.3, 2, 2, action=2), marker(0.3, 2, 3)))
    assert (gone, [body.id for body in shown.bodies]) == (["2"], ["3"])
    # What a snapshot does not show is gone, and forgotten.
    reader = ObstacleReader("/things", MARKERS, snapshot=True)
    for number in range(9):
        reader.read(markers(marker(0.0, 2, number)))
    assert reader.read(markers(marker(1.0, 0, 9, action=3)))[0] == ["8"]


def test_markers_keep_their_stamps_and_a_snapshot_has_the_oldest():
    shown = markers(marker(2.0, 2, 1), marker(1.0, 2, 2, frame="/world"), marker(2.0, 2, 3))
    _, parts = ObstacleReader("/things", MARKERS).read(shown)
    told = {one.header.stamp.sec: [body.id for body in one.bodies] for one in parts}
    start = parts[0].header.stamp.sec
    assert told == {start: ["2"], start + 1: ["1", "3"]}
    _, (whole,) = ObstacleReader("/things", MARKERS, snapshot=True).read(shown)
    assert whole.header.stamp.sec == start
    assert sorted(body.id for body in whole.bodies) == ["1", "2", "3"]
    shown = markers(marker(2.0, 2, 1), marker(2.0, 2, 2, frame="eye"))
    with pytest.raises(ArmguardError, match="several frames"):
        ObstacleReader("/things", MARKERS, snapshot=True).read(shown)


@pytest.mark.parametrize(
    ("kind", "radius", "words"),
    [
        (POSES, None, "poses without sizes"),
        (PEOPLE, None, "poses without sizes"),
        (POSES, -1.0, "radius: is -1"),
        (POSES, float("nan"), "radius: is nan"),
        ("std_msgs/msg/String", 0.1, "'/x'.*String.*PoseArray"),
    ],
)
def test_topics_that_cannot_be_read_are_refused_by_name(kind, radius, words):
    with pytest.raises(ArmguardError, match=words):
        ObstacleReader("/x", kind, radius)


def test_a_quaternion_of_any_length_turns_and_one_of_zeros_does_not():
    place = types.SimpleNamespace(x=1.0, y=2.0, z=3.0)
    for length in (1.0, 7.0):
        turn = types.SimpleNamespace(x=0.0, y=0.0, z=length, w=length)
        rotation, origin = read_pose(place, turn)
        np.testing.assert_allclose(rotation @ [1, 0, 0], [0, 1, 0], atol=1e-15)
        assert origin.tolist() == [1, 2, 3]
    zeros = types.SimpleNamespace(x=0.0, y=0.0, z=0.0, w=0.0)
    assert (read_pose(place, zeros)[0] == np.eye(3)).all()


@pytest.mark.parametrize("wrong", [1e200, 1e-200, np.inf, np.nan])
def test_a_quaternion_without_a_length_gives_no_rotation(wrong):
    place = types.SimpleNamespace(x=1.0, y=2.0, z=3.0)
    turn = types.SimpleNamespace(x=0.0, y=0.0, z=wrong, w=0.0)
    assert np.isnan(read_pose(place, turn)[0]).all()


def test_joints_are_read_by_name(panda):
    reader = JointStateReader("/joint_states", panda)
    names, q = [*reversed(NAMES), "finger"], [*reversed(READY), 9.0]
    found, v = reader.read(joint_state(0.0, names, q), 0.0)
    assert found.tolist() == READY
    assert v.tolist() == [0.0] * 7
    assert reader.read(joint_state(0.0, ["finger"], [1.0]), 0.0) is None
    with pytest.raises(ArmguardError, match="lacks panda_joint7"):
        reader.read(joint_state(0.0, NAMES[:6], READY[:6]), 0.0)
    with pytest.raises(ArmguardError, match="has panda_joint1 twice"):
        reader.read(joint_state(0.0, [*NAMES, NAMES[0]], [*READY, 2.0]), 0.0)
    with pytest.raises(ArmguardError, match="6 values of velocity for 7 joints"):
        reader.read(joint_state(0.0, v=[0.0] * 6), 0.0)


class FineEncoders:
    """A robot as the reader sees it, with encoders good enough for differences."""

    name = "fine"
    joints = ("a", "b")
    position_error = np.array([1e-6, 1e-6])
    velocity_error = np.array([0.05, 0.05])
    acceleration_limit = np.array([10.0, 20.0])
    upper_position_limit = np.array([3.0, np.inf])


def test_empty_velocities_are_differences_within_the_stated_error():
    """Against motions at full acceleration, either way, and encoders as wrong as may be."""
    robot = FineEncoders()
    random = np.random.default_rng(0)
    for period in (0.0003, 0.001, 0.004):
        reader = JointStateReader("/joint_states", robot)
        q, v = np.array([0.1, 3.0]), np.array([0.5, 2.0])
        found = 0
        for k in range(400):
            accel = random.choice([-1.0, 1.0], 2) * robot.acceleration_limit
            q, v = q + v * period + 0.5 * accel * period**2, v + accel * period
            shown = q + random.choice([-1.0, 1.0], 2) * robot.position_error
            shown[1] = (shown[1] + np.pi) % (2 * np.pi) - np.pi  # a continuous joint wraps
            state = reader.read(joint_state(k * period, robot.joints, shown, []), k * period)
            if state is not None:
                found += 1
                assert (np.abs(state[1] - v) <= robot.velocity_error).all()
        assert found > 380


def test_differences_that_would_be_off_by_more_than_is_stated_are_refused(panda):
    with pytest.raises(ArmguardError, match=r"0 values of velocity.*off by up to.*velocity_error"):
        JointStateReader("/joint_states", panda).read(joint_state(0.0, v=[]), 0.0)
    reader = JointStateReader("/joint_states", FineEncoders())
    assert reader.read(joint_state(0.0, ["a", "b"], [0.0, 0.0], []), 0.0) is None
    assert reader.read(joint_state(0.0, ["a", "b"], [0.0, 0.0], []), 0.0) is None
    with pytest.raises(ArmguardError, match="off by up to 1"):  # 20 rad/s² for half of 0.1 s
        reader.read(joint_state(0.1, ["a", "b"], [0.0, 0.0], []), 0.1)


def test_a_clock_that_goes_back_takes_nothing_of_before():
    reader = JointStateReader("/joint_states", FineEncoders())
    for stamp, q in ((10.0, 0.0), (10.001, 0.0)):
        reader.read(joint_state(0.0, ["a", "b"], [q, q], []), stamp)
    found = [
        reader.read(joint_state(0.0, ["a", "b"], [1.0, 1.0], []), 9.9985 + 0.001 * k)
        for k in range(6)
    ]
    assert found[0] is None
    speeds = [state[1] for state in found if state is not None]
    assert speeds
    np.testing.assert_array_equal(speeds, 0.0)
