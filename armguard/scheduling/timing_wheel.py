"""A timing wheel: holds entries by due time, and returns due ones, the most urgent first.

One slot for each tick to come, so that an entry goes in and comes out in a few nanoseconds however
many there are, and none is moved on the way. Several levels of coarser slots would save memory that
no one needs, and pay for it by moving a whole slot of entries in one tick. What falls due later
than the wheel reaches comes out when it has turned once.

Entries that are due wait in a heap by their deadlines until they are taken out: where not all
can be evaluated, the most urgent are.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from armguard.jit.arrays import FloatArray, IntArray
from armguard.jit.kernels import kernel
from armguard.jit.layout import make_records

Int32Array = NDArray[np.int32]
SLOTS = 2**13
"""Ticks that a wheel reaches: eight seconds at 1 kHz."""

EARLY = 4
"""An entry may come out early by this fraction of its way, so that ticks are loaded alike."""

ABSENT, DUE = -1, -2
"""In place of a slot: an entry is not there at all, or waits in the heap."""

NOBODY = -1
"""In place of an entry."""


class Wheel(NamedTuple):
    """Entries are numbers up to a capacity; each is in one slot, in the heap, or absent."""

    first: Int32Array
    """First entry of each slot. Shape (SLOTS,)."""
    load: Int32Array
    """Entries in each slot. Shape (SLOTS,)."""
    slot: Int32Array
    """Slot of each entry, ABSENT or DUE. Shape (capacity,)."""
    after: Int32Array
    """Next entry in the same slot; in the heap, its place there. Shape (capacity,)."""
    before: Int32Array
    """Previous entry in the same slot. Shape (capacity,)."""
    deadline: FloatArray
    """Of each entry, in any unit: orders the heap. Shape (capacity,)."""
    heap: Int32Array
    """Entries that are due. Shape (capacity,)."""
    numbers: IntArray
    """Entries in the heap, entries in slots, and the tick up to which slots are empty. Shape
    (3,)."""


WAITING, TURNING, TICK = range(3)
"""Places in `Wheel.numbers`."""


def make_wheel(capacity: int) -> Wheel:
    """An empty wheel."""
    first, load = make_records(SLOTS, first=(np.int32, ()), load=(np.int32, ()))
    # Each by itself: what is read of one entry after the other, and of those beside it in a slot,
    # is small enough to stay in the cache, as records of whole entries are not.
    deadline, heap = np.full(capacity, np.inf), np.zeros(capacity, dtype=np.int32)
    slot = np.full(capacity, ABSENT, dtype=np.int32)
    after, before = np.zeros(capacity, dtype=np.int32), np.zeros(capacity, dtype=np.int32)
    first[:] = NOBODY
    numbers = np.zeros(3, dtype=np.int64)
    return Wheel(first, load, slot, after, before, deadline, heap, numbers)


def grow_wheel(wheel: Wheel, capacity: int) -> Wheel:
    """The same wheel with room for more entries."""
    grown = make_wheel(capacity)
    arrays: list[tuple[NDArray[Any], NDArray[Any]]] = list(zip(wheel, grown, strict=True))
    for before, after in arrays:
        after[: len(before)] = before
    return grown


@kernel
def _rise(wheel: Wheel, place: int) -> None:
    """Move an entry of the heap up to where it belongs."""
    heap, key, entry = wheel.heap, wheel.deadline, wheel.heap[place]
    while place > 0:
        parent = (place - 1) // 2
        if key[heap[parent]] <= key[entry]:
            break
        heap[place] = heap[parent]
        wheel.after[heap[place]] = place
        place = parent
    heap[place] = entry
    wheel.after[entry] = place


@kernel
def _sink(wheel: Wheel, place: int) -> None:
    """Move an entry of the heap down to where it belongs."""
    heap, key, entry = wheel.heap, wheel.deadline, wheel.heap[place]
    size = wheel.numbers[WAITING]
    while 2 * place + 1 < size:
        child = 2 * place + 1
        if child + 1 < size and key[heap[child + 1]] < key[heap[child]]:
            child += 1
        if key[entry] <= key[heap[child]]:
            break
        heap[place] = heap[child]
        wheel.after[heap[place]] = place
        place = child
    heap[place] = entry
    wheel.after[entry] = place


@kernel
def make_due(wheel: Wheel, entry: int, deadline: float) -> None:
    """Let an entry, wherever it is, wait in the heap from now on."""
    take_out(wheel, entry)
    place = wheel.numbers[WAITING]
    wheel.numbers[WAITING] += 1
    wheel.heap[place] = entry
    wheel.slot[entry] = DUE
    wheel.deadline[entry] = deadline
    _rise(wheel, place)


@kernel
def take_out(wheel: Wheel, entry: int) -> None:
    """Let go of an entry, wherever it is."""
    slot = wheel.slot[entry]
    if slot == ABSENT:
        return
    wheel.slot[entry] = ABSENT
    if slot == DUE:
        wheel.numbers[WAITING] -= 1
        place = np.int64(wheel.after[entry])
        last = wheel.heap[wheel.numbers[WAITING]]
        if last != entry:
            wheel.heap[place] = last
            wheel.after[last] = place
            _rise(wheel, place)
            _sink(wheel, np.int64(wheel.after[last]))
        return
    after, before = wheel.after[entry], wheel.before[entry]
    if before == NOBODY:
        wheel.first[slot] = after
    else:
        wheel.after[before] = after
    if after != NOBODY:
        wheel.before[after] = before
    wheel.load[slot] -= 1
    wheel.numbers[TURNING] -= 1


@kernel
def most_urgent(wheel: Wheel) -> int:
    """The entry of the heap whose deadline is first; NOBODY if none is due."""
    return wheel.heap[0] if wheel.numbers[WAITING] > 0 else NOBODY


@kernel
def put_off(wheel: Wheel, entry: int, tick: int, deadline: float) -> None:
    """Let an entry, wherever it is, come out at `tick` or a little earlier, but not at once.

    Args:
        wheel: Where it goes.
        entry: Its number.
        tick: By when it is to come out.
        deadline: What orders it in the heap, once it has.
    """
    take_out(wheel, entry)
    now = wheel.numbers[TICK]
    wait = max(min(tick - now, SLOTS - 1), 1)
    # Of three ticks within the last quarter of its wait the one with the least to do.
    early = wait // EARLY
    spread = (entry * 2654435761 + now * 40503) % (early + 1)
    best = (now + wait) % SLOTS
    for candidate in (now + wait - spread, now + wait - early + spread // 2):
        slot = candidate % SLOTS
        if candidate > now and wheel.load[slot] < wheel.load[best]:
            best = slot
    first = wheel.first[best]
    wheel.slot[entry] = best
    wheel.before[entry] = NOBODY
    wheel.after[entry] = first
    if first != NOBODY:
        wheel.before[first] = entry
    wheel.first[best] = entry
    wheel.load[best] += 1
    wheel.numbers[TURNING] += 1
    wheel.deadline[entry] = deadline


@kernel
def turn(wheel: Wheel, tick: int) -> None:
    """Let all entries up to and including `tick` wait in the heap; an earlier tick does nothing."""
    last = wheel.numbers[TICK]
    if tick <= last:
        return
    # After a whole turn every slot has come round, however far the clock jumped.
    for step in range(max(last + 1, tick - SLOTS + 1), tick + 1):
        slot = step % SLOTS
        entry = wheel.first[slot]
        while entry != NOBODY:
            following = wheel.after[entry]
            make_due(wheel, np.int64(entry), wheel.deadline[entry])
            entry = following
    wheel.numbers[TICK] = tick
