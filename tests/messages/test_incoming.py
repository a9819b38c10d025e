import contextlib
import json
import re

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from armguard.messages.answers import decode_answer, encode_plan_verdict
from armguard.messages.incoming import (
    MessageError,
    decode,
    read_header,
    to_points,
    to_values,
)
from armguard.verdict import PlanVerdict
from support.stream_messages import World, joints, obstacles, pack


@pytest.mark.parametrize("leading", [b"", b" ", b"\n\t"])
def test_json_and_msgpack_carry_the_same(leading):
    message = obstacles(snapshot=True, accel=[3.0], frame="camera")
    assert decode(pack(message)) == decode(leading + json.dumps(message).encode())


@pytest.mark.parametrize("encode_any", [msgspec.json.encode, msgspec.msgpack.encode])
def test_a_header_agrees_with_the_message(encode_any):
    """A limit that is kept by the header must not be passed by what the message then is."""
    for message in (obstacles(), obstacles(source=..., seq=...)):
        header, whole = read_header(encode_any(message)), decode(encode_any(message))
        assert (header.type, header.source, header.seq) == ("obstacles", whole.source, whole.seq)
    assert read_header(encode_any(joints())).type == "joints"
    for bad in ([], 1, obstacles(seq="a"), obstacles(source=None), obstacles(type=2)):
        assert read_header(encode_any(bad)) is None
        with pytest.raises(MessageError):
            decode(encode_any(bad))


def test_a_message_that_says_something_twice_says_what_its_header_says():
    text = '{"type":"obstacles","source":"a","source":"b","ids":[],"stamp":1.0%s}'
    twice = (text % "").encode()
    assert read_header(twice).source == decode(twice).source == "b"
    with pytest.raises(MessageError):
        decode((text % ',"type":"reset"').encode())


@given(st.integers(1, 6), st.integers(1, 8), st.booleans())
def test_packed_points_and_lists_are_the_same_array(count, points, flat):
    shape = (count, 3) if flat else (count, points, 3)
    array = np.random.default_rng(0).normal(size=shape)
    assert (to_points("position", array.tolist(), count) == array).all()
    packed = to_points("position", array.astype("<f8").tobytes(), count)
    # One point a row may be told either way.
    assert (packed.reshape(shape) == array).all()


@pytest.mark.parametrize(
    "points",
    [
        b"\0" * 23,
        b"\0" * 49,
        b"\0" * (24 * 9 * 2),
        b"",
        [],
        [[1.0, 2.0, 3.0]],
        [[1.0, 2.0], [1.0, 2.0]],
        [[1.0, 2.0, 3.0], [1.0, 2.0]],
        [[1.0, 2.0, 3.0], [[1.0, 2.0, 3.0]]],
        [[[1.0, 2.0, 3.0]] * 9] * 2,
        [[], []],
        [[[]], [[]]],
    ],
)
def test_points_of_a_wrong_shape_are_refused(points):
    with pytest.raises(MessageError, match=r"position is .*expected"):
        to_points("position", points, 2)


def test_values_of_a_wrong_length_are_refused():
    assert (to_values("radius", np.array([1.0, 2.0]).tobytes(), 2) == [1.0, 2.0]).all()
    for values in (b"\0" * 8, b"\0" * 17, [1.0], [1.0, 2.0, 3.0]):
        with pytest.raises(MessageError, match="radius"):
            to_values("radius", values, 2)


HOSTILE = [
    b"",
    b"\x00",
    b"\xc1",
    b"{",
    b"[1, 2]",
    b"nonsense",
    b"{}",
    b'{"type": "joints"',
    b'{"type": "unknown", "stamp": 1.0}',
    b'{"type": "joints", "stamp": NaN, "names": [], "q": [], "v": []}',
    b'{"type": "obstacles", "ids": ["\xff"], "stamp": 1.0}',
    b'{"type": "obstacles", "stamp": 1.0, "ids": ' + b"[" * 100_000,
    b"[" * 1_000_000,
    b"\x91" * 1_000_000,
    b"\x81\xa4type" * 100_000,
    b"\xdf\xff\xff\xff\xff",
    b"\x83\xa4type\xa9obstacles\xa5stamp\x01\xa3ids\xdd\xff\xff\xff\xff",
    b"\x83\xa4type\xa9obstacles\xa5stamp\x01\xa8position\xc6\xff\xff\xff\xff",
    pack(obstacles()) + b"\0",
    pack(obstacles())[:-3],
    pack(obstacles(colour="red")),
    pack(obstacles(stamp="noon")),
    pack(obstacles(stamp=True)),
    pack(obstacles(stamp=None)),
    pack(obstacles(stamp=...)),
    pack(obstacles(ids=...)),
    pack(obstacles(ids=[1])),
    pack(obstacles(ids="a")),
    pack(obstacles(seq=1.5)),
    pack(obstacles(position="here")),
    pack(obstacles(position=[["1", 2, 3]])),
    pack(obstacles(radius="big")),
    pack(obstacles(snapshot=1)),
    pack({"type": "verdict"}),
    pack([obstacles()]),
    pack(joints(q="up")),
    pack({**joints(), 5: 6}),
]


