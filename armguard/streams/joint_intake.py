"""Joint states of the watched arm: read, dated, and dropped where they are a backlog."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from armguard.messages.incoming import JointsMessage, MessageError
from armguard.streams.arm_names import ArmNames
from armguard.streams.intake import Intake, is_finite
from armguard.streams.joint_order import JointOrder
from armguard.streams.sequence_watch import SequenceWatch
from armguard.streams.stamp_clocks import HELD_UP, StampClock

_PAST_STATES = 1000
"""Joint states that are kept for clouds: of the last second, or somewhat more."""


class JointState(NamedTuple):
    """The arm's state in the order of the watched joints, stamped in the monitor's time."""

    stamp: float
    q: NDArray[np.float64]
    v: NDArray[np.float64]


class JointIntake:
    """Takes joint states of the watched arm.

    Args:
        intake: Where faults are counted, and times.
        joints: Names of the watched joints, in the order of `q` and `v`.
        arms: The arms of the cell.
        clock: How joint states are stamped; not by arrival.
        timeout: At the start, states older than this, in [s], are dropped.
        keeps_past: Whether past states are kept, for clouds.

    Attributes:
        state: The newest joint state that could be read; None before the first that is fresh.
        dropped_age: How old the last one was that was dropped as a backlog, in [s]; nan: none was.
        past: States of the last second or so, where they are kept.
        has_come: Whether one came since this was last set to False.
    """

    def __init__(
        self,
        intake: Intake,
        joints: Sequence[str],
        arms: ArmNames,
        clock: StampClock,
        timeout: float,
        *,
        keeps_past: bool,
    ) -> None:
        self.state: JointState | None = None
        self.dropped_age = math.nan
        self.past: deque[JointState] = deque(maxlen=_PAST_STATES)
        self.has_come = False
        self.order = JointOrder(joints)
        self._intake = intake
        self._arms = arms
        self._clock = clock
        self._timeout = timeout
        self._keeps_past = keeps_past
        self._watch = SequenceWatch()
        self._newest: JointState | None = None
        self._is_impossible = False
        self._awaits_fresh = True

    def begin_drain(self) -> None:
        """To be called before the messages of a drain are taken."""
        self._is_impossible = False

    def take(self, message: JointsMessage) -> None:
        """Take a joint state; what cannot be read is counted."""
        intake, sequence = self._intake, message.seq
        if faults := self._watch.follow(sequence):
            intake.count_gaps(faults, "joints", sequence)
        try:
            if message.arm != self._arms.watched:
                raise self._arms.refuse(message)
            q, v = self.order.read(message)
        except MessageError as error:
            intake.faults.add("malformed", "joints", sequence, str(error))
            return
        usable = math.isfinite(message.stamp) and is_finite(q) and is_finite(v)
        if not usable:
            named = {"stamp": message.stamp, "q": q, "v": v}
            usable = intake.check_finite("joints", sequence, named)
        stamp, gap = intake.times.translate(message.stamp, self._clock)
        if not gap <= HELD_UP:
            intake.count_hold_up(gap, "joints", sequence)
            return
        self.has_come = True
        if self._awaits_fresh:
            now = intake.times.now()
            if now - stamp > self._timeout:
                self._drop(stamp, now, sequence)
                return
        state, last = JointState(stamp, q, v), self._newest
        if last is not None and stamp < last.stamp:
            problem = f"stamp is {message.stamp!r}, {last.stamp - stamp:.3g} s before the last one"
            intake.faults.add("stamp went back", "joints", sequence, problem)
        if usable and self._keeps_past:
            self.past.append(state)
        # An impossible state must be seen by the monitor, even if a good one follows at once.
        if not self._is_impossible:
            self._newest = state
            self._is_impossible = not usable

    def settle(self, now: float, *, is_emptied: bool, is_reset: bool) -> None:
        """Decide whether the newest joint state is one to go by, or part of a backlog.

        Args:
            now: The present, in [s].
            is_emptied: Whether joint states came in this drain, and nothing waits behind them. In
                the middle of a backlog a first one would leave a gap to the next.
            is_reset: Whether a reset is to be obeyed.
        """
        newest = self._newest
        # What is not finite is no backlog: the monitor refuses it by its name.
        is_stale = newest is not None and now - newest.stamp > self._timeout
        if is_reset and is_stale:
            # The monitor would refuse this state right after its reset; the next one begins anew.
            self._awaits_fresh, self._newest = True, None
        elif self._awaits_fresh and is_emptied and newest is not None:
            if is_stale:
                self._drop(newest.stamp, now, None)
                self._newest = None
            else:
                self._awaits_fresh = False
        self.state = None if self._awaits_fresh else self._newest

    def _drop(self, stamp: float, now: float, sequence: int | None) -> None:
        """Count a joint state that waited for the start, or was sent late, in [s]."""
        self.dropped_age = now - stamp
        problem = (
            f"joint state is {self.dropped_age:.3g} s old, expected at most "
            f"{self._timeout:.3g} s; dropped until one is fresh"
        )
        self._intake.faults.add("backlog", "joints", sequence, problem)
