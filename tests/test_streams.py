import contextlib
import json
import math
import os
import re

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from armguard.clock import ManualClock
from armguard.contact import Certificate
from armguard.exceptions import ObstacleError
from armguard.obstacles import FaultKind, Frame, Obstacles
from armguard.streams import Edge, FaultLog, LineInput, StampClock
from armguard.streams.inputs import BYTE_LIMIT
from armguard.streams.messages import (
    MessageError,
    ObstaclesMessage,
    decode,
    decode_verdict,
    encode,
    encode_verdict,
    to_points,
    to_values,
)
from armguard.streams.sequence import SequenceWatch
from armguard.verdict import Level, Reason, ReasonKind, Verdict

JOINTS = ["shoulder", "elbow"]
MONOTONIC = 1000.0
UNIX = 1.7e9


class Messages:
    """An input that hands out what a test puts in."""

    def __init__(self, *messages):
        self.ended = False
        self.waiting = [pack(message) for message in messages]

    def receive(self):
        return self.waiting.pop(0) if self.waiting else None

    def close(self):
        pass


class World:
    """An edge between messages and a table, with clocks that the test sets."""

    def __init__(self, **options):
        self.clock = ManualClock(5.0)
        self.lines = []
        self.faults = FaultLog(self.clock.now, self.lines.append)
        frames = {"camera": Frame(np.eye(3), [1.0, 0.0, 0.0], 0.01)}
        self.obstacles = Obstacles(frames=frames)
        self.input = Messages()
        self.edge = Edge(
            self.obstacles,
            JOINTS,
            self.clock,
            self.faults,
            monotonic=lambda: self.clock.now() + MONOTONIC,
            unix=lambda: self.clock.now() + UNIX,
            **options,
        )

    def send(self, *messages):
        self.input.waiting += [pack(message) for message in messages]
        self.edge.drain([self.input])

    def stamp(self, id="a"):
        return self.obstacles.table.accepted.stamp[self.obstacles.row(id)]

    def kinds(self):
        return sorted({key.kind for key in self.faults.counts})


def pack(message):
    return message if isinstance(message, bytes) else msgspec.msgpack.encode(message)


def obstacles(**changes):
    message = {
        "type": "obstacles",
        "source": "cam0",
        "seq": 1,
        "stamp": MONOTONIC + 5.0,
        "ids": ["a"],
        "position": [[1.0, 2.0, 3.0]],
        "velocity": [[0.0, 0.0, 0.5]],
        "radius": 0.1,
    }
    message.update(changes)
    return {key: value for key, value in message.items() if value is not ...}


def joints(**changes):
    message = {
        "type": "joints",
        "stamp": MONOTONIC + 5.0,
        "names": ["elbow", "gripper", "shoulder"],
        "q": [2.0, 9.0, 1.0],
        "v": [0.2, 0.9, 0.1],
    }
    message.update(changes)
    return {key: value for key, value in message.items() if value is not ...}


# The wire


@pytest.mark.parametrize("leading", [b"", b" ", b"\n\t"])
def test_json_and_msgpack_carry_the_same(leading):
    message = obstacles(snapshot=True, accel=[3.0], frame="camera")
    assert decode(pack(message)) == decode(leading + json.dumps(message).encode())


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
    assert world.edge.joint_state is None
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


def test_too_long_lines_are_refused_and_the_next_is_taken():
    reading, writing = os.pipe()
    lines = LineInput(reading)
    good = json.dumps(obstacles()).encode()
    world = World()
    try:
        sent = memoryview(b"x" * (BYTE_LIMIT + 100_000) + b"\n" + good + b"\n")
        os.set_blocking(writing, False)
        while sent:
            try:
                sent = sent[os.write(writing, sent) :]
            except BlockingIOError:
                world.edge.drain([lines])
        world.edge.drain([lines])
    finally:
        os.close(writing)
    world.edge.drain([lines])
    os.close(reading)
    assert world.kinds() == ["malformed"]
    assert world.faults.total == 1
    assert len(world.obstacles) == 1
    assert lines.ended


# Obstacles through the edge


def test_a_good_message_reaches_the_table_in_monitor_time():
    world = World()
    world.send(obstacles(stamp=MONOTONIC + 4.75, frame="camera"))
    table, row = world.obstacles.table, world.obstacles.row("a")
    assert world.stamp() == pytest.approx(4.75, abs=1e-9)
    assert table.accepted.points[row, 0].tolist() == [2.0, 2.0, 3.0]
    assert table.accepted.position_error[row] == pytest.approx(0.01)
    assert world.faults.total == 0
    assert world.lines == []


