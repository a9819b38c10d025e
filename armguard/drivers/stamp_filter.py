"""The stamps of a robot's clock as seconds of this machine's monotonic clock.

A state arrives later than it was measured, by a delay that varies. The least delay of the last
seconds says how far apart the two clocks are; the rest of each delay is jitter, which must not get
into the stamps: two states that arrive together were not measured together.
"""

from __future__ import annotations

import math

WINDOW = 5.0
"""For so long, in [s], a least delay counts at least, and for twice as long at most: within it two
clocks of 100 ppm drift apart by 1 ms at most."""

LONGEST_DELAY = 1.0
"""Stamps that are off by more, either way, in [s], are not of the same clock."""


class StampFilter:
    """Translates stamps; the stamp of a state is when it would have arrived by the least delay.

    So it is later than the measurement by the least delay, which `latency` of the cell file states.
    """

    def __init__(self) -> None:
        self._since = -math.inf
        self._least = self._least_before = math.inf

    def fits(self, stamp: float, arrived: float) -> bool:
        """Whether a stamp can be of the clock that the ones before were of."""
        least = min(self._least, self._least_before)
        return math.isinf(least) or abs(arrived - stamp - least) <= LONGEST_DELAY

    def translate(self, stamp: float, arrived: float) -> float:
        """A stamp of the robot's clock in [s] of this machine's; never later than `arrived`.

        Args:
            stamp: Of the robot's clock, in [s].
            arrived: When it was read, in [s] of this machine's monotonic clock.
        """
        if not arrived < self._since + WINDOW:
            self._since = arrived
            self._least_before, self._least = self._least, math.inf
        self._least = min(self._least, arrived - stamp)
        return stamp + min(self._least, self._least_before)
