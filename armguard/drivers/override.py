"""Obeys verdicts if the robot accepts a speed override: a number from 0 to 1, repeatedly.

A robot that receives no number must stop by itself. So the number is sent with each verdict, and
repeated until the next one.
"""

from __future__ import annotations

import math

from armguard.drivers.arm import REST_SPEED, OverrideArm
from armguard.drivers.moment import Moment
from armguard.drivers.obedience import Obedience, Order
from armguard.drivers.session import Session

REPEAT = 0.01
"""Between two numbers while no verdict comes, in [s]."""

BRAKE_INTERVAL = 0.5
"""Between two orders to brake while the arm does not stop, in [s]."""


class OverrideConduct:
    """Sends the speed that verdicts allow; see `Conduct`.

    Args:
        arm: The robot.
        session: That it is part of.
    """

    def __init__(self, arm: OverrideArm, session: Session) -> None:
        self._arm = arm
        self._session = session
        self._obedience = Obedience(session.options.validity, session.measurement)
        self._restarts = 0
        self._hold = ""
        """Why no verdict lets the arm move before an acknowledgement; empty: there was none."""
        if not session.options.is_first:
            self._begin_hold("driver")
        self._order = Order(0.0)
        self._sent = 0
        """Number of the verdict by which the speed was sent last."""
        self._next_repeat = self._next_brake = -math.inf
        self._stopped_at = math.inf
        """When the arm was ordered to stop; inf: it was not."""

    def act(self, moment: Moment) -> None:
        """Send the speed; brake by another means if the arm does not obey."""
        now, verdict = moment.now, moment.verdict
        order = self._obey_hold(self._obedience.decide(verdict, now, moment.hindrance))
        number = 0 if verdict is None else verdict.sequence
        if order.scale != self._order.scale or number != self._sent or now >= self._next_repeat:
            self._arm.set_speed(order.scale)
            self._sent, self._next_repeat = number, now + REPEAT
        must_stop = not order.scale > 0.0
        if must_stop and math.isinf(self._stopped_at):
            self._stopped_at = now
            self._session.latencies.add_order(order)
        elif not must_stop:
            self._stopped_at = math.inf
        self._order = order
        says_why = order.cause in ("", "STOP")
        self._arm.report(verdict if says_why else None, order.cause)
        if moment.is_new:
            self._check(moment)

    def _begin_hold(self, restarted: str) -> None:
        hold = (
            f"hold: the {restarted} was restarted; {self._arm.acknowledgement} to let the arm go on"
        )
        if self._arm.acknowledgement and hold != self._hold:
            self._hold = hold
            self._session.link.tell(hold)

    def _obey_hold(self, order: Order) -> Order:
        """The order, or a stop from a restart until somebody acknowledges it.

        An acknowledgement counts only while verdicts permit motion, so that its effect is at once.
        """
        if self._obedience.restarts != self._restarts:
            self._restarts = self._obedience.restarts
            self._begin_hold("monitor")
        elif self._hold and order.scale > 0.0 and self._arm.is_acknowledged:
            self._hold = ""
            self._session.link.tell("acknowledged: the arm may go on")
        return Order(0.0, self._hold) if self._hold and order.scale > 0.0 else order

    def _check(self, moment: Moment) -> None:
        """Check that the arm has stopped in time."""
        now = moment.now
        speed, waited = max(map(abs, moment.state.v)), now - self._stopped_at
        is_in_time = waited <= self._session.options.stop_within
        if speed <= REST_SPEED or is_in_time or now < self._next_brake:
            return
        self._next_brake = now + BRAKE_INTERVAL
        self._session.latencies.counts.hard_stops += 1
        how = "braking it" if self._arm.stop() else "stop it by hand"
        self._session.link.tell(
            f"the arm still moves at {speed:.2g} rad/s {waited:.2g} s after the order to stop: "
            f"{how}"
        )
