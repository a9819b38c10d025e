import re

import numpy as np
import pytest

from armguard.messages.incoming import decode
from armguard.streams.joint_order import JointOrder
from support.stream_messages import (
    JOINTS,
    World,
    joints,
    pack,
)


def test_joint_names_in_any_order_with_extras():
    world = World()
    world.send(joints())
    state = world.edge.joints.state
    assert state.q.tolist() == [1.0, 2.0]
    assert state.v.tolist() == [0.1, 0.2]
    assert state.stamp == pytest.approx(5.0)
    packed = joints(names=JOINTS, q=np.array([3.0, 4.0]).tobytes(), v=[0.0, 0.0])
    world.send(packed)
    assert world.edge.joints.state.q.tolist() == [3.0, 4.0]
    assert world.faults.total == 0


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"names": ["elbow", "gripper", "wrist"]}, "'shoulder' .missing"),
        ({"names": ["elbow", "elbow", "shoulder"]}, "'elbow' .named twice"),
        ({"names": []}, "missing"),
        ({"q": [1.0, 2.0]}, "q is 2 values"),
        ({"v": b"\0" * 9}, "v is 9 bytes"),
    ],
)
def test_joints_that_do_not_fit_are_refused_by_name(changes, text):
    world = World()
    world.send(joints(seq=3, **changes))
    assert world.edge.joints.state is None
    assert world.kinds() == ["malformed"]
    assert "joints message 3" in world.lines[0]
    assert re.search(text, world.lines[0])


def read(order, message):
    """Values as a list, each of which may be written."""
    q, v = order.read(message)
    assert q.flags.writeable
    assert v.flags.writeable
    return [q.tolist(), v.tolist()]


@pytest.mark.parametrize("is_packed", [True, False])
def test_values_stand_in_the_order_of_the_joints_however_they_are_written(is_packed):
    write = (lambda values: np.array(values).tobytes()) if is_packed else list
    message = decode(pack(joints(q=write([2.0, 9.0, 1.0]), v=write([0.2, 0.9, 0.1]))))
    order = JointOrder(JOINTS)
    assert read(order, message) == [[1.0, 2.0], [0.1, 0.2]]
    # A sender may change its order.
    turned = decode(pack(joints(names=JOINTS, q=write([3.0, 4.0]), v=write([0.3, 0.4]))))
    assert read(order, turned) == [[3.0, 4.0], [0.3, 0.4]]
    assert read(order, message) == [[1.0, 2.0], [0.1, 0.2]]
