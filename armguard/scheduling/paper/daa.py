"""The Dynamic Awareness Algorithm: evaluates each pair as often as its imminence requires.

Built on [Awareness]_, sections 4 and 5. Pairs stand in an array of places, the most imminent in
front, and the places are parted into buckets that grow towards the end. Each tick visits one place
of every bucket, evaluates the pairs found there, sorts them by contact time and puts them back into
the same places: log2 M evaluations and a short sort for M pairs.

Two things differ from the paper's text. Pairs come and go: a new one stands at the end, a removed
one leaves its place to the last, and both are looked at in the next tick. And a pair that could be
too near before its next visit is flagged (eq. 10, with the stop time added), for somebody else to
scheduler in every tick.

With powers of two as bucket sizes a place only ever meets the same ones before it (slot s of
bucket k meets slot s mod 2^j of bucket j), so that resting contact times end up ordered as a heap.
Neighbouring Fibonacci numbers have no common divisor, all places of two such buckets meet, and the
buckets themselves end up in order.
"""

from __future__ import annotations

from typing import Literal, NamedTuple, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike

from armguard.exceptions import ArmguardError
from armguard.jit.arrays import FloatArray, IntArray
from armguard.jit.kernels import kernel
from armguard.scheduling.paper.arguments import (
    read_contact_times,
    read_pairs,
    refuse_known,
    refuse_settle,
    refuse_unknown,
)
from armguard.scheduling.paper.partition import (
    PartitionLaw,
    compute_places_in_turn,
    compute_ticks_until_turn,
    make_partition,
)

SortLaw: TypeAlias = Literal["partial", "total"]

# Entries of Table.counts.
_PAIRS, _FLAGGED, _QUEUED = 0, 1, 2


class Table(NamedTuple):
    """All that is known of the pairs. A pair keeps its row while it is scheduled.

    `flagged` and `queued` are sets of rows that take and lose a member in constant time: the rows
    side by side, and for each row its index there, -1 if it is not a member.
    """

    pair: IntArray
    """Pair number, by row."""
    place: IntArray
    """Place from 1 on, by row."""
    expiry: FloatArray
    """Evaluation + contact time, in [s] since tick 0, by row. Kept for the total sort only."""
    flag_index: IntArray
    """Index in `flagged`, by row."""
    queue_index: IntArray
    """Index in `queued`, by row."""
    occupant: IntArray
    """Row, by place; place 0 is never used."""
    flagged: IntArray
    """Rows of the flagged pairs."""
    queued: IntArray
    """Rows of the pairs due out of turn."""
    counts: IntArray
    """Number of pairs, of flagged and of queued ones. Shape (3,)."""


@kernel
def _add(members, index, counts, which, row):
    if index[row] < 0:
        index[row] = counts[which]
        members[counts[which]] = row
        counts[which] += 1


@kernel
def _discard(members, index, counts, which, row):
    position = index[row]
    if position >= 0:
        counts[which] -= 1
        last = members[counts[which]]
        members[position] = last
        index[last] = position
        index[row] = -1


@kernel
def _queue(table, rows):
    for row in rows:
        _add(table.queued, table.queue_index, table.counts, _QUEUED, row)


@kernel
def _remove(table, rows):
    """Close each hole with the last pair; that one is due, since its new turn may be far off."""
    for row in rows:
        _discard(table.flagged, table.flag_index, table.counts, _FLAGGED, row)
        _discard(table.queued, table.queue_index, table.counts, _QUEUED, row)
        hole = table.place[row]
        last = table.occupant[table.counts[_PAIRS]]
        table.counts[_PAIRS] -= 1
        if last != row:
            table.occupant[hole] = last
            table.place[last] = hole
            _add(table.queued, table.queue_index, table.counts, _QUEUED, last)


@kernel
def _collect(table, partition, tick, places):
    """Fill `places` with those in turn, ascending, then the queued ones; empty the queue."""
    found = compute_places_in_turn(partition, table.counts[_PAIRS], tick, places)
    for i in range(found):
        row = table.occupant[places[i]]
        _discard(table.queued, table.queue_index, table.counts, _QUEUED, row)
    for i in range(table.counts[_QUEUED]):
        row = table.queued[i]
        table.queue_index[row] = -1
        places[found] = table.place[row]
        found += 1
    table.counts[_QUEUED] = 0
    return found


@kernel
def _put_in_order(table, partition, rows, times, order, places, tick, period, stop_time):
    """Give the ascending `places` to `rows[order]`; flag whom the next visit would find too late.

    `times` are what is left of the contact times at this tick, in [s], row for row.
    """
    bucket = 0
    for i in range(order.size):
        row = rows[order[i]]
        place = places[i]
        table.occupant[place] = row
        table.place[row] = place
        while bucket + 1 < partition.bases.size and partition.bases[bucket + 1] <= place:
            bucket += 1
        wait = compute_ticks_until_turn(
            partition.bases[bucket], partition.sizes[bucket], place, tick
        )
        if times[order[i]] > wait * period + stop_time:
            _discard(table.flagged, table.flag_index, table.counts, _FLAGGED, row)
        else:
            _add(table.flagged, table.flag_index, table.counts, _FLAGGED, row)


def _make_table(capacity: int) -> Table:
    def zeros() -> IntArray:
        return np.zeros(capacity, dtype=np.int64)

    return Table(
        pair=zeros(),
        place=zeros(),
        expiry=np.zeros(capacity),
        flag_index=zeros() - 1,
        queue_index=zeros() - 1,
        occupant=np.zeros(capacity + 1, dtype=np.int64),
        flagged=zeros(),
        queued=zeros(),
        counts=np.zeros(3, dtype=np.int64),
    )


