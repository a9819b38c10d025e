import json
import os
import time

import pytest
import zmq

from armguard.messages.incoming import MessageError, decode
from armguard.streams import FaultLog, LineInput, Publisher, SocketInput
from armguard.streams.inputs import BYTE_LIMIT, WAITING_BYTES, InputWatch
from support.stream_messages import Messages, World, obstacles
from support.stream_sockets import PATIENCE, attend


@pytest.fixture
def raw():
    """Makes plain publishing sockets, as a foreign program would."""
    publishers = []

    def connect(source):
        publisher = zmq.Context.instance().socket(zmq.XPUB)
        publishers.append(publisher)
        publisher.connect(source.address)
        attend(source, lambda: publisher.poll(1))
        return publisher

    yield connect
    for publisher in publishers:
        publisher.close(linger=0)


def receive(source):
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        data = source.receive()
        if data is not None:
            return data
        time.sleep(0.001)
    pytest.fail("nothing came")


def test_messages_in_parts_or_too_long_are_refused_and_the_next_is_taken(address, raw):
    source = SocketInput(address)
    publisher = raw(source)
    publisher.send_multipart([b"topic", b"message", b"more"])
    publisher.send(b"x" * (BYTE_LIMIT + 1))
    publisher.send(b"good")
    found = []
    while b"good" not in found:
        try:
            found.append(receive(source))
        except MessageError as error:
            found.append(error.field + " is " + error.value)
    source.close()
    assert found == ["message is in several parts"] * 3 + [
        f"message is {BYTE_LIMIT + 1} bytes long",
        b"good",
    ]


def test_what_waits_takes_bounded_memory_and_nothing_is_lost(address):
    """What the input has no room for waits at its sender."""
    source = SocketInput(address)
    limits = [source._socket.get(option) for option in (zmq.RCVHWM, zmq.MAXMSGSIZE)]
    assert 0 < limits[0] * limits[1] <= WAITING_BYTES
    assert limits[1] > BYTE_LIMIT
    with Publisher(source.address, "cam0") as publisher:
        attend(source, lambda: publisher.wait(0.0))
        for number in range(3000):
            publisher.update([f"{number}"], 0.0, [[1.0, 0.0, 0.0]], radius=0.1)
        time.sleep(0.1)
        found = [decode(receive(source)).ids for _ in range(3000)]
    source.close()
    assert found == [[f"{number}"] for number in range(3000)]


def test_inputs_may_be_opened_right_after_others_were_closed(tmp_path):
    for _ in range(50):
        SocketInput(f"ipc://{tmp_path / 'in'}").close()


def test_more_connections_than_may_be_are_not_taken_until_one_ends(address, raw):
    """Those that are there go on; the one too many is counted, and gets in once there is room."""
    source, world = SocketInput(address, connections=2), World()

    def wait_for(condition):
        end = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < end, "it never came to that"
            world.edge.drain([source])
            time.sleep(0.001)

    first, second = raw(source), raw(source)
    wait_for(lambda: source.connections == 2)
    third = zmq.Context.instance().socket(zmq.XPUB)
    third.set(zmq.RECONNECT_IVL, 5)
    third.connect(source.address)
    try:
        # It tries again and again.
        wait_for(lambda: world.faults.count("connections") >= 3)
        before = world.edge.received
        first.send(json.dumps(obstacles()).encode())
        wait_for(lambda: world.edge.received > before)
        second.close(linger=0)
        wait_for(lambda: source.connections == 2)

        def is_heard():
            third.send(json.dumps(obstacles()).encode())
            return world.edge.received > before + 10

        wait_for(is_heard)
        ended = world.faults.count("connections")
        wait_for(is_heard)
        assert world.faults.count("connections") == ended, "there is room for it"
    finally:
        third.close(linger=0)
        source.close()


def test_an_input_without_messages_does_not_wait(address):
    source = SocketInput(address)
    assert source.receive() is None
    source.close()


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


@pytest.mark.parametrize("vain", [b"\n" * 5000, b"x" * (4 * BYTE_LIMIT) + b"\n"])
def test_a_call_takes_a_bounded_time_where_nothing_but_vain_lines_come(vain, tmp_path):
    (tmp_path / "lines").write_bytes(vain + b"message\n")
    with (tmp_path / "lines").open("rb") as file:
        lines, refused = LineInput(file.fileno()), 0
        while True:
            try:
                line = lines.receive()
                break
            except MessageError:
                refused += 1
    assert line == b"message"
    assert refused >= 3


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


@pytest.fixture
def watch():
    return InputWatch(FaultLog(time.monotonic, lambda line: None))


@pytest.fixture
def source(address):
    source = SocketInput(address)
    yield source
    source.close()


def wait_until_unread(watch, inputs, source):
    end = time.monotonic() + PATIENCE
    while not source.is_unread:
        watch.attend(inputs)
        assert time.monotonic() < end
        time.sleep(0.001)


def empty(source):
    while source.receive() is not None:
        pass


def test_a_socket_counts_as_unread_until_it_is_found_empty_and_from_the_next_message_on(
    watch, source
):
    inputs = [Messages(), source]
    assert source.is_unread
    with Publisher(source.address, "camera") as publisher:
        attend(source, lambda: publisher.wait(0.001))
        assert source.receive() is None
        for _ in range(100):
            watch.attend(inputs)
        assert not source.is_unread
        for number in range(20):
            publisher.remove([str(number)], 0.0)
            wait_until_unread(watch, inputs, source)
            empty(source)
            assert not source.is_unread


def test_what_is_left_unread_needs_no_further_signal(watch, source):
    """The descriptor tells of nothing that was there when messages were last taken."""
    count = 50
    with Publisher(source.address, "camera") as publisher:
        attend(source, lambda: publisher.wait(0.001))
        assert source.receive() is None
        for number in range(count):
            publisher.remove([str(number)], 0.0)
        taken = 0
        end = time.monotonic() + PATIENCE
        while taken < count:
            watch.attend([source])
            if source.is_unread and source.receive() is not None:
                taken += 1
            assert time.monotonic() < end
        assert source.receive() is None
        assert not source.is_unread


def test_nothing_is_lost_between_drains_however_messages_fall_between_them(source):
    world = World()
    count = 500
    with Publisher(source.address, "cam0") as publisher:
        attend(source, lambda: publisher.wait(0.001))
        sent, drains, end = 0, 0, time.monotonic() + PATIENCE
        while world.edge.received < count:
            for _ in range(min(drains % 4, count - sent)):
                publisher.remove([str(sent)], 0.0)
                sent += 1
            drains += 1
            world.edge.drain([source])
            assert time.monotonic() < end
    assert world.faults.count("lost") == 0


def test_inputs_may_change_from_call_to_call(watch, source, tmp_path):
    other = SocketInput(f"ipc://{tmp_path}/other")
    try:
        watch.attend([source, other])
        for one in (source, other):
            empty(one)
            assert not one.is_unread
        with Publisher(other.address, "camera") as publisher:
            attend(other, lambda: publisher.wait(0.001))
            empty(other)
            publisher.remove(["a"], 0.0)
            watch.attend([source])
            assert not other.is_unread
            wait_until_unread(watch, [other], other)
    finally:
        other.close()


def test_inputs_without_a_descriptor_are_always_asked():
    world = World()
    for number in range(3):
        world.send(obstacles(seq=number))
    assert world.edge.received == 3
