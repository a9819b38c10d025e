"""Common parts of all message handlers: table, fault log, clocks, names of arms, numbers."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Mapping

import numpy as np

from armguard.exceptions import ArmguardError
from armguard.messages.incoming import (
    GoalMessage,
    IgnoreMessage,
    JointsMessage,
    MessageError,
    PlanMessage,
    ResetMessage,
    WatchMessage,
)
from armguard.obstacles.obstacles import ObstacleCountError, Obstacles
from armguard.streams.faults import FaultLog
from armguard.streams.stamp_clocks import HELD_UP, StampTimes

ArmMessage = JointsMessage | PlanMessage | GoalMessage | IgnoreMessage | WatchMessage | ResetMessage
"""Messages that say which arm they are about, where there are several."""


class SequenceWatch:
    """Follows the numbers by which one sender counts its messages.

    Args:
        faults: Where it is counted what was lost, or sent by a second sender.
        source: Name of the sender.
    """

    def __init__(self, faults: FaultLog, source: str) -> None:
        self._faults = faults
        self._source = source
        self._last: int | None = None
        self._left: int | None = None

    def follow(self, sequence: int | None) -> None:
        """Take the number of the next message; None where the sender does not count."""
        last = self._last
        if sequence is not None:
            self._last = sequence
        if sequence is None or last is None or sequence == last + 1:
            return
        kind, lost, problem = "two publishers", 1, "and both go on; expected one publisher"
        if self._left is not None and sequence == self._left + 1:
            self._left = last
        elif sequence > last:
            kind, lost = "lost", sequence - last - 1
            problem = f"{lost} messages lost"
        else:
            # The track that was left may be taken up again: then there are two publishers.
            self._left = last
            kind, problem = (
                "sequence went back",
                "the publisher restarted, or there is a second one",
            )
        found = f"seq is {sequence} after {last}: {problem}"
        self._faults.add(kind, self._source, sequence, found, lost)


@dataclasses.dataclass(frozen=True)
class Intake:
    """Common parts of all message handlers."""

    obstacles: Obstacles
    """The table."""
    faults: FaultLog
    """Where faults are counted."""
    times: StampTimes
    """Translates stamps."""

    watched: str = ""
    """Name of the watched arm; empty where there is one. Messages about it name it so."""
    others: Collection[str] = ()
    """Names of the other arms of the cell."""

    def check_arm(self, message: ArmMessage) -> None:
        """Raise MessageError if a message does not name the watched arm as the cell has it."""
        if message.arm != self.watched:
            found = repr(message.arm) if message.arm else "missing"
            known = ", ".join(map(repr, (self.watched, *self.others)))
            expected = f"one of {known}" if self.watched else "none: the cell has one arm"
            raise MessageError("arm", found, expected)

    def tell_verdict(self, error: MessageError) -> None:
        """Let the verdict know of a refused message: what it would have told is not known."""
        problem = f"{error.value}; expected {error.expected}"
        now = self.times.drain_start
        self.obstacles.leave_malformed(error.source, error.field, problem, now)

    def count_refused(self, error: ArmguardError, source: str, sequence: int | None) -> None:
        """Count what the table refused as a whole, which its verdict knows of by itself."""
        kind = "beyond limit" if isinstance(error, ObstacleCountError) else "refused"
        self.faults.add(kind, source, sequence, str(error))

    def count_hold_up(self, gap: float, source: str, sequence: int | None) -> str:
        """Count that clocks were compared too slowly for a joint state or a plan.

        These have no errors of their own that could be widened.

        Args:
            gap: What the stamp may be too old by, in [s]; more than `HELD_UP`.
            source: Whose stamp it is.
            sequence: Number of the message, where it has one.

        Returns:
            The problem in words.
        """
        problem = f"clocks were compared within {gap:.3g} s; expected {HELD_UP:.3g} s at most"
        self.faults.add("clocks held up", source, sequence, problem)
        return problem

    def check_finite(self, source: str, sequence: int | None, named: Mapping[str, object]) -> bool:
        """Count values that are not finite; refusing them is the business of table and monitor.

        Args:
            source: Who sent them.
            sequence: Number of the message, where it has one.
            named: The values, by the names of their fields; None is no value.

        Returns:
            Whether all are finite, bounds apart, which may be infinite.
        """
        usable = True
        for field, values in named.items():
            if values is None:
                continue
            array = np.asarray(values, float)
            # Bounds may be infinite: that says that there is none.
            good = ~np.isnan(array) if field in ("accel", "speed") else np.isfinite(array)
            if good.all():
                continue
            place = np.unravel_index(int(np.argmin(good)), good.shape)
            index = f"[{', '.join(str(int(i)) for i in place)}]" if place else ""
            problem = f"{field}{index} is {array[place]}; expected a finite number"
            self.faults.add("not finite", source, sequence, problem)
            usable = False
        return usable
