import numpy as np
import pytest

from armguard import Obstacles, Source
from armguard.exceptions import ArmguardError
from armguard.monitor.obstacle_reasons import take_obstacle_reasons
from armguard.obstacles import FaultKind, sources
from armguard.obstacles.faults import CAPACITY
from armguard.verdict import Effect, ReasonKind

STILL = [[0.0, 0.0, 0.0]]


@pytest.fixture
def obstacles():
    table = Obstacles()
    table.update(["ball"], 1.0, [[3.0, 0.0, 0.0]], STILL, radius=0.1, source="camera")
    return table


def kinds(obstacles, now=1.0):
    return [reason.kind for reason in take_obstacle_reasons(obstacles, now, 0.2, 0.3)]


def test_good_data_give_no_reason(obstacles):
    assert kinds(obstacles) == []


def test_silence_is_a_reason_for_as_long_as_it_lasts(obstacles):
    assert kinds(obstacles, 1.3) == [ReasonKind.SOURCE_SILENT]
    obstacles.update([], 1.3, [], radius=0.0, source="camera")
    assert kinds(obstacles, 1.3) == []


def test_a_stamp_ahead_is_a_reason_and_costs_the_state_its_trust(obstacles):
    assert ReasonKind.STAMP_AHEAD in kinds(obstacles, 0.5)
    assert obstacles.table.refused[obstacles.row("ball")]


def test_a_refused_row_is_named_once_for_as_long_as_it_may_be_true(obstacles):
    obstacles.update(["ball"], 1.01, [[np.nan, 0.0, 0.0]], STILL, radius=0.1, source="camera")
    for _ in range(2):
        (reason,) = take_obstacle_reasons(obstacles, 1.01, 0.2, 0.3)
        assert reason.kind is ReasonKind.OBSTACLE_REFUSED
        assert reason.subject == "ball"
        assert reason.kind.effect is Effect.NOTE
    for now in (1.02, 1.3):
        obstacles.update(["ball"], now, [[3.0, 0.0, 0.0]], STILL, radius=0.1, source="camera")
        assert kinds(obstacles, now) == [ReasonKind.OBSTACLE_REFUSED]
    assert kinds(obstacles, 1.32) == []


def test_points_that_were_left_out_are_a_note_once(obstacles):
    points = np.ones((8, 3))
    points[3] = np.nan
    obstacles.update_cloud("depth", 1.0, points, [0, 0, 0])
    (reason,) = take_obstacle_reasons(obstacles, 1.0, 0.2, 0.3)
    assert reason.kind is ReasonKind.POINTS_DROPPED
    assert reason.kind.effect is Effect.NOTE
    assert reason.subject == "depth"
    assert reason.detail.startswith("cloud is without 1 of 8 points: points that are not finite")
    assert kinds(obstacles) == []


def test_a_blind_camera_is_not_believed(obstacles):
    obstacles.update_cloud("depth", 1.0, np.full((80, 3), np.nan), [0, 0, 0])
    assert set(kinds(obstacles)) == {ReasonKind.SOURCE_NOT_BELIEVED, ReasonKind.POINTS_DROPPED}


def test_faults_are_told_in_sentences(obstacles):
    obstacles.update(["ball"], 1.01, [[np.nan, 0.0, 0.0]], STILL, radius=0.1, source="camera")
    with pytest.raises(ArmguardError):
        obstacles.update(["ball"], 1.02, STILL, radius=0.1, source="camera", frame="nowhere")
    details = [reason.detail for reason in take_obstacle_reasons(obstacles, 1.02, 0.2, 0.3)]
    assert details[0] == "position is nan: not a finite number"
    assert details[1].startswith("frame 'nowhere' is unknown")


def test_a_source_may_ask_for_a_stop_where_its_rows_are_refused():
    obstacles = Obstacles(sources=[Source("camera", on_refusal="stop"), "other"])
    for source in ("camera", "other"):
        obstacles.update(["ball"], 1.0, [[3.0, 0.0, 0.0]], STILL, radius=0.1, source=source)
    take_obstacle_reasons(obstacles, 1.0, 0.2, 0.3)
    for source in ("camera", "other"):
        obstacles.update(["ball"], 1.01, [[4.0, 0.0, 0.0]], STILL, radius=0.1, source=source)
    for now in (1.01, 1.1):
        reasons = take_obstacle_reasons(obstacles, now, 0.2, 0.3)
        standing = [reason for reason in reasons if reason.kind.effect is Effect.STANDING]
        assert [reason.kind for reason in standing] == [ReasonKind.OBSTACLE_NOT_BELIEVED]
        assert 'on_refusal = "stop"' in standing[0].detail
    for source in ("camera", "other"):
        obstacles.update([], 1.32, source=source)
    assert kinds(obstacles, 1.32) == []


