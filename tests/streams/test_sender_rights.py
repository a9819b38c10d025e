import pytest

from armguard.messages.incoming import decode
from armguard.obstacles import FaultKind
from armguard.streams.authentication import SenderError
from armguard.streams.sender_rights import check_sender
from support.stream_messages import World, joints, obstacles, pack, plan

RESET = {"type": "reset", "token": "sesame"}
REMOVE = {"type": "remove", "ids": ["a"], "stamp": 1005.0, "source": "cam0"}


class Rights:
    """What clients may do, as a test has it."""

    def __init__(self, rights, arms=()):
        self._rights, self._arms = rights, arms

    def may(self, name, right):
        return right in self._rights.get(name, ())

    def may_speak_for(self, name, arm):
        return not arm or arm in self._arms


def check(message, sender, authenticator, world=None):
    world = World() if world is None else world
    check_sender(decode(pack(message)), sender, authenticator, world.edge._intake)


@pytest.mark.parametrize(
    ("message", "right"),
    [
        (obstacles(), "obstacles"),
        (REMOVE, "obstacles"),
        (joints(), "joints"),
        (plan(), "joints"),
        ({"type": "watch", "number": 7}, "joints"),
        (RESET, "reset"),
    ],
)
def test_each_message_needs_the_right_for_its_type(message, right):
    check(message, "cam0", Rights({"cam0": [right]}))
    others = {"obstacles", "joints", "reset", "verdicts", "view"} - {right}
    with pytest.raises(SenderError, match=f"may not send {right}"):
        check(message, "cam0", Rights({"cam0": others}))
    with pytest.raises(SenderError, match="may not send"):
        check(message, None, Rights({"cam0": [right]}))


def test_obstacles_in_the_name_of_another_are_refused_and_reach_the_verdict():
    world = World()
    with pytest.raises(SenderError, match="'cam0' in a message with the key of 'lidar'"):
        check(obstacles(), "lidar", Rights({"lidar": ["obstacles"]}), world)
    (fault,) = world.obstacles.take_faults()
    assert (fault.kind, fault.source) == (FaultKind.MALFORMED, "lidar")


def test_a_client_speaks_for_its_arms_and_resets_by_right():
    rights = Rights({"plc": ["joints", "reset"]}, arms=["left"])
    check(joints(arm="left"), "plc", rights)
    check(RESET | {"arm": "right"}, "plc", rights)
    with pytest.raises(SenderError, match="one of the arms of 'plc'"):
        check(joints(arm="right"), "plc", rights)
