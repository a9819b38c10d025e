import math

import numpy as np
import pytest

from armguard.messages.answers import VerdictMessage, read_verdict, to_verdict_message
from armguard.recording.events import KINDS, NUMBERS, JointState
from armguard.recording.packing import ATTACHED, NOTED, pack_record, unpack_record
from support.recorded_messages import MESSAGES, VERDICTS


@pytest.mark.parametrize("message", MESSAGES, ids=lambda one: type(one).__name__)
def test_messages_cross_as_they_are(message):
    kind = NUMBERS[type(message)]
    assert repr(unpack_record(pack_record(kind, 7, message))) == repr((kind, 7, message))


@pytest.mark.parametrize("kind", [ATTACHED, NOTED])
def test_plain_data_cross_too(kind):
    assert kind >= len(KINDS)
    assert unpack_record(pack_record(kind, 7, ("a", {"b": b"c"}))) == (kind, 7, ["a", {"b": b"c"}])


@pytest.mark.parametrize("verdict", VERDICTS)
def test_a_verdict_crosses_to_the_bit(verdict):
    told = verdict._replace(speed_scale=np.float64(0.5), complete=np.True_, stop_time=math.nan)
    _, _, message = unpack_record(pack_record(NUMBERS[VerdictMessage], 7, to_verdict_message(told)))
    expected = told._replace(speed_scale=0.5, complete=True)
    assert repr(read_verdict(message)) == repr(expected)


def test_what_cannot_be_written_raises():
    for broken in ({"now": object()}, {"now": 0.0, "arm": "\ud800"}):
        with pytest.raises((TypeError, UnicodeError)):
            pack_record(NUMBERS[JointState], 7, JointState(0.0, [], b"", b"", **broken))
