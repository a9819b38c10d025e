"""The stamps of a robot's clock as seconds of this machine's monotonic clock.

A state arrives after its measurement, with a delay that varies. The least delay so far gives the
offset of the two clocks. The rest of each delay is jitter and must not enter the stamps: two states
that arrive together were not measured together. Clocks drift, so the least delay may grow, but no
faster than the drift. A stream that lags more and more gets older and older stamps.
"""

from __future__ import annotations

import math

from armguard.drivers.arm import ArmLostError

DRIFT = 2e-4
"""By how much two clocks drift apart in a second, in [s], at most: 100 ppm each. Where they drift
faster, stamps are too early, and states count as older than they are."""

LONGEST_DELAY = 1.0
"""Greatest difference of stamps of one clock, either way, in [s]."""


class StampFilter:
    """Translates stamps; the stamp of a state is when it would have arrived by the least delay.

    So the stamp is later than the measurement by the least delay, which `latency` of the cell file
    must cover.

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
            ArmLostError: The stamp cannot be of the same clock as those before.
        """
        is_first = math.isinf(self._least)
        fits = is_first or abs(arrived - stamp - self._least) <= LONGEST_DELAY
        if not (stamp > self.newest and fits):
            raise ArmLostError(
                "the robot's clock jumped: it was restarted, or sends invalid stamps"
            )
        self.newest = stamp
        grown = self._least + DRIFT * max(arrived - self._arrived, 0.0)
        self._least, self._arrived = min(grown, arrived - stamp), arrived
        return stamp + self._least
