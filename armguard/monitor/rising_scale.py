"""A speed scale that falls at once and rises slowly, so that an arm that obeys it moves smoothly.

The proved scale jumps with each sample of an obstacle, and with the arm's own speed. An arm that
followed each jump would accelerate and brake many times a second. A scale below a proved one needs
no proof: an arm that keeps it also keeps the proved one.
"""

from __future__ import annotations

import math

STEADY_SHARE = 0.85
"""Fraction of the last proved scale up to which the scale rises at first after a fall."""

STEADY_TIME = 0.25
"""How long this fraction limits the scale, in [s]."""


class RisingScale:
    """The last published scale, and the greatest that may be published next.

    Args:
        rise: Greatest rate at which the scale rises, in [1/s]; above 0.

    Attributes:
        given: The last scale; 1 before the first.
    """

    def __init__(self, rise: float) -> None:
        self._rise = rise
        self.reset()

    def reset(self) -> None:
        """Drop the history; the clock may start anew."""
        self.given, self._given_at = 1.0, -math.inf
        self._ceiling, self._steady_until = 1.0, -math.inf

    def find_most(self, now: float) -> float:
        """The greatest scale that may be published at a time, in [s]; not below the last scale."""
        most = self.given + self._rise * (now - self._given_at)
        return min(most, self._ceiling if now < self._steady_until else 1.0)

    def follow(self, now: float, limit: float) -> float:
        """Publish the greatest scale that is possible at a time, in [s], up to a limit."""
        if self.given == 1.0 == limit and now >= self._steady_until:
            # The usual case: nothing has held the arm back for long.
            self._given_at = now
            return limit
        return self.give(now, min(limit, self.find_most(now)))

    def give(self, now: float, scale: float) -> float:
        """Note a scale that is published at a time, in [s]; 0 is a STOP."""
        if 0.0 < scale < self.given:
            self._ceiling = max(STEADY_SHARE * self.given, scale)
            self._steady_until = now + STEADY_TIME
        self.given, self._given_at = scale, now
        return scale
