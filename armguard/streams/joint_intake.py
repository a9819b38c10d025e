"""Reads joint states of the watched arm, converts their stamps, and drops a backlog."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from armguard.messages.incoming import PACKED, JointsMessage, MessageError, to_values
from armguard.streams.intake import Intake, SequenceWatch
from armguard.streams.stamp_clocks import HELD_UP, StampClock

_PAST_STATES = 1000
"""Joint states that are kept for clouds: of the last second, or somewhat more."""


class JointState(NamedTuple):
    """A joint state in the order of the watched joints, with its stamp in the monitor's time."""

    stamp: float
    q: NDArray[np.float64]
    v: NDArray[np.float64]


class JointOrder:
    """Where an arm's joints are among the names of a message.

    Args:
        joints: Names of the joints, in the order of `q` and `v`.
    """

    def __init__(self, joints: Sequence[str]) -> None:
        self._joints = list(joints)
        self._names: list[str] | None = None
        self._order: NDArray[np.int64] = np.zeros(0, np.int64)
        self._is_own_order = False

    def find(self, names: list[str]) -> NDArray[np.int64]:
        """Where each joint is in `names`; remembered, since senders keep their order. (nv,).

        Raises:
            MessageError: A joint is missing, or named twice.
        """
        if names != self._names:
            missing = [joint for joint in self._joints if names.count(joint) != 1]
            if missing:
                found = "named twice" if missing[0] in names else "missing"
                raise MessageError("names", f"without {missing[0]!r} ({found})", "each joint once")
            self._order = np.array([names.index(joint) for joint in self._joints], np.int64)
            self._is_own_order = names == self._joints
            self._names = names
        return self._order

    def read(self, message: JointsMessage) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Positions and velocities of a joint state, in [rad] or [m] and per [s]. Shapes (nv,).

        Raises:
            MessageError: A joint is missing or named twice, or numbers of values do not fit.
        """
        names, q, v = message.names, message.q, message.v
        order = self._order if names == self._names else self.find(names)
        if self._is_own_order and isinstance(q, bytes) and isinstance(v, bytes):
            size = 8 * len(names)
            if len(q) == size == len(v):
                # Most senders write them so, and every call of NumPy costs as much as all else.
                return np.frombuffer(bytearray(q), PACKED), np.frombuffer(bytearray(v), PACKED)
        count = len(names)
        return to_values("q", q, count)[order], to_values("v", v, count)[order]


class JointIntake:
    """Takes joint states of the watched arm.

    Args:
        intake: Where faults are counted, and times.
        joints: Names of the watched joints, in the order of `q` and `v`.
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
        clock: StampClock,
        timeout: float,
        keeps_past: bool,
    ) -> None:
        self.state: JointState | None = None
        self.dropped_age = math.nan
        self.past: deque[JointState] = deque(maxlen=_PAST_STATES)
        self.has_come = False
        self.order = JointOrder(joints)
        self._intake = intake
        self._clock = clock
        self._timeout = timeout
        self._keeps_past = keeps_past
        self._numbers = SequenceWatch(intake.faults, "joints")
        self._newest: JointState | None = None
        self._is_impossible = False
        self._awaits_fresh = True

    def take(self, message: JointsMessage) -> None:
        """Take a joint state; what cannot be read is counted."""
        intake, sequence = self._intake, message.seq
        self._numbers.follow(sequence)
        try:
            if message.arm != intake.watched:
                intake.check_arm(message)
            q, v = self.order.read(message)
        except MessageError as error:
            intake.faults.add("malformed", "joints", sequence, str(error))
            return
        # Sums of a few numbers are found in less time than NumPy takes to begin; one that is not
        # finite leads to a closer look.
        usable = math.isfinite(message.stamp + sum(q.tolist()) + sum(v.tolist()))
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
        self._is_impossible = False

    def _drop(self, stamp: float, now: float, sequence: int | None) -> None:
        """Count a joint state that waited for the start, or was sent late, in [s]."""
        self.dropped_age = now - stamp
        problem = (
            f"joint state is {self.dropped_age:.3g} s old, expected at most "
            f"{self._timeout:.3g} s; dropped until one is fresh"
        )
        self._intake.faults.add("backlog", "joints", sequence, problem)