@pytest.mark.parametrize("data", HOSTILE, ids=range(len(HOSTILE)))
def test_malformed_messages_are_counted_and_do_nothing(data):
    world = World()
    world.send(data)
    assert world.kinds() == ["malformed"]
    assert world.faults.total == 1
    assert len(world.lines) == 1
    assert len(world.lines[0]) < 500
    assert world.lines[0].isprintable()
    assert len(world.obstacles) == 0
    assert world.edge.joints.state is None
    world.send(obstacles())  # and the next good one is taken
    assert len(world.obstacles) == 1


@pytest.mark.parametrize("dump", [pack, lambda message: json.dumps(message).encode()])
@pytest.mark.parametrize(
    ("message", "text"),
    [
        (obstacles(seq=17, position=[[1, "x", 3]]), "cam0 message 17: position.0..1. is 'x'; "),
        (obstacles(seq=17, stamp="noon"), "cam0 message 17: stamp is 'noon'; expected float"),
        (obstacles(seq=17, hue=1), "cam0 message 17: hue is there; expected no such field"),
        (obstacles(seq=17, ids=...), "cam0 message 17: ids is missing; expected a value"),
        (obstacles(seq="x"), "cam0: seq is 'x'; expected int"),
        (joints(seq=4, q="up"), "joints"),
        ({"type": "gossip"}, "gossip: type is 'gossip'; expected"),
    ],
)
def test_mistakes_name_source_number_field_and_value(dump, message, text):
    world = World()
    world.send(dump(message))
    assert re.match(f"malformed: {text}", world.lines[0]), world.lines[0]


@given(st.binary(max_size=200))
def test_random_bytes_never_raise(data):
    for beginning in (b"", b'{"type":"obstacles",', b"\x83\xa4type\xa9obstacles"):
        with contextlib.suppress(MessageError):
            decode(beginning + data)


@given(st.data())
def test_damaged_messages_never_raise_past_the_edge(data):
    world = FUZZED
    good = pack(obstacles() if data.draw(st.booleans()) else joints())
    place = data.draw(st.integers(0, len(good) - 1))
    world.send(good[:place] + data.draw(st.binary(max_size=4)) + good[place + 1 :])


FUZZED = World()
PLAN = {
    "type": "plan", "ask": "commit", "stamp": 1.0, "names": ["a"], "times": [0.0, 1.0],
    "q": [[0.0], [0.0]], "v": [[0.0], [0.0]], "tracking_error": 0.1,
}  # fmt: skip


@pytest.mark.parametrize(
    "changes", [{"ask": "follow", "number": 1}, {"number": 1, "stop_tracking_error": 0.1}]
)
def test_messages_of_earlier_versions_say_what_replaces_them(changes):
    with pytest.raises(MessageError, match=r"carry their own stop"):
        decode(json.dumps({**PLAN, **changes}).encode())
    with pytest.raises(MessageError, match=r"path_time.*carry their own stop"):
        decode(json.dumps({**joints(), "path_time": 0.1}).encode())


def test_every_plan_that_is_read_can_be_answered_by_its_number():
    no = PlanVerdict(False, 0.0, None, None, ())
    for number in (0, 2**63 - 1):
        message = decode(json.dumps({**PLAN, "number": number}).encode())
        assert decode_answer(encode_plan_verdict(message.number, no)) == (number, no)
    for number in (-1, 2**63, 2**64, 10**30):
        with pytest.raises(MessageError, match="number is"):
            decode(json.dumps({**PLAN, "number": number}).encode())
