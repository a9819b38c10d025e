import pytest

from support.stream_messages import (
    World,
    joints,
    two_arms,
)


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
