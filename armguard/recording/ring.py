"""A ring of bytes in memory that two processes share: one writes, one reads, neither waits.

The writer is a loop that must not wait and may be killed at any moment. The memory lives as long as
either process, so records of a killed writer can still be read. If the reader is too slow, the
writer finds no room and loses records.

A record is its length, a check sum, and its bytes. The check sum makes the order in which a
processor lets another one see its writes irrelevant: a record that is not all there yet is read
again.
"""

from __future__ import annotations

import mmap
import os
import struct
import zlib

import numpy as np

HEADER = 4096
"""Bytes before the first record: a page, in which the counters below are eight bytes each."""

_WRITTEN, _READ, _CLOSED, _BEATS = 0, 8, 16, 24
"""Places of counters in units of eight bytes: so far apart that no two share a cache line."""

_FRAME = struct.Struct("<II")
_GO_ON_AT_START = 0xFFFFFFFF
"""Instead of a length: what follows stands at the start of the ring."""


class Ring:
    """One end of a ring; only one process may write and only one may read.

    Args:
        descriptor: Of the shared memory, as `create_memory` makes it.

    Attributes:
        is_released: Whether the memory was given back.
    """

    def __init__(self, descriptor: int) -> None:
        size = os.fstat(descriptor).st_size
        # Pages are mapped now: one that is met for the first time costs a loop some microseconds.
        self._map = mmap.mmap(descriptor, size, mmap.MAP_SHARED | mmap.MAP_POPULATE)
        self._counters = memoryview(self._map)[:HEADER].cast("Q")
        self.is_released = False
        self._capacity = size - HEADER
        self._written, self._read = (self._counters[place] for place in (_WRITTEN, _READ))
        self._room = 0
        """Bytes after the next place that are free for certain: up to the end of the ring or the
        last known place of the reader. Looking up that place costs more than writing."""

    @property
    def capacity(self) -> int:
        """Bytes that records and their frames may take at one time."""
        return self._capacity

    @property
    def free(self) -> int:
        """Bytes that the reader has given back, as the writer sees it."""
        return self._capacity - (self._written - self._counters[_READ])

    def write(self, data: bytes) -> bool:
        """Write a record; False if there is no room for it."""
        length = _FRAME.size + len(data)
        size = _round_up(length)
        if size > self._room and not self._find_room(size):
            return False
        begin = HEADER + self._written % self._capacity
        _FRAME.pack_into(self._map, begin, len(data), zlib.crc32(data))
        self._map[begin + _FRAME.size : begin + length] = data
        self._room -= size
        self._written += size
        # Only now may the reader know of it.
        self._counters[_WRITTEN] = self._written
        return True

    def _find_room(self, size: int) -> bool:
        """Whether there is room for a record of this size, where it goes being the next place."""
        free, left = self.free, self._capacity - self._written % self._capacity
        if left < size:
            if left + size > free:
                return False
            _FRAME.pack_into(self._map, HEADER + self._capacity - left, _GO_ON_AT_START, 0)
            # The reader will know of it with the record.
            self._written += left
            free, left = free - left, self._capacity
        self._room = min(free, left)
        return size <= self._room

    def read(self) -> bytes | None:
        """The oldest record that was not read yet; None if there is none, or not all of it yet."""
        while True:
            if self.is_empty:
                return None
            place = self._read % self._capacity
            length, checksum = _FRAME.unpack_from(self._map, HEADER + place)
            if length != _GO_ON_AT_START:
                break
            self._give_back(self._capacity - place)
        size = _round_up(_FRAME.size + length)
        if place + size > self._capacity:
            return None
        begin = HEADER + place + _FRAME.size
        data = self._map[begin : begin + length]
        if zlib.crc32(data) != checksum:
            return None
        self._give_back(size)
        return data

    def close_writing(self) -> None:
        """Tell the reader that there will be no more records."""
        self._counters[_CLOSED] = 1

    @property
    def is_empty(self) -> bool:
        """Whether all that came so far was read."""
        return self._read >= self._counters[_WRITTEN]

    @property
    def is_finished(self) -> bool:
        """Whether there will be no more records, and all were read."""
        return bool(self._counters[_CLOSED]) and self.is_empty

    def beat(self) -> None:
        """Give a sign of life, as the reader."""
        self._counters[_BEATS] += 1

    @property
    def beats(self) -> int:
        """Number of signs of life of the reader."""
        return self._counters[_BEATS]

    def release(self) -> None:
        """Release the memory; after that, the ring must not be used. Again is harmless."""
        if not self.is_released:
            self.is_released = True
            self._counters.release()
            self._map.close()

    def _give_back(self, size: int) -> None:
        self._read += size
        self._counters[_READ] = self._read


def create_memory(capacity: int) -> int:
    """Memory for a ring, in RAM from the start; its descriptor is for both processes.

    Args:
        capacity: Bytes of records with their frames, at least.
    """
    descriptor = os.memfd_create("armguard-recording")
    os.ftruncate(descriptor, HEADER + _round_up(capacity))
    with mmap.mmap(descriptor, 0) as memory:
        # Pages are made when they are first written to, which is not to happen in a loop.
        np.frombuffer(memory, np.uint8).fill(0)
    return descriptor


def _round_up(size: int) -> int:
    return (size + 7) & ~7
