"""A wrong frame is no other body: what it says is not believed, however long it says so."""

import numpy as np
import pytest

from armguard.obstacles import FaultKind, Frame, Obstacles
from armguard.verdict import Level, ReasonKind
from support.panda_monitor import PERIOD, kinds, make_monitor, steps

SHIFT = np.array([0.0, 3.0, 0.0])
PLACE = np.array([0.9, 0.0, 0.5])  # beside the arm
STILL = [[0.0, 0.0, 0.0]]


def make_table(**options):
    return Obstacles(frames={"shelf": Frame(np.eye(3), SHIFT)}, **options)


def see(table, stamp, place=PLACE, frame="world", name="ball"):
    table.update([name], stamp, [place], STILL, radius=0.1, source="camera", frame=frame)


def place_of(table, name="ball"):
    return table.table.points[table.row(name), 0]


def test_what_contradicts_in_another_frame_is_never_another_track():
    """Not when five samples agree, and not when the body could have gone there meanwhile."""
    table = make_table()
    see(table, 0.0)
    for tick in range(1, 500):
        see(table, 0.01 * tick, frame="shelf")
        assert place_of(table).tolist() == PLACE.tolist()
        assert table.table.refused[table.row("ball")]
    faults = table.take_faults()
    assert {fault.kind for fault in faults[1:]} == {FaultKind.WRONG_FRAME}
    assert faults[-1].value == "shelf"
    assert table.table.unknown[table.row("ball")]


def test_in_its_own_frame_it_is_another_body():
    table = make_table()
    see(table, 0.0)
    for tick in range(1, 6):
        see(table, 0.01 * tick, PLACE + SHIFT)
    assert place_of(table).tolist() == (PLACE + SHIFT).tolist()


def test_a_source_may_use_several_frames_that_agree():
    table = make_table()
    for tick in range(20):
        frame = ("world", "shelf")[tick % 2]
        see(table, 0.01 * tick, PLACE - SHIFT * (frame == "shelf"), frame)
        assert table.take_faults() == []
    for tick in range(20, 40):  # and may go on in the other one
        see(table, 0.01 * tick, PLACE - SHIFT, "shelf")
    assert table.take_faults() == []
    assert place_of(table) == pytest.approx(PLACE)


def test_it_is_believed_again_in_the_frame_from_before():
    table = make_table()
    see(table, 0.0)
    for tick in range(1, 10):
        see(table, 0.01 * tick, frame="shelf")
    see(table, 0.1)
    table.take_faults()
    see(table, 0.11, PLACE - SHIFT, "shelf")
    assert table.take_faults() == [], "and in the other one, where that agrees"


def test_an_id_that_was_removed_comes_back_in_any_frame():
    table = make_table()
    see(table, 0.0)
    for tick in range(1, 10):
        see(table, 0.01 * tick, frame="shelf")
    table.remove(["ball"], stamp=0.1, source="camera")
    table.take_faults()
    for tick in range(11, 20):
        see(table, 0.01 * tick, frame="shelf")
        see(table, 0.01 * tick, frame="shelf", name="cup")
    assert table.take_faults() == []
    assert place_of(table) == pytest.approx(PLACE + SHIFT)


def test_other_bodies_and_sources_are_believed_meanwhile():
    table = make_table()
    see(table, 0.0)
    see(table, 0.0, 2.0 * PLACE, name="cup")
    table.update(["lamp"], 0.0, [PLACE], STILL, radius=0.1, source="other")
    for tick in range(1, 20):
        see(table, 0.01 * tick, frame="shelf")
        see(table, 0.01 * tick, 2.0 * PLACE, name="cup")
        table.update(["lamp"], 0.01 * tick, [PLACE], STILL, radius=0.1, source="other")
    names = {(fault.source, fault.id) for fault in table.take_faults()}
    assert names == {("camera", "ball")}


def test_the_arm_stands_for_as_long_as_the_frame_is_wrong():
    obstacles = make_table(sources=["camera"])
    _, monitor = make_monitor(obstacles=obstacles)
    see(obstacles, 0.0, [3.0, 0.0, 0.5])
    assert {verdict.level for verdict in steps(monitor, 0, 20)} == {Level.CLEAR}
    for tick in range(20, 1500):
        see(obstacles, PERIOD * tick, [3.0, 0.0, 0.5], "shelf")
        (verdict,) = steps(monitor, tick, 1)
        assert ReasonKind.OBSTACLE_REFUSED in kinds(verdict)
        assert tick < 22 or verdict.level is Level.STOP
    assert "frame is shelf" in str(verdict.reasons)
    for tick in range(1500, 3500):
        see(obstacles, PERIOD * tick, [3.0, 0.0, 0.5])
        (verdict,) = steps(monitor, tick, 1)
    assert verdict.level is Level.CLEAR, "once most of what came lately is believed again"
