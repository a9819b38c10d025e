"""Measures the rate of messages from readings of their count."""

from __future__ import annotations

from collections import deque

WINDOW = 1.5
"""Time over which messages are counted, in [s]."""

STEP = 0.25
"""Least time between two stored readings of a count, in [s]."""


class RateMeter:
    """Measures messages per second from readings of a count."""

    def __init__(self) -> None:
        self._readings: deque[tuple[float, int]] = deque()

    def read(self, now: float, count: int) -> float | None:
        """Add a reading; returns the rate in [Hz], or None while there are too few readings.

        Args:
            now: Time in [s]; never less than in the call before.
            count: Messages so far.
        """
        readings = self._readings
        if not readings or now - readings[-1][0] >= STEP:
            readings.append((now, count))
        while len(readings) > 2 and now - readings[1][0] >= WINDOW:
            readings.popleft()
        since, first = readings[0]
        return (count - first) / (now - since) if now - since >= STEP else None
