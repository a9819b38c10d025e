import pytest

from armguard.streams.sequence_watch import SequenceWatch
from support.stream_messages import (
    World,
    obstacles,
)


def follow(*numbers):
    watch = SequenceWatch()
    return [(kind, times) for n in numbers for kind, times, _ in watch.follow(n)]


def test_numbers_in_order_or_absent_are_no_fault():
    assert follow(5, 6, 7, None, 8) == []


def test_lost_messages_are_counted():
    assert follow(1, 2, 5, 6, 10) == [("lost", 2), ("lost", 3)]
    world = World()
    for number in (1, 2, 7):
        world.send(obstacles(seq=number))
    assert world.faults.count("lost") == 4


def test_a_restarted_publisher_is_one_fault():

    assert follow(70, 71, 1, 2, 3) == [("sequence went back", 1)]


@pytest.mark.parametrize("numbers", [(50, 3, 51, 4, 52, 5), (1, 1, 2, 2, 3, 3, 4, 4)])
def test_two_publishers_of_one_source_are_told(numbers):
    faults = follow(*numbers)
    assert ("two publishers", 1) in faults
    assert ("lost", 46) not in faults


def test_huge_numbers_do_no_harm():
    assert follow(-(2**63), 2**63 - 1) == [("lost", 2**64 - 2)]
