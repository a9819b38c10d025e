import numpy as np
import pytest

from armguard.exceptions import ArmguardError, RobotError
from support.panda_monitor import HOME, STILL, make_monitor
from support.told_journal import Journal


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
    told = [(name, arguments) for name, arguments, _ in monitor.journal.told]
    assert told[0] == ("note_reset", ())
    assert told[1] == ("note_payload", (monitor.payload,))
    assert told[2] == ("note_plan", ("no plan",))
    assert told[3] == ("note_plan_verdict", (answer,))


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
