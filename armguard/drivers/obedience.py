"""What a verdict permits, and what only a person may permit again."""

from __future__ import annotations

import math
from typing import NamedTuple

from armguard.drivers.measurement import Measurement
from armguard.verdict import Level, Verdict


class Order(NamedTuple):
    """The present order to an arm."""

    scale: float
    """Permitted fraction of its speed, from 0 to 1; 0: it must stop."""
    cause: str = ""
    """Why it must stop: "STOP", "no valid verdict", "no verdict yet", or the hindrance; otherwise
    empty."""
    since: float | None = None
    """Time of the verdict or of its expiry, in [s] of the machine's monotonic clock; None: no
    verdict is the cause."""


class Obedience:
    """Follows the verdicts of one monitor.

    Args:
        validity: How long a verdict is valid by the cell file, in [s]: a longer claim is ignored.
        measurement: Stops the arm on purpose; None: no measurement.

    Attributes:
        restarts: How often another monitor replaced the one before. Its latched STOPs are lost, so
            a person must let the arm continue.
    """

    def __init__(self, validity: float, measurement: Measurement | None = None) -> None:
        self.restarts = 0
        self._validity = validity
        self._measurement = measurement
        self._verdict: Verdict | None = None
        self._came_at = -math.inf

    def decide(self, verdict: Verdict | None, now: float, hindrance: str = "") -> Order:
        """The order of the newest verdict; a verdict that cannot be interpreted orders a stop.

        Args:
            verdict: The newest one; None: there was none.
            now: In [s] of the machine's monotonic clock.
            hindrance: Why the arm must not move under any verdict; otherwise empty.
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
            if self._verdict is not None:
                # Without the name of its run, each verdict can be that of another monitor.
                self.restarts += verdict.run != self._verdict.run or not verdict.run
            self._verdict, self._came_at = verdict, now
        begins = verdict.stamp, self._came_at
        ends = verdict.valid_until, *(begin + self._validity for begin in begins)
        if not all(now <= end for end in ends):
            return Order(0.0, "no valid verdict", min(now, *filter(math.isfinite, ends)))
        scale = verdict.speed_scale
        if verdict.level is Level.STOP or not 0.0 < scale <= 1.0:
            return Order(0.0, "STOP", verdict.stamp)
        return Order(scale)
