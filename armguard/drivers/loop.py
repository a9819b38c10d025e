"""The loop of a driver: reads verdicts and commands, publishes joint states, sends orders.

One thread. Each new state is answered at once, by the newest verdict. Without a new state, the loop
wakes for each verdict and each millisecond, so it gives an order as soon as a verdict arrives or
expires.
"""

from __future__ import annotations

import math
import os
import signal
import time
from collections.abc import Sequence
from typing import TypeVar

from armguard.drivers.arm import Arm, ArmLostError, ArmState
from armguard.drivers.link import DRIVING
from armguard.drivers.moment import Conduct, Moment
from armguard.drivers.session import Session
from armguard.messages.command import CommandMessage
from armguard.streams.nodes import Publisher, VerdictReader
from armguard.verdict import Verdict

_Heard = TypeVar("_Heard", Verdict, CommandMessage)

WAIT = 0.001
"""How long the loop waits for a verdict, in [s]: by so much later it notices that one expired."""

REPORTED_EXCESS = 1e-6
"""A verdict that claims to be valid for this much longer than the cell file says is reported, in
[s]. It counts no longer all the same."""

LONGEST_TURN = 2.0
"""How long a turn may take beyond the longest silence, in [s]."""

BEAT = 0.05
"""Between two signs of life, in [s]; not more than `timeout`."""


class DriveLoop:
    """Drives an arm by the verdicts of one monitor or the commands of one shield.

    Args:
        arm: Connected.
        conduct: Gives orders to the arm.
        session: That it is part of.
        publishers: Take its states, each to a monitor.
        reader: Has verdicts and commands.
    """

    def __init__(
        self,
        arm: Arm,
        conduct: Conduct,
        session: Session,
        publishers: Sequence[Publisher],
        reader: VerdictReader,
    ) -> None:
        self._arm = arm
        self._conduct = conduct
        self._publishers = publishers
        self._reader = reader
        self._options, self._latencies, self._link, self._measurement = session
        self._state: ArmState | None = None
        self._verdict: Verdict | None = None
        self._read_at = time.monotonic()
        self._next_beat = -math.inf
        self._trouble = ""
        self._other_arm: str | None = None
        self._is_silent = self._has_doubted = False

    def run(self) -> None:
        """Drive until the measurement is done, if there is one.

        Raises:
            ArmLostError: The arm can no longer be driven.
            KeyboardInterrupt: The parent process has ended.
        """
        while self._measurement is None or not self._measurement.is_done:
            self.turn()

    def turn(self) -> None:
        """Read the arm, or wait briefly for a verdict, and act.

        Raises:
            ArmLostError: The arm can no longer be driven.
        """
        # From one turn to the next the system ends this process, unless it is in time: the robot's
        # library may wait without end, and what watches may have ended as well.
        signal.setitimer(signal.ITIMER_REAL, LONGEST_TURN + self._options.longest_silence)
        state = self._arm.read()
        heard = self._reader.latest(WAIT if state is None else 0.0)
        verdict, command = self._keep_own(heard), self._keep_own(self._reader.command)
        now = time.monotonic()
        self._note_other_arm(heard if verdict is None else None)
        if verdict is not None and verdict is not self._verdict:
            self._take_verdict(verdict)
        if state is not None:
            self._take(state, now)
        silence = now - self._read_at
        if not (self._arm.comes_back or silence <= self._options.longest_silence):
            raise ArmLostError(f"the robot has sent no state for {silence:.2g} s")
        if self._state is not None:
            is_silent = not silence <= self._options.timeout
            if is_silent != self._is_silent:
                self._is_silent = is_silent
                self._link.tell(
                    "the robot is silent" if is_silent else "the robot sends states again"
                )
            hindrance = self._trouble or ("the robot is silent" if is_silent else "")
            self._conduct.act(
                Moment(now, verdict, command, self._state, state is not None, hindrance)
            )
        if now >= self._next_beat:
            self._report(now)

    def _keep_own(self, heard: _Heard | None) -> _Heard | None:
        """What the monitor of this arm has said; None for what is said to another arm."""
        return heard if heard is not None and heard.arm == self._options.arm else None

    def _note_other_arm(self, verdict: Verdict | None) -> None:
        """Report verdicts for another arm once; None: there are none now."""
        other = None if verdict is None else verdict.arm
        if other is not None and other != self._other_arm:
            self._link.tell(
                f"verdicts at {self._options.verdicts} are for arm {other!r}, expected "
                f"{self._options.arm!r}, and count as none: state the address of its own monitor "
                "by --verdicts"
            )
        self._other_arm = other

    def _take_verdict(self, verdict: Verdict) -> None:
        """Count a verdict, and report one that claims to be valid for too long."""
        self._latencies.counts.verdicts += 1
        self._verdict = verdict
        claimed, agreed = verdict.valid_until - verdict.stamp, self._options.validity
        if not (claimed <= agreed + REPORTED_EXCESS or self._has_doubted):
            self._has_doubted = True
            self._link.tell(
                f"verdicts claim to be valid for {1e3 * claimed:.3g} ms; the cell file has "
                f"{1e3 * agreed:.3g} ms, which is used: start the monitor with the same file"
            )

    def _take(self, state: ArmState, now: float) -> None:
        """Publish a state, and report problems of the robot."""
        if not all(map(math.isfinite, [*state.q, *state.v, state.stamp])):
            raise ArmLostError("the robot has sent a joint state that is not finite")
        for publisher in self._publishers:
            publisher.joints(state.stamp, self._options.names, state.q, state.v, self._options.arm)
        self._latencies.add_state(state.stamp, time.monotonic())
        self._state, self._read_at = state, now
        if self._measurement is not None:
            self._measurement.add(now, state)
        if state.trouble != self._trouble:
            self._link.tell(state.trouble or "the robot can be driven again")
            self._trouble = state.trouble

    def _report(self, now: float) -> None:
        """Send signs of life, and a line each second."""
        self._next_beat = now + min(BEAT, self._options.timeout)
        if self._options.parent and os.getppid() != self._options.parent:
            raise KeyboardInterrupt
        self._link.send(DRIVING)
        line = self._latencies.make_line(now, self._state, self._verdict)
        if line:
            self._link.count(self._latencies.counts)
            self._link.tell(line)
