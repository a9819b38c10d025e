import math

import numpy as np
import pytest

from armguard.streams import FaultLog
from armguard.streams.intake import SequenceWatch
from support.stream_messages import (
    World,
    joints,
    obstacles,
    two_arms,
)


@pytest.mark.parametrize("shape", [(1,), (2, 7), (5, 3, 3)])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_is_named_by_its_place(shape, value):
    array = np.full(shape, 1e308)
    world = World()
    assert world.edge._intake.check_finite("cam0", 1, {"position": array, "velocity": None})
    assert world.faults.total == 0
    array.reshape(-1)[-1] = value
    assert not world.edge._intake.check_finite("cam0", 1, {"position": array})
    place = ", ".join(str(size - 1) for size in shape)
    assert f"cam0 message 1: position[{place}] is {value}" in world.lines[0]


def follow(*numbers):
    faults = FaultLog(lambda: 0.0, lambda line: None)
    found = []
    faults.add = lambda kind, source, number, problem, times: found.append((kind, times))
    watch = SequenceWatch(faults, "cam0")
    for number in numbers:
        watch.follow(number)
    return found


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


@pytest.mark.parametrize("named", [{}, {"arm": "middle"}])
def test_a_joint_state_of_no_arm_of_the_cell_moves_none(named):
    world, told = two_arms()
    world.send(joints(**named))
    assert world.edge.joints.state is None
    assert not told
    assert world.kinds() == ["malformed"]


def test_a_joint_state_that_names_an_arm_is_refused_where_there_is_one():
    world = World()
    world.send(joints(arm="left"))
    assert world.edge.joints.state is None
    assert world.kinds() == ["malformed"]


def test_ends_of_exemptions_and_resets_go_to_the_arm_that_they_name():
    world, _ = two_arms(reset_token="sesame")
    reset = {"type": "reset", "token": "sesame"}
    world.send({"type": "watch", "number": 7, "arm": "right"}, reset | {"arm": "right"})
    assert world.edge.requests.exemptions == []
    assert not world.edge.requests.is_reset
    assert world.faults.total == 0
    world.send({"type": "watch", "number": 8}, reset, reset | {"arm": "middle"})
    assert world.edge.requests.exemptions == []
    assert not world.edge.requests.is_reset
    assert world.faults.count("malformed") == 1
    assert world.faults.count("reset refused") == 2
    world.send({"type": "watch", "number": 9, "arm": "left"}, reset | {"arm": "left"})
    assert [one.number for one in world.edge.requests.exemptions] == [9]
    assert world.edge.requests.is_reset


def test_a_reset_that_names_an_arm_is_refused_where_there_is_one():
    world = World(reset_token="sesame")
    world.send({"type": "reset", "token": "sesame", "arm": "left"})
    assert not world.edge.requests.is_reset
    assert world.faults.count("reset refused") == 1
