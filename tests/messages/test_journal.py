import copy
import math

import numpy as np
import pytest

from armguard.exceptions import ArmguardError, ObstacleError, RobotError
from armguard.messages.batch import ObstacleBatch
from armguard.messages.events import FaultsTaken, MalformedCall, Payload, StaticObstacle
from armguard.messages.incoming import RemoveMessage, ResetMessage
from armguard.obstacles import Obstacles
from support.panda_monitor import HOME, STILL, make_monitor
from support.told_journal import Journal


@pytest.fixture
def table():
    obstacles = Obstacles()
    obstacles.journal = Journal()
    return obstacles


def test_a_batch_is_told_as_it_was_read_before_it_is_judged(table):
    position = np.array([[1.0, np.nan, 3.0], [1.0, 2.0, 3.0]])
    table.update(("a", "b"), 2, position, radius=0.1, speed=1.5, source="camera")
    ((name, (batch,), _),) = table.journal.told
    assert name == "note_update"
    assert batch.position.tobytes() == position.tobytes()
    assert batch._replace(position=None) == ObstacleBatch(
        ["a", "b"], 2.0, None, None, 0.1, None, 1.5, 0.0, 0.0, "camera", "world", False
    )


def test_all_calls_are_told_and_malformed_ones_as_what_was_wrong(table):
    table.add_static("post", [0.0, 0.0, 1.0], 0.1)
    table.add_entrance("door", [3.0, 0.0, 1.0], 0.1, 0.5, speed=2.0, accel=9.0)
    table.remove(["post"])
    table.remove(["thing"], 1.0, "camera")
    with pytest.raises(ObstacleError):
        table.update(["x", "x"], 3.0, [[0, 0, 0]] * 2, radius=0.1, source="camera")
    table.take_faults()
    journal = table.journal
    assert journal.kinds() == [
        *(StaticObstacle, StaticObstacle, RemoveMessage, RemoveMessage),
        *(MalformedCall, FaultsTaken),
    ]
    of_application, of_camera = journal.messages(RemoveMessage)
    assert (of_application.ids, of_application.source) == (["post"], "")
    assert math.isnan(of_application.stamp)
    assert of_camera == RemoveMessage(["thing"], 1.0, "camera")
    _, door = journal.messages(StaticObstacle)
    assert (door.id, np.frombuffer(door.position).tolist()) == ("door", [3.0, 0.0, 1.0])
    assert (door.radius, door.speed, door.accel) == pytest.approx((1.1, 2.0, 9.0))
    (call,) = journal.messages(MalformedCall)
    assert (call.source, call.stamp) == ("camera", 3.0)
    assert "twice" in call.problem
    other = Obstacles()
    other.leave_malformed(call.source, call.offender, call.problem, call.stamp)
    assert [fault.kind.value for fault in other.take_faults()] == ["malformed call"]


def test_a_copy_has_no_journal(table):
    assert copy.deepcopy(table).journal is None


def test_arguments_are_told_as_they_came_and_answers_as_they_are():
    _, monitor = make_monitor()
    monitor.journal = Journal()
    strange = {"q": 1}
    first = monitor.step(0.0, strange, None)
    second = monitor.step(0.001, HOME, STILL, 0.002)
    told = monitor.journal.told
    assert [name for name, _, _ in told] == ["note_state", "note_verdict"] * 2
    assert told[0][1][1] is strange
    assert told[0][1] == (0.0, strange, None, 0.0)
    assert told[2][1][3:] == (0.002,)
    assert told[1][1] == (first,)
    assert told[3][1] == (second,)
    assert monitor.ticks == 2


def test_resets_payloads_and_plans_are_told():
    _, monitor = make_monitor(motion="planned")
    monitor.journal = Journal()
    monitor.reset()
    monitor.payload = None
    with pytest.raises(RobotError):
        monitor.payload = -1.0
    answer = monitor.commit("no plan")
    told = [arguments for _, arguments, _ in monitor.journal.told]
    assert monitor.journal.kinds() == [ResetMessage, Payload, "note_plan", "note_plan_verdict"]
    assert told[1:] == [(Payload(payload=monitor.payload),), ("no plan",), (answer,)]


def test_what_cannot_be_asked_is_not_told():
    _, monitor = make_monitor()
    monitor.journal = Journal()
    with pytest.raises(ArmguardError):
        monitor.commit("no plan")
    assert not monitor.journal.told


def test_a_journal_changes_nothing():
    verdicts = []
    for journal in (None, Journal()):
        obstacles, monitor = make_monitor()
        monitor.journal = obstacles.journal = journal
        obstacles.update(["ball"], 0.0, [[1.2, 0.0, 0.5]], radius=0.1)
        verdicts.append([monitor.step(1e-3 * k, HOME, 0.1 * np.sin(STILL + k)) for k in range(20)])
    assert verdicts[0] == verdicts[1]
