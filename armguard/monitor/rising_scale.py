"""A speed scale that falls at once and rises slowly, so that an arm that obeys it moves smoothly.

What can be proved of an arm jumps with each sample of an obstacle, and with the arm's own speed: a
slower arm may go faster, and a faster one may not. An arm that followed each jump would speed up
and slow down many times a second. A lower scale than a proved one needs no proof: an arm that keeps
to it keeps to the proved one as well.
"""

from __future__ import annotations

import math

STEADY_SHARE = 0.85
"""Up to which share of the scale that was proved no longer it rises again at first."""

STEADY_TIME = 0.25
"""For how long, in [s]."""


class RisingScale:
    """The scale that was given out last, and the most that may be given out next.

    Args:
        rise: By how much the scale rises in a second, at most, in [1/s]; above 0.

    Attributes:
        given: The last scale; 1 before the first.
    """

    def __init__(self, rise: float) -> None:
        self._rise = rise
        self.reset()

    def reset(self) -> None:
        """Forget what was given out; time may start anew."""
        self.given, self._given_at = 1.0, -math.inf
        self._ceiling, self._steady_until = 1.0, -math.inf

    def find_most(self, now: float) -> float:
        """The most that may be given out at a time, in [s]; it is not below the last scale."""
        most = self.given + self._rise * (now - self._given_at)
        return min(most, self._ceiling if now < self._steady_until else 1.0)

    def follow(self, now: float, limit: float) -> float:
        """Give out the most that may be given out at a time, in [s], up to a limit."""
        if self.given == 1.0 == limit and now >= self._steady_until:
            # The usual case: nothing has held the arm back for long.
            self._given_at = now
            return limit
        return self.give(now, min(limit, self.find_most(now)))

    def give(self, now: float, scale: float) -> float:
        """Take note of a scale that is given out at a time, in [s]; 0 is a STOP."""
        if 0.0 < scale < self.given:
            self._ceiling = max(STEADY_SHARE * self.given, scale)
            self._steady_until = now + STEADY_TIME
        self.given, self._given_at = scale, now
        return scale
