import pytest

from armguard.messages.incoming import AnyMessage, CloudMessage, GoalMessage, JointsMessage
from armguard.recording.events import KINDS, NUMBERS, TOPICS, JointState, Log, schema_name


def test_each_kind_has_a_topic_and_a_schema_of_its_own():
    assert len(set(TOPICS.values())) == len(KINDS) == len({schema_name(kind) for kind in KINDS})
    assert schema_name(Log) == "foxglove.Log"
    assert [NUMBERS[kind] for kind in KINDS] == list(range(len(KINDS)))


@pytest.mark.parametrize("kind", AnyMessage.__args__)
def test_a_recording_holds_each_message_of_the_wire(kind):
    # The voxels of a cloud stand in obstacles, and a joint state with the time of its tick. Goals
    # are left out: no verdict rests on one, but by the plan that is shown for it.
    expected = {JointsMessage: JointState}.get(kind, kind)
    assert (expected in TOPICS) == (kind not in (CloudMessage, GoalMessage))
    assert issubclass(JointState, JointsMessage)
