"""Obeys verdicts if the robot's own program moves the arm: scales, pauses and resumes it.

Orders are repeated with each joint state. So a slider that a person moves, or a program that a
person starts, is corrected at once.
"""

from __future__ import annotations

import math
from collections import deque

from armguard.drivers.arm import (
    LEAST_SCALE,
    REST_SPEED,
    RESTING,
    ArmLostError,
    ArmState,
    Program,
    ProgramArm,
)
from armguard.drivers.moment import Moment
from armguard.drivers.obedience import Obedience, Order
from armguard.drivers.session import Session

PAUSE_INTERVAL = 0.1
STOP_INTERVAL = 0.5
"""Between two orders to pause, or to stop, while the arm does not obey, in [s]."""

RESUME_DELAY = 0.3
"""How long verdicts must have permitted motion before a paused program continues, in [s]."""


class ProgramConduct:
    """Lets a program run as verdicts allow; see `Conduct`.

    Args:
        arm: Runs the program.
        session: That it is part of.
    """

    def __init__(self, arm: ProgramArm, session: Session) -> None:
        self._arm = arm
        self._session, self._options = session, session.options
        self._obedience = Obedience(session.options.validity, session.measurement)
        # By another number a restart of this driver is noticed as one of the monitor is.
        self._restarts = 0 if session.options.is_first else -1
        self._order = Order(0.0)
        self._ordered_at = self._agreed_at = self._state_at = -math.inf
        self._scales: deque[tuple[float, float]] = deque()
        """Sliders that were ordered within the last `timeout`, and one before, with their times."""
        self._next_pause = self._next_stop = -math.inf
        self._is_pausing = False
        """Whether this driver has paused the program, and may let it continue."""
        self._is_barred = False
        """Whether the program must rest before it may run: only then has a person started it."""

    def act(self, moment: Moment) -> None:
        """Set the slider; pause, resume or stop the program."""
        now, state = moment.now, moment.state
        order = self._obedience.decide(moment.verdict, now, moment.hindrance)
        if 0.0 < order.scale * self._options.speed < LEAST_SCALE:
            # Slower than a program can run.
            order = Order(0.0, "a speed below the least")
        self._bar(state)
        if self._is_barred and order.scale > 0.0:
            order = Order(0.0, "a program that nobody has started")
        if order.scale != self._order.scale or moment.is_new:
            self._arm.scale(self._scale(order))
            self._scales.append((now, self._scale(order)))
        self._note(order, moment)
        if moment.is_new:
            self._confirm(moment)
        if order.scale > 0.0:
            self._resume(moment)
        else:
            self._stop(moment)

    def _scale(self, order: Order) -> float:
        return max(LEAST_SCALE, min(order.scale, 1.0) * self._options.speed)

    def _bar(self, state: ArmState) -> None:
        """Bar a program until it rests after a fault, or a restart of the monitor or this driver.

        A person starts it again.
        """
        is_active = state.program not in RESTING
        if self._obedience.restarts != self._restarts:
            if self._is_pausing or (is_active and not self._is_barred):
                name = "driver" if self._restarts < 0 else "monitor"
                self._session.link.tell(
                    f"the {name} was restarted: the program stays paused until a person starts it"
                )
            self._restarts, self._is_barred = self._obedience.restarts, True
        if self._is_barred or state.trouble:
            self._is_pausing, self._is_barred = False, is_active

    def _note(self, order: Order, moment: Moment) -> None:
        """Note when the order changes."""
        if (order.scale > 0.0) != (self._order.scale > 0.0) or math.isinf(self._ordered_at):
            self._ordered_at = moment.now
            self._session.latencies.add_order(order)
        self._order = order

    def _confirm(self, moment: Moment) -> None:
        """Check that the robot reports a slider between those of late: the library does not."""
        now, scale = moment.now, moment.state.scale
        timeout, tolerance = self._options.timeout, 0.5 * LEAST_SCALE
        was_silent = not now - self._state_at <= timeout
        self._state_at = now
        while len(self._scales) > 1 and now - self._scales[1][0] >= timeout:
            self._scales.popleft()
        ordered = [one for _, one in self._scales]
        if was_silent or min(ordered) - tolerance < scale < max(ordered) + tolerance:
            # What it was told while it was silent, it could not confirm.
            self._agreed_at = now
        elif not now - self._agreed_at <= self._options.longest_silence - timeout:
            raise ArmLostError(
                f"the robot does not take the speed slider: it reports {scale:.3g}, ordered was "
                f"{ordered[-1]:.3g}"
            )

    def _resume(self, moment: Moment) -> None:
        """Let the program continue after a while, if this driver paused it."""
        program = moment.state.program
        is_due = moment.now - self._ordered_at >= RESUME_DELAY
        # One that runs by now has not obeyed, or somebody has started it: who pauses it next is
        # somebody else.
        if program is Program.STOPPED or (is_due and program is Program.RUNNING):
            self._is_pausing = False
        if self._is_pausing and program is Program.PAUSED and is_due:
            self._is_pausing = False
            self._arm.resume()

    def _stop(self, moment: Moment) -> None:
        """Pause a running program; if the arm still moves, stop it by another means."""
        now, state = moment.now, moment.state
        if state.program is Program.RUNNING and now >= self._next_pause:
            self._next_pause = now + PAUSE_INTERVAL
            self._is_pausing = not self._is_barred
            self._arm.pause()
        speed, waited = max(map(abs, state.v)), now - self._ordered_at
        # A program that ignores the pause runs on at the least scale, however slow the arm is.
        is_resting = speed <= REST_SPEED and state.program in RESTING
        if (is_resting or waited <= self._options.stop_within) or now < self._next_stop:
            return
        self._next_stop = now + STOP_INTERVAL
        self._is_pausing = False
        if not self._arm.stop():
            return
        self._session.latencies.counts.hard_stops += 1
        self._session.link.tell(
            f"the arm, at {speed:.2g} rad/s, has not paused {waited:.2g} s after the order: "
            f"stopping it, which ends its program"
        )
