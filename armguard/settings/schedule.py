"""Schedules of pairs: what the monitor asks of each, and their names.

A schedule sees pair numbers and times only: neither arms nor obstacles. That is what lets the world
of the paper and the monitor run on the same code. Each follows `Schedule`; a tick is

    pairs = schedule.due()
    schedule.settle(contact times of exactly these pairs, stop_time)
    watched = schedule.flagged()
"""

from __future__ import annotations

from typing import Literal, Protocol, TypeAlias, runtime_checkable

from numpy.typing import ArrayLike

from armguard.jit.arrays import IntArray

ScheduleName: TypeAlias = Literal["deadline", "full", "daa"]

DEADLINE = "deadline"
"""The monitor's own schedule: it sees obstacles rather than pairs, in one compiled call a tick."""


@runtime_checkable
class Schedule(Protocol):
    """What the monitor asks of every schedule.

    Pair numbers are any non-negative int64, sparse, and may come back after they have left. A
    change between `due` and `settle` gives the unsettled pairs back: the next `due` names them
    again.
    """

    def insert(self, pairs: ArrayLike) -> None:
        """Take in new pairs; all are due at the next `due`. Shape (n,)."""
        ...

    def remove(self, pairs: ArrayLike) -> None:
        """Let go of pairs. Shape (n,)."""
        ...

    def touch(self, pairs: ArrayLike) -> None:
        """Make pairs due at the next `due`, out of turn. Shape (n,)."""
        ...

    def due(self) -> IntArray:
        """Start the next tick: the pairs to evaluate now, each once. Shape (m,)."""
        ...

    def settle(self, contact_times: ArrayLike, stop_time: float) -> None:
        """Take the results for the pairs that `due` returned, in that order.

        Args:
            contact_times: In [s] from now; NaN counts as 0. Shape (m,).
            stop_time: In [s], the time that a certificate must outlast the next visit by.
        """
        ...

    def flagged(self) -> IntArray:
        """Pairs that might come too near before their next visit: watch each tick. Shape (f,)."""
        ...

    def ranking(self) -> IntArray:
        """All pairs, most imminent first, as far as this schedule knows. Shape (M,)."""
        ...