@pytest.mark.parametrize(("clock", "stamp"), [("monotonic", MONOTONIC + 5.0), ("unix", UNIX + 5.0)])
def test_clocks_and_latencies_of_sources_are_applied(clock, stamp):
    world = World(stamp_clocks={"cam0": StampClock(clock, 0.25)})
    world.send(obstacles(stamp=stamp))
    assert world.stamp() == pytest.approx(4.75, abs=1e-6)


def test_a_source_without_a_clock_is_as_old_and_uncertain_as_it_may_be():
    world = World(stamp_clocks={"cam0": StampClock("arrival", 0.1)}, speed=2.0, accel=10.0)
    world.edge.drain([world.input])
    world.clock.sleep_until(5.05)
    world.send(obstacles(stamp=0.0), obstacles(stamp=0.0, seq=2, speed=[3.0]))
    accepted, row = world.obstacles.table.accepted, world.obstacles.row("a")
    # It arrived at some time since the last drain, and was measured up to 0.1 s before that.
    assert world.stamp() == pytest.approx(4.9, abs=1e-6)
    assert world.stamp() > 4.9 + 1e-9  # the second of two does not look simultaneous
    assert accepted.position_error[row] == pytest.approx(3.0 * 0.15, rel=1e-6)
    assert accepted.velocity_error[row] == pytest.approx(10.0 * 0.15, rel=1e-6)
    assert world.obstacles.take_faults() == []


def test_clock_errors_of_sources_widen_what_they_say():
    world = World(stamp_clocks={"cam0": StampClock("unix", 0.25, 0.02)}, speed=2.0, accel=10.0)
    world.send(obstacles(stamp=UNIX + 5.0, position_error=0.01, velocity_error=0.1))
    accepted, row = world.obstacles.table.accepted, world.obstacles.row("a")
    assert world.stamp() == pytest.approx(4.75, abs=1e-6)  # the stamp itself stays
    assert accepted.position_error[row] == pytest.approx(0.01 + 2.0 * 0.02)
    assert accepted.velocity_error[row] == pytest.approx(0.1 + 10.0 * 0.02)
    # It adds to what an arrival does not tell.
    world = World(stamp_clocks={"cam0": StampClock("arrival", 0.1, 0.02)}, speed=2.0, accel=10.0)
    world.edge.drain([world.input])
    world.send(obstacles())
    accepted, row = world.obstacles.table.accepted, world.obstacles.row("a")
    assert accepted.position_error[row] == pytest.approx(2.0 * 0.12, rel=1e-6)


def test_a_clock_error_does_not_hide_a_broken_speed_bound():
    world = World(stamp_clocks={"cam0": StampClock("monotonic", 0.0, 0.1)}, speed=2.0, accel=10.0)
    world.send(obstacles(velocity=[[0.0, 0.0, 2.5]], velocity_error=0.1))
    assert [fault.kind for fault in world.obstacles.take_faults()] == [FaultKind.BEYOND_SPEED]
    table = world.obstacles.table
    assert (table.refused_position_error >= 2.6 * 0.1).any()  # as fast as it was measured
    world.send(obstacles(seq=2, velocity=[[math.nan, 0.0, 0.5]]))
    assert "velocity" in [fault.field for fault in world.obstacles.take_faults()]


def test_a_clock_error_needs_no_acceleration_bound():
    world = World(stamp_clocks={"cam0": StampClock("monotonic", 0.0, 0.1)}, speed=2.0)
    world.send(obstacles(velocity_error=0.1))
    accepted, row = world.obstacles.table.accepted, world.obstacles.row("a")
    assert world.obstacles.take_faults() == []
    assert accepted.velocity_error[row] == 0.1


def test_stamps_by_arrival_grow_over_drains_that_were_cut_short():
    world = World(stamp_clocks={"cam0": StampClock("arrival", 0.1)}, speed=2.0, accel=10.0)
    stamps = []
    world.input.waiting += [pack(obstacles(seq=n)) for n in range(200)]
    for tick in range(6):
        world.clock.sleep_until(5.0 + 0.001 * tick)
        world.edge.drain([world.input])
        stamps.append(world.stamp())
    assert world.input.waiting == []
    assert (np.diff(stamps[:4]) > 0).all()
    assert world.obstacles.take_faults() == []


def test_unbounded_obstacles_without_a_clock_are_refused():
    world = World(stamp_clocks={"cam0": StampClock("arrival", 0.1)})
    world.send(obstacles())
    assert [fault.kind for fault in world.obstacles.take_faults()] == [FaultKind.NOT_FINITE]


@pytest.mark.parametrize("error", [-0.1, -math.inf, [math.nan]])
def test_errors_that_make_no_sense_are_not_hidden_by_those_of_arrival(error):
    world = World(stamp_clocks={"cam0": StampClock("arrival", 0.1)}, speed=2.0, accel=10.0)
    world.send(obstacles(position_error=error, speed=math.inf if error == -math.inf else 2.0))
    assert [fault.field for fault in world.obstacles.take_faults()] == ["position_error"]


