import math

from armguard.obstacles import FaultKind
from armguard.obstacles.faults import CAPACITY, FaultQueue, Unplaced


def test_faults_are_told_once_and_in_order():
    queue = FaultQueue()
    queue.leave(FaultKind.NOT_FINITE, "camera", "ball", "radius", math.inf, 1.0)
    queue.leave(FaultKind.LATE, "camera", "box", "stamp", 2.0, 2.0)
    assert [fault.id for fault in queue.take()] == ["ball", "box"]
    assert queue.take() == []
    assert (queue.count, queue.take_dropped()) == (2, 0)


def test_faults_beyond_the_capacity_are_counted():
    queue = FaultQueue()
    for k in range(CAPACITY + 3):
        queue.leave(FaultKind.NEGATIVE, "camera", f"{k}", "radius", -1.0, 0.0)
    assert len(queue.take()) == CAPACITY
    assert queue.count == CAPACITY + 3
    assert (queue.take_dropped(), queue.take_dropped()) == (3, 0)


def test_notes_make_room_for_faults_that_stop_the_arm():
    queue = FaultQueue()
    for k in range(CAPACITY):
        queue.leave(FaultKind.SHARED_ID, "camera", f"{k}", "id", "other", 0.0)
    queue.leave(FaultKind.LATE, "camera", "box", "stamp", 2.0, 2.0)
    queue.leave(FaultKind.NEGATIVE, "camera", "ball", "radius", -1.0, 2.0)
    taken = queue.take()
    assert len(taken) == CAPACITY
    assert taken[-1].id == "box"
    assert (queue.count, queue.take_dropped()) == (CAPACITY + 2, 2)


def test_the_unplaced_stay_until_their_source_discards_them():
    unplaced = Unplaced()
    unplaced.add("ball", source=1, stamp=2.0)
    unplaced.add("ball", source=1, stamp=1.0)
    assert not unplaced.discard("box")
    assert not unplaced.discard("ball", source=2)
    assert not unplaced.discard("ball", source=1, stamp=1.5)
    assert unplaced.names() == ["ball"]
    assert unplaced.discard("ball", source=1, stamp=2.0)
    assert unplaced.names() == []
    assert not unplaced.discard("ball")


def test_unplaced_beyond_the_capacity_are_missing_until_their_source_starts_anew():
    unplaced = Unplaced()
    for k in range(CAPACITY):
        unplaced.add(f"{k}", source=1, stamp=0.0)
    unplaced.add("one more", source=2, stamp=0.0)
    unplaced.forget(1)
    assert unplaced.names() == ["more obstacles"]
    unplaced.forget(3)
    assert unplaced.names() == ["more obstacles"]
    unplaced.forget(2)
    assert unplaced.names() == []
