"""The stamps of a robot's clock as seconds of this machine's monotonic clock.

A state arrives later than it was measured, by a delay that varies. The least delay so far says how
far apart the two clocks are. The rest of each delay is jitter, which must not get into the stamps:
two states that arrive together were not measured together. Clocks drift apart, so the least delay
may grow, but no faster than clocks do. A stream that lags more and more has older and older stamps.
"""

from __future__ import annotations

import math

from armguard.drivers.arm import ArmLostError

DRIFT = 2e-4
"""By how much two clocks drift apart in a second, in [s], at most: 100 ppm each. Where they drift
faster, stamps are too early, and states count as older than they are."""

LONGEST_DELAY = 1.0
"""Stamps that are off by more, either way, in [s], are not of the same clock."""


class StampFilter:
    """Translates stamps; the stamp of a state is when it would have arrived by the least delay.

    So it is later than the measurement by the least delay, which `latency` of the cell file states.

    Attributes:
        newest: The newest stamp that was translated, in [s] of the robot's clock.
    """

    def __init__(self) -> None:
        self.newest = -math.inf
        self._least, self._arrived = math.inf, math.inf

    def translate(self, stamp: float, arrived: float) -> float:
        """A stamp of the robot's clock in [s] of this machine's; never later than `arrived`.

        Args:
            stamp: Of the robot's clock, in [s].
            arrived: When it was read, in [s] of this machine's monotonic clock.

        Raises:
            ArmLostError: It cannot be of the clock that the ones before were of.
        """
        is_first = math.isinf(self._least)
        fits = is_first or abs(arrived - stamp - self._least) <= LONGEST_DELAY
        if not (stamp > self.newest and fits):
            raise ArmLostError("the robot's clock jumped: it was started anew, or sends nonsense")
        self.newest = stamp
        grown = self._least + DRIFT * max(arrived - self._arrived, 0.0)
        self._least, self._arrived = min(grown, arrived - stamp), arrived
        return stamp + self._least
