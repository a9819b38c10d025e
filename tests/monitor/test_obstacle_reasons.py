import numpy as np
import pytest

from armguard import Obstacles
from armguard.monitor.obstacle_reasons import take_obstacle_reasons
from armguard.verdict import Effect, ReasonKind

STILL = [[0.0, 0.0, 0.0]]


@pytest.fixture
def obstacles():
    table = Obstacles()
    table.update(["ball"], 1.0, [[3.0, 0.0, 0.0]], STILL, radius=0.1, source="camera")
    return table


def kinds(obstacles, now=1.0):
    return [reason.kind for reason in take_obstacle_reasons(obstacles, now, 0.2)]


def test_good_data_give_no_reason(obstacles):
    assert kinds(obstacles) == []


def test_silence_is_a_reason_for_as_long_as_it_lasts(obstacles):
    assert kinds(obstacles, 1.3) == [ReasonKind.SOURCE_SILENT]
    obstacles.update([], 1.3, [], radius=0.0, source="camera")
    assert kinds(obstacles, 1.3) == []


def test_a_stamp_ahead_is_a_reason_and_costs_the_state_its_trust(obstacles):
    assert ReasonKind.STAMP_AHEAD in kinds(obstacles, 0.5)
    assert obstacles.table.refused[obstacles.row("ball")]


def test_a_refused_row_is_named_once_and_until_it_is_good_again(obstacles):
    obstacles.update(["ball"], 1.01, [[np.nan, 0.0, 0.0]], STILL, radius=0.1, source="camera")
    for _ in range(2):
        (reason,) = take_obstacle_reasons(obstacles, 1.01, 0.2)
        assert reason.kind is ReasonKind.OBSTACLE_REFUSED
        assert reason.subject == "ball"
    obstacles.update(["ball"], 1.02, [[3.0, 0.0, 0.0]], STILL, radius=0.1, source="camera")
    assert kinds(obstacles, 1.02) == []


def test_removals_of_what_is_not_there_are_told_and_stop_nothing(obstacles):
    obstacles.remove(["nobody"], stamp=1.0, source="camera")
    obstacles.remove(["ball"], stamp=0.9, source="camera")
    told = kinds(obstacles)
    assert told == [ReasonKind.REMOVAL_IGNORED] * 2
    assert ReasonKind.REMOVAL_IGNORED.effect is Effect.NOTE
    assert obstacles.row("ball") >= 0