def test_heartbeat_snapshot_and_removal():
    world = World()
    world.send(obstacles(ids=["a", "b"], position=[[1, 2, 3], [4, 5, 6]], velocity=...))
    assert len(world.obstacles) == 2
    world.send(obstacles(seq=2, ids=[], position=b"", velocity=..., radius=...))
    assert len(world.obstacles) == 2
    later = MONOTONIC + 5.1
    world.send(obstacles(seq=3, stamp=later, velocity=..., snapshot=True))
    assert len(world.obstacles) == 1
    remove = {"type": "remove", "source": "cam0", "seq": 4, "stamp": later + 0.1, "ids": ["a"]}
    world.send(remove)
    assert len(world.obstacles) == 0
    assert world.faults.total == 0
    assert world.obstacles.take_faults() == []


BAD_OBSTACLES = [
    ({"position": [[1.0, math.nan, 3.0]]}, "not finite", r"position\[0, 1\] is nan"),
    ({"position": np.array([1, np.inf, 3.0]).tobytes()}, "not finite", r"position\[0, 1\] is inf"),
    ({"velocity": [[math.nan, 0.0, 0.0]]}, "not finite", r"velocity\[0, 0\] is nan"),
    ({"radius": math.nan}, "not finite", "radius is nan"),
    ({"radius": [math.inf]}, "not finite", r"radius\[0\] is inf"),
    ({"speed": math.nan}, "not finite", "speed is nan"),
    ({"stamp": math.nan}, "not finite", "stamp is nan"),
    ({"stamp": math.inf}, "not finite", "stamp is inf"),
    ({"frame": "moon"}, "refused", "moon"),
    ({"ids": ["a", "a"], "position": [[1, 2, 3]] * 2, "velocity": ...}, "refused", "'a'"),
    ({"ids": ["a", "b"]}, "malformed", "position is 1 rows"),
    ({"radius": ...}, "refused", "radius"),
    ({"radius": [0.1, 0.2]}, "malformed", "radius is 2 values"),
    ({"position": b"\0" * 25}, "malformed", "25 bytes"),
    ({"velocity": [[[0, 0, 0]] * 2]}, "refused", "velocity"),
    ({"position": [[1, 2]]}, "malformed", r"shape \(1, 2\)"),
]


@pytest.mark.parametrize(("changes", "kind", "text"), BAD_OBSTACLES)
def test_bad_obstacles_are_named_and_the_verdict_hears_of_them(changes, kind, text):
    world = World()
    world.send(obstacles(seq=17, **changes))
    assert kind in world.kinds()
    line = next(line for line in world.lines if line.startswith(kind))
    assert "cam0 message 17" in line
    assert re.search(text, line)
    assert world.obstacles.take_faults(), "the table must know, so that the verdict is STOP"


def test_good_rows_beside_a_bad_one_are_taken():
    world = World()
    bad = obstacles(ids=["a", "b"], position=[[1, 2, 3], [math.nan, 5, 6]], velocity=...)
    world.send(bad)
    table = world.obstacles.table
    assert table.has_state[world.obstacles.row("a")]
    assert not table.has_state[world.obstacles.row("b")]


def test_infinite_bounds_say_that_there_is_none():
    world = World()
    world.send(obstacles(accel=math.inf, speed=[math.inf], velocity=...))
    assert world.faults.total == 0


def test_more_sources_than_anybody_has_are_refused():
    world = World()
    for number in range(400):
        world.send(obstacles(source=f"made up {number}", ids=[f"id {number}"], seq=...))
    assert world.faults.count("too many sources") == 144
    assert len(world.obstacles) == 256


# Numbers of messages


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


# Joints


def test_joint_names_in_any_order_with_extras():
    world = World()
    world.send(joints())
    state = world.edge.joint_state
    assert state.q.tolist() == [1.0, 2.0]
    assert state.v.tolist() == [0.1, 0.2]
    assert state.stamp == pytest.approx(5.0)
    packed = joints(names=JOINTS, q=np.array([3.0, 4.0]).tobytes(), v=[0.0, 0.0])
    world.send(packed)
    assert world.edge.joint_state.q.tolist() == [3.0, 4.0]
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
    assert world.edge.joint_state is None
    assert world.kinds() == ["malformed"]
    assert "joints message 3" in world.lines[0]
    assert re.search(text, world.lines[0])


def test_an_impossible_joint_state_is_not_hidden_by_a_good_one_after_it():
    world = World()
    world.send(joints(q=[math.nan, 0.0, 1.0]), joints(stamp=MONOTONIC + 5.001))
    assert math.isnan(world.edge.joint_state.q[1])
    assert world.kinds() == ["not finite"]
    world.send(joints(stamp=MONOTONIC + 5.002))
    assert world.edge.joint_state.q.tolist() == [1.0, 2.0]


