"""How long ticks take: a histogram of fixed size, filled without allocation, read at the end."""

from __future__ import annotations

import math

import numpy as np

_PER_OCTAVE = 64
_SHORTEST = 1e-7
_OCTAVES = 27  # up to 13 s; what is longer is counted there, its maximum is exact


class Durations:
    """Durations in [s], kept to about one percent; the longest exactly."""

    def __init__(self) -> None:
        self._counts = np.zeros(_PER_OCTAVE * _OCTAVES, np.int64)
        self.count = 0
        self.longest = 0.0

    def add(self, duration: float) -> None:
        """Count one duration, in [s]."""
        place = int(_PER_OCTAVE * math.log2(max(duration, _SHORTEST) / _SHORTEST))
        self._counts[min(place, len(self._counts) - 1)] += 1
        self.count += 1
        self.longest = max(self.longest, duration)

    def percentile(self, percent: float) -> float:
        """A duration in [s] that `percent` of all do not exceed; nan if there is none."""
        if not self.count:
            return math.nan
        reached = np.searchsorted(np.cumsum(self._counts), percent / 100.0 * self.count)
        if reached >= len(self._counts) - 1:
            return self.longest
        upper: float = _SHORTEST * 2.0 ** ((int(reached) + 1) / _PER_OCTAVE)
        return min(upper, self.longest)
