"""Whatever bytes come: a decoder knows one error, and an edge none."""

import contextlib
import gc
import random
import tracemalloc

import msgspec
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from armguard.exceptions import ArmguardError
from armguard.messages.answers import (
    decode_answer,
    encode_command,
    encode_plan_verdict,
    encode_reset_verdict,
    encode_verdict,
)
from armguard.messages.incoming import AnyMessage, MessageError, decode
from armguard.verdict import Level, PlanVerdict, Reason, ReasonKind, ResetVerdict
from armguard.view.messages import decode_message
from support.commands_made import COMMAND
from support.stream_messages import World, joints, obstacles
from support.verdict_samples import verdict

EXAMPLES = settings(max_examples=300, suppress_health_check=[HealthCheck.too_slow], database=None)
PLAN = {
    "type": "plan",
    "ask": "commit",
    "number": 3,
    "stamp": 1005.0,
    "names": ["shoulder", "elbow"],
    "times": [0.0, 1.0],
    "q": [[0.0, 0.0], [0.0, 0.0]],
    "v": [[0.0, 0.0], [0.0, 0.0]],
    "tracking_error": 0.1,
}
GOAL = {"type": "goal", "number": 3, "until": 1005.5, "names": ["shoulder", "elbow"]}
VALID = [
    GOAL | {"paths": [{"q": [[0.0, 0.0], [1.0, 1.0]], "times": [0.0, 9.0]}]},
    GOAL | {"velocity": [0.1, 0.2]},
    GOAL | {"chunk": b"\0" * 32},
    obstacles(),
    obstacles(position=b"\0" * 24, velocity=None, radius=b"\0" * 8, snapshot=True),
    {"type": "remove", "ids": ["a"], "stamp": 1005.0, "source": "cam0", "seq": 3},
    {"type": "reset", "token": "sesame"},
    joints(),
    joints(q=b"\0" * 24),
    PLAN,
]
ENCODED = [
    *map(msgspec.msgpack.encode, VALID),
    *map(msgspec.json.encode, [one for one in VALID if b"\0" not in msgspec.msgpack.encode(one)]),
]
ANSWERS = [
    encode_verdict(verdict(Level.STOP, reasons=(Reason(ReasonKind.NO_SOURCES),)), 3.0),
    encode_command(COMMAND, 3.0),
    encode_plan_verdict(7, PlanVerdict(False, 0.1, "hand", "ball", ())),
    encode_reset_verdict(7, ResetVerdict(False, "another token")),
]

values = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**64 - 1)
    | st.floats()
    | st.text(max_size=20)
    | st.binary(max_size=60),
    lambda inner: st.lists(inner, max_size=5) | st.dictionaries(st.text(max_size=8), inner),
    max_leaves=12,
)


@st.composite
def spoiled(draw, samples):
    """A good message with bytes changed, left out, repeated or put in."""
    data = bytearray(draw(st.sampled_from(samples)))
    for _ in range(draw(st.integers(1, 4))):
        place = draw(st.integers(0, max(0, len(data) - 1)))
        end = draw(st.integers(place, min(len(data), place + 12)))
        data[place:end] = draw(st.binary(max_size=8) | st.just(bytes(data[place:end]) * 2))
    return bytes(data)


@st.composite
def refilled(draw):
    """A good message with other values in its fields, and perhaps fields too many or too few."""
    message = dict(draw(st.sampled_from(VALID)))
    for field in draw(st.lists(st.sampled_from([*message, "more"]), max_size=3)):
        message[field] = draw(values)
    for field in draw(st.lists(st.sampled_from(list(message)), max_size=1)):
        del message[field]
    return msgspec.msgpack.encode(message)


def hold_that_it_says_why(error):
    assert str(error)


@EXAMPLES
@given(st.binary(max_size=300) | spoiled(ENCODED) | refilled())
def test_a_message_is_decoded_or_refused_by_one_error(data):
    try:
        assert isinstance(decode(data), AnyMessage)
    except MessageError as error:
        hold_that_it_says_why(error)


@EXAMPLES
@given(st.binary(max_size=300) | spoiled(ANSWERS))
def test_an_answer_is_decoded_or_refused_by_one_error(data):
    try:
        decode_answer(data)
    except MessageError as error:
        hold_that_it_says_why(error)


@EXAMPLES
@given(st.binary(max_size=300) | values.map(msgspec.msgpack.encode))
def test_a_frame_of_the_view_is_decoded_or_refused_by_one_error(data):
    try:
        decode_message(data)
    except ArmguardError as error:
        hold_that_it_says_why(error)


@pytest.mark.hazard("H-23")
@EXAMPLES
@given(st.lists(st.binary(max_size=300) | spoiled(ENCODED) | refilled(), max_size=4))
def test_an_edge_raises_nothing_whatever_comes(messages):
    world = World(reset_token="sesame")
    world.send(*messages)
    assert world.edge.received == len(messages)


def test_deep_nesting_is_refused():
    for data in (b"[" * 100_000, b'{"a":' * 100_000, b"\x91" * 100_000, b"\x81\xa1a" * 100_000):
        for one in (decode, decode_answer):
            try:
                one(data)
            except MessageError:
                continue
            raise AssertionError


def test_lengths_that_are_claimed_and_not_there_take_no_memory():
    """A header of a few bytes may say that four thousand million entries follow."""
    for head in (b"\xdd", b"\xdf", b"\xc6", b"\xdb"):
        tracemalloc.start()
        with contextlib.suppress(MessageError):
            decode(head + b"\xff\xff\xff\xff" + b"\x01" * 20)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < 1_000_000


def test_no_memory_grows_with_what_was_refused():
    """Names, fields and values are made up anew each time, as a hostile sender would."""
    chance = random.Random(11)
    world = World(reset_token="sesame")

    def send(count):
        for _ in range(count):
            data = bytearray(chance.choice(ENCODED))
            for _ in range(chance.randint(1, 5)):
                data[chance.randrange(len(data))] = chance.randrange(256)
            made_up = obstacles(source=chance.randbytes(8).hex(), position=[["x"]])
            world.send(bytes(data), msgspec.msgpack.encode(made_up), chance.randbytes(40))
            world.obstacles.take_faults()
        world.lines.clear()
        gc.collect()

    send(3000)  # until all that is bounded is full
    tracemalloc.start()
    send(200)
    before = tracemalloc.get_traced_memory()[0]
    send(4000)
    grown = tracemalloc.get_traced_memory()[0] - before
    tracemalloc.stop()
    assert grown < 100_000
