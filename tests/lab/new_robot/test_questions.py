import pytest

from armguard.exceptions import RobotError
from armguard.lab.new_robot.questions import (
    GIVEN,
    KINDS,
    Asker,
    Figure,
    Question,
    match,
    read_amount,
    read_number,
    read_range,
)

JOINTS = ["shoulder", "elbow", "wrist"]
KNOWN = {"shoulder": Figure(1.0, "the model file")}
USUAL = dict.fromkeys(JOINTS, Figure(3.0, "CHOSEN"))
QUESTION = Question("--velocity", KINDS["velocity"], KNOWN, USUAL)


def answer(*given, ask=None, takes_usual=False, question=QUESTION):
    found = Asker(ask, takes_usual=takes_usual).answer(question, JOINTS, given)
    assert list(found) == JOINTS
    return {joint: (one.value, one.source) for joint, one in found.items()}


def test_a_number_is_for_joints_that_lack_one_and_a_name_goes_before_the_urdf():
    known = (1.0, "the model file")
    assert answer("2") == {"shoulder": known, "elbow": (2.0, GIVEN), "wrist": (2.0, GIVEN)}
    assert answer("2", "sh*=4", "wrist=5") == {
        "shoulder": (4.0, GIVEN),
        "elbow": (2.0, GIVEN),
        "wrist": (5.0, GIVEN),
    }


def test_a_number_for_all_leaves_named_joints_alone_wherever_it_stands():
    for given in (("elbow=40", "20"), ("20", "elbow=40")):
        assert answer(*given)["elbow"] == (40.0, GIVEN)
        assert answer(*given)["wrist"] == (20.0, GIVEN)


def test_what_is_usual_is_taken_only_where_that_is_said():
    assert answer(takes_usual=True)["elbow"] == (3.0, "CHOSEN")
    with pytest.raises(RobotError) as caught:
        answer("elbow=2")
    assert str(caught.value) == (
        "--velocity: is missing: the model file has no velocity limits [rad/s or m/s] of wrist; "
        "expected a number for all of them, or JOINT=NUMBER; --yes accepts the default: 3"
    )


def test_where_nothing_is_usual_an_answer_is_needed():
    question = QUESTION._replace(usual={})
    with pytest.raises(RobotError, match="--velocity: is missing"):
        answer(takes_usual=True, question=question)
    answers = iter(["", "elbow=2", "2"])
    found = answer(ask=lambda _: next(answers), question=question)
    assert found["wrist"] == found["elbow"] == (2.0, GIVEN)


def test_a_question_is_put_again_until_its_answer_can_be_used():
    texts, answers = [], iter(["fast", "wrist=7"])

    def ask(text):
        texts.append(text)
        return next(answers)

    found = answer(ask=ask)
    assert (found["elbow"], found["wrist"]) == ((3.0, "CHOSEN"), (7.0, GIVEN))
    assert "elbow, wrist" in texts[0]
    assert "default: 3 (CHOSEN)" in texts[0]
    assert "'fast'" in texts[1]


def test_a_choice_is_given_usual_asked_or_missing():
    assert Asker(None, takes_usual=True).choose("--load", "load", "1", None) == "1"
    assert Asker(None, takes_usual=True).choose("--load", "load", "1", "2") == "2"
    assert Asker(lambda _: " ", takes_usual=False).choose("--load", "load", "1", None) == "1"
    with pytest.raises(RobotError, match="--load: is missing: load; --yes accepts the default: 1"):
        Asker(None, takes_usual=False).choose("--load", "load", "1", None)
    for takes_usual in (True, False):
        with pytest.raises(RobotError, match="--lock: is missing: place; measure it; --yes does"):
            Asker(None, takes_usual=takes_usual).choose("--lock", "place", "0", None, is_guess=True)


@pytest.mark.parametrize(
    ("read", "text"),
    [
        *((read_number, text) for text in ("", "0", "-1", "nan", "inf", "1:2", "one")),
        *((read_amount, text) for text in ("", "-1", "nan", "inf")),
        *((read_range, text) for text in ("", "1", "2:1", "1:1", "nan:1", "0:inf", "a:b")),
    ],
)
def test_what_is_no_such_number_is_refused(read, text):
    with pytest.raises(RobotError, match=r"--option: is "):
        read("--option", text)


def test_a_pattern_fits_some_name():
    assert match("--joints", "*o*", JOINTS) == ["shoulder", "elbow"]
    with pytest.raises(RobotError, match=r"--joints: names 'knee'; expected one of shoulder"):
        match("--joints", "knee", JOINTS)
