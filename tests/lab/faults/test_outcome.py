import numpy as np
import pytest

from armguard.lab.faults.catalogue import Fault
from armguard.lab.faults.listening import Heard, Silence
from armguard.lab.faults.outcome import (
    Detection,
    Outcome,
    find_detection,
    measure_silence,
)
from armguard.lab.faults.truth import Closest
from armguard.verdict import Level, Reason, ReasonKind

GAP = Reason(ReasonKind.JOINT_STATE_GAP, "joint states")
FAULT = Fault("dropout", "camera", "disturb", ("SOURCE_SILENT", "lost:", "silence"))
HEARD = [
    Heard(0.0, Level.CLEAR, ()),
    Heard(1.5, Level.STOP, (GAP, Reason(ReasonKind.SOURCE_SILENT, "camera"))),
]
LINES = [(1.4, "armguard: 12:00:00.000 lost: camera message 3")]
TRUTH = np.zeros((3, 17))
TRUTH[:, 0] = 1.1, 1.3, 1.6
TRUTH[1, 2] = 1.0
GOOD = Outcome(
    FAULT,
    0.5,
    "STOP",
    "source silent",
    0.1,
    0,
    (),
    Closest(0, 0.3, 0.5),
    Closest(1, -0.1, 1.0),
    0,
    0.0,
)


def find(fault=FAULT, begin=1.0, end=2.0, heard=HEARD, lines=LINES, truth=TRUTH):
    return find_detection(fault, begin, end, heard, lines, truth)


def test_the_first_sign_counts_whichever_it_is():
    assert find() == Detection(1.3, "none", "no verdict: the arm brakes")
    without = FAULT._replace(signs=FAULT.signs[:2])
    assert find(without) == Detection(1.4, "CLEAR", "lost: camera message 3")
    assert find(without, lines=[]) == Detection(1.5, "STOP", "source silent: camera")


def test_the_sign_is_quoted_and_not_what_is_weightier_beside_it():
    silent = FAULT._replace(signs=("SOURCE_SILENT",))
    assert find(silent).words == "source silent: camera"
    assert (
        find(FAULT._replace(signs=("JOINT_STATE_GAP",))).words
        == "gap in joint states: joint states"
    )


def test_what_is_no_sign_of_it_or_not_in_its_time_does_not_count():
    assert find(FAULT._replace(signs=("TIME_BACKWARDS", "stamp went back:"))) is None
    assert find(FAULT._replace(signs=())) is None
    assert find(begin=1.7) is None
    assert find(end=1.2) is None


def test_verdicts_that_were_not_heard_are_counted_in_the_time_of_the_fault():
    silences = [
        Silence(-np.inf, 0.5, 0), Silence(1.0, 1.1, 3), Silence(1.9, 2.5, 2), Silence(7.0, 9.0, 9),
    ]  # fmt: skip
    assert measure_silence(silences, 1.0, 3.0) == (5, pytest.approx(0.6))
    assert measure_silence(silences, 2.0, 3.0) == (2, pytest.approx(0.5))
    assert measure_silence(silences, 3.0, 4.0) == (0, 0.0)
    assert measure_silence(silences, 3.0, 8.0) == (0, pytest.approx(1.0)), "the next fault's"


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
        ({"obeying": Closest(0, np.inf, 0.0), "was_tried": False}, ""),
        ({"obeying": Closest(1, -0.01, 0.5), "was_tried": False}, "contact"),
    ],
)
def test_what_is_not_as_it_must_be_has_a_name(changes, problem):
    assert GOOD._replace(**changes).problem == problem


def test_a_row_is_plain_data():
    row = GOOD.describe()
    assert (row["detected_ms"], row["recovered_ms"], row["closest_mm"]) == (500.0, 100.0, 300.0)
    assert GOOD._replace(obeying=Closest(0, np.inf, 0.0)).describe()["closest_mm"] is None
