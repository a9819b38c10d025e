"""Evaluates every pair in every tick, by contact time (full-DAA) or by distance alone (full-DF).

The two references of [Awareness]_: nothing is missed and nothing is saved. By distance is what is
usually done: the nearest pair first, whichever way it moves. Here they differ only in what they are
given. The ranking is made only when it is asked for, since the verdict needs the smallest time and
not the order.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from armguard.jit.arrays import FloatArray, IntArray
from armguard.scheduling.paper.arguments import (
    read_contact_times,
    read_pairs,
    refuse_known,
    refuse_settle,
    refuse_unknown,
)


class FullSchedule:
    """All pairs are due, none is ever flagged."""

    as_data = "full"
    """What it was made with, as plain data: the word of the setting."""

    def __init__(self) -> None:
        self._contact_times: FloatArray = np.empty(0)
        self._settled: IntArray = np.empty(0, dtype=np.int64)
        self._change(self._settled)

    def __len__(self) -> int:
        return self._numbers.size

    def insert(self, pairs: ArrayLike) -> None:
        """Take in new pairs. Shape (n,)."""
        numbers = read_pairs(pairs)
        for number in numbers[np.isin(numbers, self._numbers)].tolist():
            raise refuse_known(number)
        self._change(np.concatenate([self._numbers, numbers]))

    def remove(self, pairs: ArrayLike) -> None:
        """Let go of pairs. Shape (n,)."""
        self._change(self._numbers[~np.isin(self._numbers, self._read_members(pairs))])

    def touch(self, pairs: ArrayLike) -> None:
        """Nothing to do, as every pair is due anyway. Shape (n,)."""
        self._read_members(pairs)
        self._awaiting = False

    def due(self) -> IntArray:
        """All pairs, in the order in which they came; read-only. Shape (M,)."""
        self._awaiting = True
        return self._numbers

    def settle(self, contact_times: ArrayLike, stop_time: float) -> None:
        """Take the results for all pairs.

        Args:
            contact_times: In [s], or whatever else pairs are ranked by. Shape (M,).
            stop_time: In [s]. Without meaning here: every pair is looked at again next tick.
        """
        if not self._awaiting:
            raise refuse_settle()
        self._contact_times = read_contact_times(contact_times, self._numbers.size)
        self._settled = self._numbers
        self._awaiting = False

    def flagged(self) -> IntArray:
        """None. Shape (0,)."""
        return np.empty(0, dtype=np.int64)

    def ranking(self) -> IntArray:
        """All pairs by their last results, most imminent first; new ones at the end. Shape (M,)."""
        order = self._settled[np.argsort(self._contact_times, kind="stable")]
        if self._settled is self._numbers:
            return order
        new = self._numbers[~np.isin(self._numbers, order)]
        return np.concatenate([order[np.isin(order, self._numbers)], new])

    def _read_members(self, pairs: ArrayLike) -> IntArray:
        numbers = read_pairs(pairs)
        for number in numbers[~np.isin(numbers, self._numbers)].tolist():
            raise refuse_unknown(number)
        return numbers

    def _change(self, numbers: IntArray) -> None:
        self._numbers = numbers
        self._numbers.flags.writeable = False
        self._awaiting = False
