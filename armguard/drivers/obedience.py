"""What a verdict lets an arm do, and what nothing but a person may let it do again."""

from __future__ import annotations

import math
from typing import NamedTuple

from armguard.drivers.measurement import Measurement
from armguard.verdict import Level, Verdict


class Order(NamedTuple):
    """What an arm has to do now."""

    scale: float
    """How fast it may go on, from 0 to 1; 0: it must stop."""
    cause: str = ""
    """Why it must stop: "STOP", "no valid verdict", "no verdict yet", or what hinders it; otherwise
    empty."""
    since: float | None = None
    """When the verdict said so, or ceased to be valid, in [s] of the machine's monotonic clock;
    None: no verdict is the cause."""


class Obedience:
    """Follows the verdicts of one monitor.

    Args:
        validity: How long a verdict is valid, as the cell file has it, in [s]: one that claims more
            is not believed.
        measurement: Stops the arm on purpose; None: nothing does.

    Attributes:
        restarts: How often another monitor took the place of the one before. What was latched in
            that one is forgotten, so a person must let the arm go on.
    """

    def __init__(self, validity: float, measurement: Measurement | None = None) -> None:
        self.restarts = 0
        self._validity = validity
        self._measurement = measurement
        self._sequence = 0
        self._verdict: Verdict | None = None
        self._came_at = -math.inf

    def decide(self, verdict: Verdict | None, now: float, hindrance: str = "") -> Order:
        """What the newest verdict orders; a verdict that is not understood orders a stop.

        Args:
            verdict: The newest one; None: there was none.
            now: In [s] of the machine's monotonic clock.
            hindrance: Why the arm must not move, whatever the verdict says; otherwise empty.
        """
        order = self._read(verdict, now)
        if self._measurement is not None and self._measurement.wants_stop(now):
            order = Order(0.0, "measurement")
        if hindrance:
            order = order._replace(scale=0.0, cause=order.cause or hindrance)
        return order

    def _read(self, verdict: Verdict | None, now: float) -> Order:
        if verdict is None:
            return Order(0.0, "no verdict yet")
        if verdict is not self._verdict:
            self._verdict, self._came_at = verdict, now
        if verdict.sequence < self._sequence:
            self.restarts += 1
        self._sequence = verdict.sequence
        begins = verdict.stamp, self._came_at
        ends = verdict.valid_until, *(begin + self._validity for begin in begins)
        if not all(now <= end for end in ends):
            return Order(0.0, "no valid verdict", min(now, *filter(math.isfinite, ends)))
        scale = verdict.speed_scale
        if verdict.level is Level.STOP or not 0.0 < scale <= 1.0:
            return Order(0.0, "STOP", verdict.stamp)
        return Order(scale)