class DaaSchedule:
    """The paper's schedule: one pair of each bucket in a tick.

    Ticks are counted by `due`, from 0 on. Kernels are compiled in the constructor.

    Attributes:
        period: Time between two ticks, in [s].
        law: By which places are parted into buckets.
        sort: How pairs that were evaluated are sorted.
        tick: Number of the present tick; -1 before the first.
    """

    def __init__(
        self, period: float, partition: PartitionLaw = "powers", sort: SortLaw = "partial"
    ) -> None:
        if not (0.0 < period < np.inf):
            raise ArmguardError("period", f"{period} s", expected="a finite time above 0")
        if sort not in get_args(SortLaw):
            raise ArmguardError(
                "sort", f"unknown law {sort!r}", expected=", ".join(get_args(SortLaw))
            )
        self.period = float(period)
        self.law, self.sort = partition, sort
        self._total = sort == "total"
        self._partition = make_partition(partition)
        self._table = _make_table(capacity=64)
        self._rows: dict[int, int] = {}
        self._free = list(range(64))
        self._places = np.zeros(64, dtype=np.int64)
        self._due_rows: IntArray | None = None
        self._compile()
        self.tick = -1

    @property
    def as_data(self) -> dict[str, object]:
        """What it was made with, as plain data."""
        return {"period": self.period, "law": self.law, "sort": self.sort}

    def __len__(self) -> int:
        return len(self._rows)

    def insert(self, pairs: ArrayLike) -> None:
        """Take in new pairs: at the end, and due at the next `due`. Shape (n,)."""
        numbers = read_pairs(pairs)
        for number in numbers.tolist():
            if number in self._rows:
                raise refuse_known(number)
        self._give_back()
        while len(self._free) < numbers.size:
            self._grow()
        taken = [self._free.pop() for _ in range(numbers.size)]
        self._rows.update(zip(numbers.tolist(), taken, strict=True))
        rows = np.array(taken, dtype=np.int64)
        table = self._table
        places = table.counts[_PAIRS] + 1 + np.arange(numbers.size)
        table.pair[rows] = numbers
        table.place[rows] = places
        table.occupant[places] = rows
        table.counts[_PAIRS] += numbers.size
        _queue(table, rows)

    def remove(self, pairs: ArrayLike) -> None:
        """Let go of pairs; those that close the holes are due at the next `due`. Shape (n,)."""
        numbers = read_pairs(pairs)
        rows = self._look_up(numbers)
        self._give_back()
        _remove(self._table, rows)
        for number in numbers.tolist():
            self._free.append(self._rows.pop(number))

    def touch(self, pairs: ArrayLike) -> None:
        """Make pairs due at the next `due`, out of turn. Shape (n,)."""
        rows = self._look_up(read_pairs(pairs))
        self._give_back()
        _queue(self._table, rows)

    def due(self) -> IntArray:
        """Start the next tick: the pairs in turn and those out of turn, by place. Shape (m,)."""
        self._give_back()
        self.tick += 1
        mixed = self._table.counts[_QUEUED] > 0
        found = _collect(self._table, self._partition, self.tick, self._places)
        places = self._places[:found]
        if mixed:
            places.sort()
        self._due_rows = self._table.occupant[places]
        return self._table.pair[self._due_rows]

    def settle(self, contact_times: ArrayLike, stop_time: float) -> None:
        """Sort the pairs that `due` returned into their places, and flag or unflag them.

        With the total sort all pairs are sorted by what is left of their contact times, and all
        flags are judged anew.

        Args:
            contact_times: In [s] from now; NaN counts as 0. Shape (m,).
            stop_time: In [s], the time that a certificate must outlast the next visit by.
        """
        rows = self._due_rows
        if rows is None:
            raise refuse_settle()
        times = read_contact_times(contact_times, rows.size)
        self._due_rows = None
        places = self._places[: rows.size]
        if self._total:
            now = self.tick * self.period
            self._table.expiry[rows] = now + times
            rows = self._table.occupant[1 : len(self) + 1].copy()
            times = self._table.expiry[rows] - now
            places = np.arange(1, len(self) + 1)
        order = np.argsort(times, kind="stable")
        _put_in_order(
            self._table, self._partition, rows, times, order, places,
            self.tick, self.period, float(stop_time),
        )  # fmt: skip

    def flagged(self) -> IntArray:
        """Pairs that might come too near before their next visit. Shape (f,)."""
        return self._table.pair[self._table.flagged[: self._table.counts[_FLAGGED]]]

    def ranking(self) -> IntArray:
        """All pairs in the order of their places. Shape (M,)."""
        return self._table.pair[self._table.occupant[1 : len(self) + 1]]

    def _look_up(self, numbers: IntArray) -> IntArray:
        rows = [self._rows.get(number, -1) for number in numbers.tolist()]
        if -1 in rows:
            raise refuse_unknown(int(numbers[rows.index(-1)]))
        return np.array(rows, dtype=np.int64)

    def _give_back(self) -> None:
        """Queue what was due and never settled, so that no pair loses its turn."""
        if self._due_rows is not None:
            _queue(self._table, self._due_rows)
            self._due_rows = None

    def _grow(self) -> None:
        old, capacity = self._table, self._table.pair.size
        self._table = _make_table(2 * capacity)
        for before, after in zip(old, self._table, strict=True):
            after[: before.size] = before
        self._free.extend(range(capacity, 2 * capacity))
        self._places = np.zeros(2 * capacity, dtype=np.int64)

    def _compile(self) -> None:
        """Run every kernel once on no pairs: the first tick must not wait for a compiler."""
        empty = np.empty(0, dtype=np.int64)
        self.tick = 0
        self.insert(empty)
        self.remove(empty)
        self.settle(np.empty(self.due().size), 0.0)
