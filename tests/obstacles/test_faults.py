import math

from armguard.obstacles import FaultKind
from armguard.obstacles.faults import CAPACITY, FaultQueue, Homeless


def test_faults_are_told_once_and_in_order():
    queue = FaultQueue()
    queue.leave(FaultKind.NOT_FINITE, "camera", "ball", "radius", math.inf, 1.0)
    queue.leave(FaultKind.LATE, "camera", "box", "stamp", 2.0, 2.0)
    assert [fault.id for fault in queue.take()] == ["ball", "box"]
    assert queue.take() == []
    assert (queue.count, queue.dropped) == (2, 0)


def test_faults_beyond_the_capacity_are_counted():
    queue = FaultQueue()
    for k in range(CAPACITY + 3):
        queue.leave(FaultKind.NEGATIVE, "camera", f"{k}", "radius", -1.0, 0.0)
    assert len(queue.take()) == CAPACITY
    assert (queue.count, queue.dropped) == (CAPACITY + 3, 3)


def test_the_homeless_stay_until_somebody_who_may_discards_them():
    homeless = Homeless()
    homeless.add("ball", source=1, stamp=2.0)
    homeless.add("ball", source=1, stamp=1.0)
    assert not homeless.discard("box")
    assert not homeless.discard("ball", source=2)
    assert not homeless.discard("ball", source=1, stamp=1.5)
    assert homeless.names() == ["ball"]
    assert homeless.discard("ball", source=1, stamp=2.0)
    assert homeless.names() == []
    assert not homeless.discard("ball")


def test_homeless_beyond_the_capacity_are_missing_until_their_source_starts_anew():
    homeless = Homeless()
    for k in range(CAPACITY):
        homeless.add(f"{k}", source=1, stamp=0.0)
    homeless.add("one more", source=2, stamp=0.0)
    homeless.forget(1)
    assert homeless.names() == ["more obstacles"]
    homeless.forget(3)
    assert homeless.names() == ["more obstacles"]
    homeless.forget(2)
    assert homeless.names() == []
