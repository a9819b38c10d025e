import os

import numpy as np
import pytest

from armguard.recording.ring import HEADER, Ring, create_memory


@pytest.fixture
def ends():
    """Both ends of a ring of 1000 bytes."""
    memory = create_memory(1000)
    ends = Ring(memory), Ring(memory)
    os.close(memory)
    yield ends
    for end in ends:
        end.release()


def test_what_is_written_is_read_in_order_however_often_the_ring_goes_round(ends):
    writer, reader = ends
    random = np.random.default_rng(0)
    waiting, count = [], 0
    for _ in range(5000):
        data = random.bytes(random.integers(0, 300))
        if random.random() < 0.5:
            if writer.write(data):
                waiting.append(data)
                count += 1
        elif waiting:
            assert reader.read() == waiting.pop(0)
        else:
            assert reader.read() is None
            assert reader.is_empty
    assert count > 1000
    for data in waiting:
        assert reader.read() == data
    assert reader.read() is None


def test_what_finds_no_room_is_not_written_and_nothing_is_overwritten(ends):
    writer, reader = ends
    assert not writer.write(bytes(1001))
    assert writer.write(bytes(900))
    assert not writer.write(bytes(100))
    assert writer.free < 100
    assert reader.read() == bytes(900)
    assert writer.free == writer.capacity
    assert writer.write(b"again")
    assert reader.read() == b"again"


def test_a_record_that_is_not_all_there_is_read_later(ends):
    writer, reader = ends
    writer.write(b"whole")
    place = HEADER + 8
    reader._map[place : place + 1] = b"W"
    assert reader.read() is None
    assert not reader.is_empty
    reader._map[place : place + 1] = b"w"
    assert reader.read() == b"whole"


def test_a_reader_says_that_it_goes_on(ends):
    writer, reader = ends
    reader.beat()
    reader.beat()
    assert writer.beats == 2


def test_the_end_comes_after_all_was_read(ends):
    writer, reader = ends
    writer.write(b"last")
    writer.close_writing()
    assert not reader.is_finished
    reader.read()
    assert reader.is_finished
    reader.release()
    reader.release()
    assert reader.is_released
