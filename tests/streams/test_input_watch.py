import time

import pytest

from armguard.streams import FaultLog, Publisher, SocketInput
from armguard.streams.input_watch import InputWatch
from support.stream_messages import Messages, World, obstacles
from support.stream_sockets import PATIENCE, attend


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
