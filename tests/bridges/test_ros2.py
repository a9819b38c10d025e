"""A monitor behind messages that `rosbags` makes: frames that move, clocks, and what is refused."""

import numpy as np
import pytest

from armguard import Monitor, Obstacles, Robot
from armguard.bridges.messages import MARKERS, POSES
from armguard.bridges.ros2 import (
    AnswerMaker,
    FrameErrors,
    Ros2Cell,
    Transforms,
    describe_verdict,
    read_speed_override,
)
from armguard.exceptions import ArmguardError
from armguard.obstacles import Frame
from armguard.verdict import Level, ReasonKind
from support.bags_made import (
    NAMES,
    READY,
    START,
    STORE,
    header,
    joint_state,
    marker,
    markers,
    pose_array,
    transforms,
)

IDENTITY = np.eye(3), np.zeros(3)


def turn(angle, axis):
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def test_points_go_up_the_tree_of_frames():
    tree = Transforms()
    quarter = turn(np.pi / 2, (0, 0, 1))
    tree.take("eye", "mast", (quarter, np.array([0.0, 0.0, 1.0])), None)
    tree.take("mast", "world", (np.eye(3), np.array([5.0, 0.0, 0.0])), None)
    points, frame, error = tree.lead(np.array([[1.0, 0.0, 0.0]]), "eye", 0.0, {"world"})
    np.testing.assert_allclose(points, [[5.0, 1.0, 1.0]])
    assert (frame, error) == ("world", 0.0)
    assert tree.lead(np.zeros((1, 3)), "eye", 0.0, {"world", "mast"})[1] == "mast"


def test_a_wrist_camera_is_as_wrong_as_is_said():
    """The truth, moved and turned by all that the bounds allow, lies within the error."""
    random = np.random.default_rng(0)
    stated = {
        "wrist": FrameErrors(position=0.002, angle=0.01, speed=0.7, turn_rate=2.0),
        "eye": FrameErrors(position=0.003, angle=0.02),
    }
    worst = 0.0
    for _ in range(300):
        tree = Transforms(stated)
        axes = random.normal(size=(5, 3))
        axes /= np.linalg.norm(axes, axis=1)[:, None]
        told = {
            name: (turn(random.uniform(0, 3), axes[k]), random.normal(size=3))
            for k, name in enumerate(stated)
        }
        away = random.uniform(0.0, 0.05)
        tree.take("wrist", "world", told["wrist"], 1.0)
        tree.take("wrist", "world", told["wrist"], 1.0 - 0.2)  # an older one that comes late
        tree.take("eye", "wrist", told["eye"], None)
        p = random.normal(size=(4, 3))
        found, _, error = tree.lead(p, "eye", 1.0 + random.choice([-1, 1]) * away, {"world"})
        truth = p
        for k, name in enumerate(("eye", "wrist")):
            rotation, origin = told[name]
            bounds, gone = stated[name], away if name == "wrist" else 0.0
            wrong = turn(bounds.angle + bounds.turn_rate * gone, axes[2 + k])
            shift = (bounds.position + bounds.speed * gone) * axes[4]
            truth = truth @ (rotation @ wrong).T + origin + shift
        off = np.linalg.norm(found - truth, axis=1).max()
        assert off <= error
        worst = max(worst, off / error)
    assert worst > 0.5, "the error is not far above what it bounds"


@pytest.mark.parametrize(
    ("prepare", "words"),
    [
        (lambda tree: None, r"'eye'.*not in a tree.*world"),
        (lambda tree: tree.take("eye", "wrist", IDENTITY, None), "no transform of 'wrist'"),
        (lambda tree: tree.take("eye", "world", IDENTITY, 0.0), "moves, and nothing says how fast"),
        (lambda tree: tree.take("eye", "eye", IDENTITY, None), "hangs on itself"),
        (lambda tree: tree.take("eye", "wrist_1", IDENTITY, 9.0), "no transform of 'wrist_1'"),
    ],
)
def test_frames_that_lead_nowhere_are_refused_by_name(prepare, words):
    tree = Transforms(
        {"wrist*": FrameErrors(speed=1.0)} if "wrist_1" not in words else {"eye": FrameErrors()}
    )
    prepare(tree)
    with pytest.raises(ArmguardError, match=words):
        tree.lead(np.zeros((1, 3)), "eye", 9.0, {"world"})


