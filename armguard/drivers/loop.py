"""The loop of a driver: read a verdict, order what it allows, publish the joint states.

One thread. It wakes for each verdict, and each millisecond without one, so that an order is given
as soon as a verdict has arrived or has expired. What it orders is repeated with each joint state:
a slider that somebody else moves, or a program that somebody starts, is set right at once.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable
from typing import NamedTuple

from armguard.drivers.arm import Arm, ArmLostError, ArmState, Program
from armguard.drivers.latencies import Latencies
from armguard.drivers.link import DRIVING, Link
from armguard.drivers.measurement import Measurement
from armguard.drivers.obedience import Obedience, Order
from armguard.streams.nodes import Publisher, VerdictReader
from armguard.verdict import Verdict

WAIT = 0.001
"""How long the loop waits for a verdict, in [s]: by so much later it notices that one expired."""

SMALLEST_SCALE = 0.01
"""What the slider is set to for a stop: 0 makes real controllers stop protectively."""

STATE_TIMEOUT = 0.1
"""Silence of the robot after which it counts as lost, in [s]."""

CONFIRM_TIMEOUT = 0.25
"""How long the robot's own word may differ from what it was told, in [s]."""

REST_SPEED = 0.01
"""What joints at rest do not exceed, in [rad/s]."""

PAUSE_INTERVAL = 0.1
STOP_INTERVAL = 0.5
"""Between two orders to pause, or to stop, while the arm does not obey, in [s]."""

RESUME_DELAY = 0.3
"""How long verdicts must have allowed motion before a paused program goes on, in [s]."""

BEAT = 0.05
"""Between two signs of life, in [s]."""


class Limits(NamedTuple):
    """How a driver drives."""

    speed: float = 1.0
    """Fraction of its speed that the program gets where nothing is near."""
    stop_within: float = 1.0
    """How long the arm may still move after it was told to pause, in [s]."""
    parent: int = 0
    """Process whose end is this one's; 0: none is."""


