import numpy as np
import pytest

from armguard.lab.faults.catalogue import Fault
from armguard.lab.faults.listening import VerdictChange
from armguard.lab.faults.outcome import Detection, Outcome, find_detection
from armguard.lab.faults.truth import Closest
from armguard.verdict import Level, Reason, ReasonKind

GAP = Reason(ReasonKind.JOINT_STATE_GAP, "joint states")
FAULT = Fault("dropout", "camera", "disturb", ("SOURCE_SILENT", "lost:", "silence"))
HEARD = [
    VerdictChange(0.0, Level.CLEAR, ()),
    VerdictChange(1.5, Level.STOP, (GAP, Reason(ReasonKind.SOURCE_SILENT, "camera"))),
]
LINES = [(1.4, "armguard: 12:00:00.000 lost: camera message 3")]
TRUTH = np.zeros((3, 17))
TRUTH[:, 0] = 1.1, 1.3, 1.6
TRUTH[1, 2] = 1.0
GOOD = Outcome(
    FAULT, 0.5, "STOP", "source silent", 0.1, 0, (), Closest(0, 0.3, 0.5), Closest(1, -0.1, 1.0), 0
)


def find(signs=FAULT.signs, begin=1.0, end=2.0, heard=HEARD, lines=LINES, truth=TRUTH):
    return find_detection(FAULT._replace(signs=signs), begin, end, heard, lines, truth)


def test_the_first_sign_counts_whichever_it_is_and_is_quoted():
    assert find() == Detection(1.3, "none", "no verdict: the arm brakes")
    assert find(FAULT.signs[:2]) == Detection(1.4, "CLEAR", "lost: camera message 3")
    # What is weightier beside it is no sign of this fault.
    assert find(FAULT.signs[:2], lines=[]) == Detection(1.5, "STOP", "source silent: camera")
    assert find(("JOINT_STATE_GAP",)).words == "gap in joint states: joint states"


def test_what_is_no_sign_of_it_or_not_in_its_time_does_not_count():
    assert find(("TIME_BACKWARDS", "stamp went back:")) is None
    assert find(()) is None
    assert find(begin=1.7) is None
    assert find(end=1.2) is None


def test_where_it_was_silent_before_the_next_silence_counts():
    truth = np.zeros((6, 17))
    truth[:, 0] = 1.0, 1.1, 1.2, 1.3, 1.4, 1.5
    truth[:2, 2] = truth[4, 2] = 1.0
    assert find(lines=[], heard=HEARD[:1], truth=truth).time == 1.4
    assert find(lines=[], heard=HEARD[:1], truth=truth[:3]).time == 1.0, "if any"


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({}, ""),
        ({"detected": None}, "not detected"),
        ({"recovered": None}, "not recovered"),
        ({"obeying": Closest(1, -0.01, 0.5)}, "contact"),
        ({"ignoring": Closest(0, 0.1, 1.0)}, "the control was not hit"),
        ({"obeying": Closest(0, np.inf, 0.0)}, "the arm never moved"),
        ({"obeying": Closest(0, np.inf, np.nan)}, "the arm never moved"),
        ({"detected": None, "fault": FAULT._replace(signs=())}, ""),
        ({"obeying": Closest(0, np.inf, 0.0), "was_tried": False, "detected": None}, ""),
        ({"obeying": Closest(1, -0.01, 0.5), "was_tried": False}, "contact"),
    ],
)
def test_what_is_not_as_it_must_be_has_a_name(changes, problem):
    assert GOOD._replace(**changes).problem == problem