def test_joint_stamps_that_go_back_are_told():
    world = World()
    world.send(joints(), joints(stamp=MONOTONIC + 4.0))
    assert world.kinds() == ["stamp went back"]


# Resets


def test_a_reset_needs_the_token_of_the_run():
    closed, opened = World(), World(reset_token="sesame")
    for world in (closed, opened):
        world.send({"type": "reset", "token": "open"}, {"type": "reset", "token": ""})
        assert not world.edge.reset_requested
        assert world.faults.count("reset refused") == 2
    closed.send({"type": "reset", "token": "sesame"})
    opened.send({"type": "reset", "token": "sesame"})
    assert not closed.edge.reset_requested
    assert opened.edge.reset_requested


# Faults


def test_one_line_a_second_and_every_fault_counted():
    world = World()
    for tick in range(2500):
        world.clock.sleep_until(5.0 + 0.001 * tick)
        world.send(b"nonsense", b"more of it")
    assert world.faults.total == 5000
    assert len(world.lines) == 3
    assert "(1999 more since the last such line)" in world.lines[1]


def test_made_up_names_fill_neither_log_nor_memory():
    lines = []
    log = FaultLog(lambda: 0.0, lines.append)
    for number in range(5000):
        log.add("lost", f"source {number}\n\x1b[2J" + "x" * 10_000, number, "y" * 10_000)
    assert log.total == 5000
    assert len(log.counts) <= 513
    assert len(lines) <= 513
    assert all(line.isprintable() and len(line) < 700 for line in lines)


# Inputs


def test_work_in_one_drain_is_bounded_and_nothing_is_lost():
    world = World()
    world.input.waiting += [pack(obstacles(seq=n)) for n in range(1000)]
    world.edge.drain([world.input])
    assert 0 < world.edge.received < 200
    for _ in range(100):
        world.edge.drain([world.input])
    assert world.edge.received == 1000
    assert world.faults.total == 0


def test_lines_come_as_they_are_written_and_the_end_is_seen():
    reading, writing = os.pipe()
    lines = LineInput(reading)
    assert lines.receive() is None
    os.write(writing, b'{"a": ')
    assert lines.receive() is None
    os.write(writing, b"1}\n\n  \r\nsecond\nthird without an end")
    assert [lines.receive() for _ in range(3)] == [b'{"a": 1}', b"second", None]
    assert not lines.ended
    os.close(writing)
    assert lines.receive() == b"third without an end"
    assert lines.receive() is None
    assert lines.ended
    os.close(reading)


def test_a_descriptor_that_is_not_open_is_an_error():
    with pytest.raises(Exception, match="cannot be read"):
        LineInput(987)


# Verdicts


VERDICT = Verdict(
    stamp=1.0,
    sequence=7,
    level=Level.SLOW,
    contact_time=math.inf,
    stop_time=0.1,
    speed_scale=0.5,
    link="hand",
    obstacle=None,
    complete=True,
    evaluated=12,
    reasons=(Reason(ReasonKind.CONTACT, "hand and person", "in 0.2 s"),),
    valid_until=1.003,
)


def test_verdicts_survive_the_wire_in_machine_time():
    verdict = decode_verdict(encode_verdict(VERDICT, 1000.0))
    assert verdict._replace(stamp=1.0, valid_until=1.003) == VERDICT
    assert verdict.stamp == 1001.0
    assert 1001.003 - 1e-9 <= verdict.valid_until < 1001.003 + 1e-15


def test_certificates_survive_the_wire():
    proof = Certificate(0.3, np.array([0.0, 0.1]), np.array([[1.0, 0.0, 0.0], [0.6, 0.8, 0.0]]))
    found = decode_verdict(encode_verdict(VERDICT._replace(certificate=proof), 0.0)).certificate
    assert found.contact_time == proof.contact_time
    assert (found.times == proof.times).all()
    assert (found.witnesses == proof.witnesses).all()


@pytest.mark.parametrize("data", [b"", b"\xc0", b"{}", encode(ObstaclesMessage([], 0.0))])
def test_what_is_no_verdict_is_refused(data):
    with pytest.raises(MessageError):
        decode_verdict(data)


def test_a_verdict_of_an_unknown_level_is_refused():
    fields = msgspec.msgpack.decode(encode_verdict(VERDICT, 0.0))
    with pytest.raises(MessageError):
        decode_verdict(msgspec.msgpack.encode({**fields, "level": "GO"}))


def test_the_table_raises_on_malformed_calls_as_the_edge_relies_on():
    with pytest.raises(ObstacleError):
        Obstacles().update(["a"], 0.0, b"\0" * 25, radius=0.1)