class DriveLoop:
    """Drives an arm by the verdicts of one monitor, until something ends it.

    Args:
        arm: Connected.
        names: Of its joints, in the order of its states.
        publisher: Takes its states.
        reader: Has the verdicts.
        latencies: Counts what is done.
        link: To the process that watches.
        limits: How to drive.
        arm_name: Which of several arms it is.
        measurement: Stops the arm on purpose; None: nothing does.
    """

    def __init__(
        self,
        arm: Arm,
        names: tuple[str, ...],
        publisher: Publisher,
        reader: VerdictReader,
        latencies: Latencies,
        link: Link,
        limits: Limits,
        *,
        arm_name: str = "",
        measurement: Measurement | None = None,
    ) -> None:
        self._arm = arm
        self._publish: Callable[[ArmState], None] = lambda state: publisher.joints(
            state.stamp, names, state.q, state.v, arm_name
        )
        self._reader = reader
        self._obedience = Obedience()
        self._restarts = 0
        self._latencies = latencies
        self._link = link
        self._limits = limits
        self._measurement = measurement
        self._state: ArmState | None = None
        self._verdict: Verdict | None = None
        self._read_at = time.monotonic()
        self._order = Order(0.0, "")
        self._ordered_at = self._agreed_at = self._read_at
        self._next_pause = self._next_stop = self._next_beat = -math.inf
        self._is_pausing = False
        """Whether this loop has paused the program, and may let it go on."""
        self._trouble = ""

    def run(self) -> None:
        """Drive until the measurement is done, if there is one.

        Raises:
            ArmLostError: The arm cannot be driven any more.
            KeyboardInterrupt: What started this process has ended.
        """
        while self._measurement is None or not self._measurement.is_done:
            self.turn()

    def turn(self) -> None:
        """Wait for a verdict for a moment, and do what is to be done.

        Raises:
            ArmLostError: The arm cannot be driven any more.
        """
        verdict = self._reader.latest(WAIT)
        now = time.monotonic()
        self._latencies.counts.verdicts += verdict is not self._verdict
        self._verdict = verdict
        order = self._obedience.decide(verdict, now)
        if self._measurement is not None and self._measurement.wants_stop(now):
            order = Order(0.0, "measurement")
        state = self._arm.read()
        if state is not None:
            self._take(state, now)
        elif not now - self._read_at <= STATE_TIMEOUT:
            raise ArmLostError(f"the robot has sent no state for {STATE_TIMEOUT:g} s")
        if self._trouble:
            order = Order(0.0, order.cause or "trouble")
        if order.scale != self._order.scale or state is not None:
            self._arm.scale(self._scale(order))
        self._follow(order, now)
        if self._state is not None:
            self._make_sure(order, self._state, now)
        if now >= self._next_beat:
            self._report(now)

    def _scale(self, order: Order) -> float:
        return max(SMALLEST_SCALE, min(order.scale, 1.0) * self._limits.speed)

    def _take(self, state: ArmState, now: float) -> None:
        """Publish a state, and tell of what is wrong with the robot."""
        if not all(map(math.isfinite, [*state.q, *state.v, state.stamp])):
            raise ArmLostError("the robot has sent a joint state that is not finite")
        self._publish(state)
        self._latencies.add_state(state.stamp, time.monotonic())
        self._state, self._read_at = state, now
        if self._measurement is not None:
            self._measurement.add(now, state)
        if state.trouble != self._trouble:
            self._link.tell(state.trouble or "the robot can be driven again")
            self._is_pausing = self._is_pausing and not state.trouble
            self._trouble = state.trouble

    def _follow(self, order: Order, now: float) -> None:
        """Note when what is ordered changes, and tell of a monitor that was started anew."""
        if self._obedience.restarts != self._restarts:
            self._restarts = self._obedience.restarts
            if self._is_pausing:
                self._link.tell(
                    "the monitor was started anew: the program stays paused until it is started "
                    "on the robot"
                )
            self._is_pausing = False
        if (order.scale > 0.0) != (self._order.scale > 0.0):
            self._ordered_at = now
            self._agreed_at = now
            if order.cause in ("STOP", "no valid verdict"):
                verdict = self._verdict
                assert verdict is not None  # it has expired, or says STOP
                was_silent = order.cause != "STOP"
                since = verdict.valid_until if was_silent else verdict.stamp
                self._latencies.add_stop(time.monotonic() - since, was_silent=was_silent)
        self._order = order

    def _make_sure(self, order: Order, state: ArmState, now: float) -> None:
        """See that the arm does what it was told; if not, tell it again, by another way at last."""
        if abs(state.scale - self._scale(order)) < 0.5 * SMALLEST_SCALE:
            self._agreed_at = now
        elif not now - self._agreed_at <= CONFIRM_TIMEOUT:
            raise ArmLostError(
                f"the robot does not take the speed slider: it says {state.scale:.3g}, and was "
                f"told {self._scale(order):.3g}"
            )
        running = state.program is Program.RUNNING
        if order.scale > 0.0:
            if self._is_pausing and state.program is Program.STOPPED:
                self._is_pausing = False
            if (
                self._is_pausing
                and state.program is Program.PAUSED
                and now - self._ordered_at >= RESUME_DELAY
            ):
                self._is_pausing = False
                self._arm.resume()
            return
        if running and now >= self._next_pause:
            self._next_pause = now + PAUSE_INTERVAL
            # What a fault has stopped, a person starts again.
            self._is_pausing = not self._trouble
            self._arm.pause()
        speed, waited = max(map(abs, state.v)), now - self._ordered_at
        is_resting = speed <= REST_SPEED
        if not (is_resting or waited <= self._limits.stop_within) and now >= self._next_stop:
            self._next_stop = now + STOP_INTERVAL
            self._is_pausing = False
            self._latencies.counts.hard_stops += 1
            self._link.tell(
                f"the arm still moves at {speed:.2g} rad/s {waited:.2g} s after it was told to "
                "pause: stopping it, which ends its program"
            )
            self._arm.stop()

    def _report(self, now: float) -> None:
        """A sign of life, and a line a second."""
        self._next_beat = now + BEAT
        if self._limits.parent and os.getppid() != self._limits.parent:
            raise KeyboardInterrupt
        self._link.send(DRIVING)
        line = self._latencies.make_line(now, self._state, self._verdict)
        if line:
            self._link.count(self._latencies.counts)
            self._link.tell(line)