def test_old_transforms_and_wrong_errors_are_refused():
    tree = Transforms({"eye": FrameErrors()})
    tree.take("eye", "world", IDENTITY, 0.0)
    with pytest.raises(ArmguardError, match="no transform within 2 s"):
        tree.lead(np.zeros((1, 3)), "eye", 2.0, {"world"})
    for wrong in (-1.0, np.nan, np.inf):
        with pytest.raises(ArmguardError, match=r"'eye'.*speed"):
            Transforms({"eye": FrameErrors(speed=wrong)})


def test_of_a_frame_only_what_was_told_last_of_its_kind_and_parent_counts():
    tree = Transforms({"eye": FrameErrors()})
    told = [("world", None), ("world", 1.0), ("mast", 1.0), ("mast", None), ("world", 1.0)]
    for place, (parent, stamp) in enumerate(told):
        tree.take("eye", parent, (np.eye(3), np.array([place, 0.0, 0.0])), stamp)
        points, goal, _ = tree.lead(np.zeros((1, 3)), "eye", 1.0, {"world", "mast"})
        assert (points[0, 0], goal) == (place, parent)
    with pytest.raises(ArmguardError, match="no transform within"):
        tree.lead(np.zeros((1, 3)), "eye", 9.0, {"world"})


@pytest.fixture(scope="module")
def panda():
    return Robot.load("panda")


def make_cell(panda, kind=POSES, topic="camera=/people", **options):
    table = Obstacles(frames={"tilted": Frame(np.eye(3), [1.0, 0.0, 0.0], 0.01)})
    monitor = Monitor(panda, table, rate=100.0)
    cell = Ros2Cell(monitor, "/joint_states", {topic: kind}, radius=0.1, **options)
    return cell, table


def send(cell, message, topic="/people"):
    """As a node gets it: written to the wire and read again."""
    kind = message.__msgtype__
    cell.take_obstacles(topic, STORE.deserialize_cdr(STORE.serialize_cdr(message, kind), kind))


@pytest.mark.parametrize("start", [START, 10_000_000])
def test_verdicts_on_the_clock_of_the_node(panda, start):
    """That of the system, and that of a simulation, which stands at 0 before it begins."""
    cell, _ = make_cell(panda)
    assert cell.step(0) is None
    offset = (start - START) * 1e-9
    assert cell.step(start) is None
    levels = []
    for k in range(300):
        now = 0.01 * k
        send(cell, pose_array(now + offset, [(4.0 - 1.5 * now, 0.0, 0.5)]))
        cell.take_joints(joint_state(now + offset))
        levels.append(cell.step(start + round(1e9 * now)).level)
    assert levels[0] == Level.CLEAR
    assert levels[-1] == Level.STOP
    assert cell.refused == 0


def test_a_moving_camera_widens_what_it_sees(panda):
    errors = {"eye": FrameErrors(speed=0.5, turn_rate=1.0)}
    cell, table = make_cell(panda, errors=errors)
    cell.take_joints(joint_state(0.0))
    cell.step(START)
    moving = [(0.0, "world", "eye", (2.0, 0.0, 0.0))]
    cell.take_transforms(transforms(*moving), is_static=False)
    send(cell, pose_array(0.1, [(1.0, 0.0, 0.0)], "eye"))
    row = table.row("0", "camera")
    assert table.table.points[row, 0].tolist() == [3.0, 0.0, 0.0]
    accepted = table.table.accepted
    assert accepted.position_error[row] == pytest.approx(0.1 * (0.5 + 1.0 * 1.0))
    send(cell, pose_array(0.1, [(5.0, 0.0, 0.0)], "tilted"))  # of the cell file
    assert cell.refused == 0


def test_a_reading_of_zero_is_no_time(panda):
    """Clocks stand at 0 until `/clock` comes, and a stamp of 0 says nothing."""
    cell, table = make_cell(panda)
    cell.take_joints(joint_state(-START * 1e-9))
    send(cell, pose_array(-START * 1e-9, [(3.0, 0.0, 0.0)]))
    assert cell.refused == 2
    assert not any(table.ids)
    assert cell.step(0) is None
    cell.take_joints(joint_state(0.0))
    assert cell.step(0) is None
    assert cell.step(START + 1).stamp == 0.0


