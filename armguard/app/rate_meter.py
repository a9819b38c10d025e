"""How many messages come in a second, from readings of a count."""

from __future__ import annotations

from collections import deque

WINDOW = 1.5
"""Over which messages are counted, in [s]."""

STEP = 0.25
"""Between two readings of a count that are kept, in [s]."""


class RateMeter:
    """Messages a second, from readings of a count."""

    def __init__(self) -> None:
        self._readings: deque[tuple[float, int]] = deque()

    def read(self, now: float, count: int) -> float | None:
        """Take a reading; the rate in [Hz], or None while there is too little to tell.

        Args:
            now: In [s], never less than before.
            count: Messages so far.
        """
        readings = self._readings
        if not readings or now - readings[-1][0] >= STEP:
            readings.append((now, count))
        while len(readings) > 2 and now - readings[1][0] >= WINDOW:
            readings.popleft()
        since, first = readings[0]
        return (count - first) / (now - since) if now - since >= STEP else None
