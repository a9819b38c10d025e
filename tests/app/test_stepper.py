import pytest

from armguard.verdict import ReasonKind
from support.manual_clock import ManualClock
from support.scripted_loop import CELL, NAMES, READY, Script, ball, joints, make_loop

PLANNED = CELL.replace("[sources.camera]", '[monitor]\nmotion = "planned"\n[sources.camera]')


def plan(stamp, number=1, **changes):
    """To stay for half a second; joints in another order than the robot's."""
    rest = {"times": [0.0, 0.5], "q": [READY[::-1]] * 2, "v": [[0.0] * 7] * 2}
    message = {"type": "plan", "ask": "commit", "number": number, "stamp": stamp}
    return {**message, "names": NAMES[::-1], **rest, "tracking_error": 0.01, **changes}


def ask(*messages, text=PLANNED):
    """Answers to what comes with the second joint state of an arm at rest, far from a ball."""
    answers, verdicts = [], []
    ticks = [
        [joints(0.001), ball(0.001)],
        [joints(0.002), ball(0.002), *messages],
        [joints(0.003), ball(0.003)],
    ]
    loop = make_loop(Script(*ticks), ManualClock(0.001), verdicts.append, text, answers)
    for _ in ticks:
        loop.tick()
        loop.clock.sleep_until(loop.clock.now() + 0.001)
    return answers, verdicts, loop


def test_a_plan_is_answered_by_its_number():
    answers, verdicts, loop = ask(plan(0.002, 7))
    ((number, answer),) = answers
    assert (number, answer.safe, answer.reasons) == (7, True, ())
    assert loop.report().faults == {}
    assert not any(ReasonKind.PLAN_VOID in {r.kind for r in v.reasons} for v in verdicts)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"q": [READY] * 2}, "panda_joint"),
        ({"names": NAMES[:6]}, "panda_joint7"),
        ({"q": [READY]}, "2 rows of 7"),
        ({"tracking_error": [0.01] * 6}, "6 values"),
        ({"tracking_error": 0.0}, "above 0"),
        ({"velocity_tracking_error": -1.0}, "above 0"),
        ({"stamp": 50.0}, "begins in"),
    ],
)
def test_what_is_wrong_with_a_plan_is_its_answer(changes, words):
    ((number, answer),) = ask({**plan(0.002), **changes})[0]
    assert (number, answer.safe, answer.contact_time) == (1, False, 0.0)
    assert words in str(answer.reasons[0])


def test_of_plans_that_come_together_the_newest_is_judged():
    answers = ask(plan(0.002, 1), plan(0.002, 2))[0]
    assert [(number, answer.safe) for number, answer in answers] == [(1, False), (2, True)]
    assert "overtaken" in str(answers[0][1].reasons[0])


def test_a_monitor_without_plans_says_so():
    ((_, answer),) = ask(plan(0.002), text=CELL)[0]
    assert not answer.safe
    assert 'motion = "planned"' in str(answer.reasons[0])


def test_a_plan_before_the_first_joint_state_is_refused():
    answers = []
    loop = make_loop(Script([plan(0.0)]), ManualClock(0.0), len, PLANNED, answers)
    loop.tick()
    assert not answers[0][1].safe
    assert "not known" in str(answers[0][1].reasons[0])


def test_a_goal_is_refused_where_there_is_no_shield():
    goal = {"type": "goal", "number": 7, "until": 0.4, "names": NAMES, "velocity": [0.1] * 7}
    _, verdicts, loop = ask(goal)
    assert loop.report().faults == {"goal refused: goals": 1}
    assert len(verdicts) == 3
