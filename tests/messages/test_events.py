import msgspec
import pytest

from armguard.messages import events
from armguard.messages.incoming import AnyMessage, Message

KINDS = [
    kind
    for kind in vars(events).values()
    if isinstance(kind, type) and issubclass(kind, Message) and kind is not Message
]


@pytest.mark.parametrize("kind", KINDS)
def test_none_is_taken_for_a_message_of_the_wire(kind):
    tags = {one.__struct_config__.tag for one in AnyMessage.__args__}
    assert kind.__struct_config__.tag not in tags
    with pytest.raises(msgspec.ValidationError):
        msgspec.json.decode(b'{"type":"joints"}', type=kind)