@pytest.mark.parametrize(
    "turn", [(0, 0, 0, 0), (0, 0, 0, 1.01), (0, 0, 1e200, 0), (np.nan, 0, 0, 1)]
)
@pytest.mark.parametrize("is_static", [True, False])
def test_a_transform_that_is_no_rotation_is_refused(panda, turn, is_static):
    cell, table = make_cell(panda, errors={"eye": FrameErrors()})
    cell.step(START)
    message = transforms((0.0, "world", "eye", (2.0, 0.0, 0.0)))
    rotation = message.transforms[0].transform.rotation
    rotation.x, rotation.y, rotation.z, rotation.w = map(float, turn)
    cell.take_transforms(message, is_static=is_static)
    assert cell.refused == 1
    assert "'eye': has a quaternion of length" in cell.last_refusal
    send(cell, pose_array(0.0, [(1.0, 0.0, 0.0)], "eye"))
    assert cell.refused == 2
    assert not any(table.ids)


def test_markers_go_when_they_are_deleted(panda):
    cell, table = make_cell(panda, MARKERS, "/things")
    cell.step(START)
    send(cell, markers(marker(0.0, 2, 1, at=(3, 0, 0)), marker(0.0, 2, 2, at=(4, 0, 0))), "/things")
    send(cell, markers(marker(0.1, 2, 1, action=2)), "/things")
    assert {id for id in table.ids if id} == {"2"}
    assert cell.topics == ["/things"]


def test_nothing_in_a_message_makes_it_raise_and_the_verdict_knows(panda):
    cell, _ = make_cell(panda)
    cell.take_joints(joint_state(0.0, NAMES[:3], READY[:3]))
    assert "lacks panda_joint4" in cell.last_refusal
    assert cell.step(START) is None
    cell.take_joints(joint_state(0.0))
    send(cell, pose_array(0.0, [(1, 2, 3)], "nowhere"))
    assert cell.refused == 2
    assert "nowhere" in cell.last_refusal
    verdict = cell.step(START)
    assert verdict.level is Level.STOP
    assert ReasonKind.CALL_REFUSED in {reason.kind for reason in verdict.reasons}
    send(cell, pose_array(0.0, [(np.nan, 2, 3)]))
    assert cell.step(START + 10_000_000).level is Level.STOP


def test_verdicts_are_diagnostics_and_a_speed(panda):
    cell, _ = make_cell(panda)
    assert describe_verdict(None).level == 2
    assert read_speed_override(None) == 0.0
    cell.step(START)
    cell.take_joints(joint_state(0.0))
    send(cell, pose_array(0.0, [(60.0, 0.0, 0.0)]))
    verdict = cell.step(START)
    for level, told in ((Level.STOP, 2), (Level.SLOW, 1), (Level.AWARE, 0), (Level.CLEAR, 0)):
        found = describe_verdict(verdict._replace(level=level, speed_scale=0.5, run="second"))
        assert found.level == told
        assert found.message.startswith(level.name)
        assert all(isinstance(value, str) for value in found.values.values())
        assert found.values["run"] == "second"
        assert float(found.values["speed_scale"]) == (0.0 if level is Level.STOP else 0.5)
    assert "contact_speed" not in describe_verdict(verdict).values
    limited = verdict._replace(harm_time=0.25, contact_speed=0.21)
    assert describe_verdict(limited).values.items() >= {
        ("harm_time", "0.25"),
        ("contact_speed", "0.21"),
    }
    for wrong in (np.nan, -1.0, 2.0):
        one = verdict._replace(level=Level.CLEAR, speed_scale=wrong)
        assert read_speed_override(one) == 0.0


def test_answers_are_written_and_read_as_ros_does():
    answers = AnswerMaker(STORE.types.__getitem__, int, "panda")
    for made in (
        answers.make_diagnostics(header(0.0).stamp, describe_verdict(None)),
        answers.make_speed(0.25),
    ):
        kind = made.__msgtype__
        read = STORE.deserialize_cdr(STORE.serialize_cdr(made, kind), kind)
        if kind.endswith("Float64"):
            assert read.data == 0.25
        else:
            assert (read.status[0].level, read.status[0].hardware_id) == (2, "panda")