def test_a_source_of_which_most_rows_are_refused_is_not_believed():
    obstacles = Obstacles()
    bad = [[np.nan, 0.0, 0.0]]
    for tick in range(100):
        good = [[3.0, 0.0, 0.0]]
        obstacles.update(["ball"], 0.01 * tick, good, STILL, radius=0.1, source="camera")
    # Four of the rows that are left of the last second were refused, and then more than half.
    told = []
    for tick in range(100, 220):
        obstacles.update(["ball"], 0.01 * tick, bad, STILL, radius=0.1, source="camera")
        told.append(ReasonKind.SOURCE_NOT_BELIEVED in kinds(obstacles, 0.01 * tick))
    assert told.index(True) == pytest.approx(50, abs=6)
    assert all(told[60:])
    (reason,) = [
        one
        for one in take_obstacle_reasons(obstacles, 2.2, 0.2, 0.3)
        if one.kind is ReasonKind.SOURCE_NOT_BELIEVED
    ]
    assert (reason.subject, reason.kind.effect) == ("camera", Effect.STANDING)
    assert "rows of a second were refused" in reason.detail
    told = []
    for tick in range(220, 340):
        obstacles.update(["ball"], 0.01 * tick, good, STILL, radius=0.1, source="camera")
        told.append(ReasonKind.SOURCE_NOT_BELIEVED in kinds(obstacles, 0.01 * tick))
    assert told.index(False) == pytest.approx(50, abs=6)
    assert not any(told[60:])


def test_fewer_than_five_refused_rows_say_nothing_of_a_source():
    obstacles = Obstacles()
    for tick in range(5):
        obstacles.update(["ball"], 0.2 * tick, [[np.nan] * 3], STILL, radius=0.1, source="camera")
        found = kinds(obstacles, 0.2 * tick)
        assert (ReasonKind.SOURCE_NOT_BELIEVED in found) == (tick == 4)


def test_a_message_from_before_a_forgotten_removal_is_not_believed(monkeypatch):
    """Its body is in the cell, and not in the table."""
    monkeypatch.setattr(sources, "MAXIMUM_TOMBSTONES", 1)
    obstacles = Obstacles()
    for name in ("a", "b"):
        obstacles.update([name], 1.0, [[3.0, 0.0, 0.0]], STILL, radius=0.1, source="camera")
        obstacles.remove([name], 2.0, source="camera")
    obstacles.update(["c"], 1.5, [[3.0, 0.0, 0.0]], STILL, radius=0.1, source="camera")
    assert ReasonKind.OBSTACLE_NOT_BELIEVED in kinds(obstacles, 2.0)


def test_removals_of_what_is_not_there_are_told_and_stop_nothing(obstacles):
    obstacles.remove(["nobody"], stamp=1.0, source="camera")
    obstacles.remove(["ball"], stamp=0.9, source="camera")
    told = kinds(obstacles)
    assert told == [ReasonKind.REMOVAL_IGNORED] * 2
    assert ReasonKind.REMOVAL_IGNORED.effect is Effect.NOTE
    assert obstacles.row("ball") >= 0


@pytest.mark.parametrize(
    ("kind", "effect"), [("MALFORMED", Effect.STANDING), ("SHARED_ID", Effect.NOTE)]
)
def test_what_found_no_room_in_the_queue_is_told_in_number(obstacles, kind, effect):
    for number in range(CAPACITY + 5):
        obstacles._faults.leave(FaultKind[kind], "camera", "", "ids", f"{number}", 1.0)
    reasons = take_obstacle_reasons(obstacles, 1.0, 0.2, 0.3)
    assert len(reasons) == CAPACITY + 1
    assert "5 faults more" in reasons[-1].detail
    assert {reason.kind.effect for reason in reasons} == {effect}
    assert kinds(obstacles) == []
