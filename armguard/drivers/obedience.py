"""What a verdict lets an arm do, and what nothing but a person may let it do again."""

from __future__ import annotations

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


class Obedience:
    """Follows the verdicts of one monitor.

    Args:
        measurement: Stops the arm on purpose; None: nothing does.

    Attributes:
        restarts: How often another monitor took the place of the one before. What was latched in
            that one is forgotten, so a person must let the arm go on.
    """

    def __init__(self, measurement: Measurement | None = None) -> None:
        self.restarts = 0
        self._measurement = measurement
        self._sequence = 0

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
        return Order(0.0, order.cause or hindrance) if hindrance else order

    def _read(self, verdict: Verdict | None, now: float) -> Order:
        if verdict is None:
            return Order(0.0, "no verdict yet")
        if verdict.sequence < self._sequence:
            self.restarts += 1
        self._sequence = verdict.sequence
        if not now <= verdict.valid_until:
            return Order(0.0, "no valid verdict")
        scale = verdict.speed_scale
        if verdict.level is Level.STOP or not 0.0 < scale <= 1.0:
            return Order(0.0, "STOP")
        return Order(scale)
