"""Measures the rate of a source, the age of its messages, and the noise of its positions."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from armguard.lab.commission.noise import estimate_noise
from armguard.lab.commission.observations import SourceObservations
from armguard.lab.commission.stops import DEVIATIONS

_FEWEST_MESSAGES = 20
_FEWEST_SAMPLES = 30
"""Of one obstacle, from which a spread is computed."""

_SAME_TICK = 1e-9
"""Between the arrivals of two messages of one tick, at most, by rounding; in [s]."""


class SourceFindings(NamedTuple):
    """What one source is like."""

    rate: float
    """Messages a second, by the median of the times between their arrivals; [Hz]."""
    usual_silence: float
    """From a stamp until the next message arrived, at most, 99 times of 100; in [s]. So does the
    monitor count silence."""
    longest_silence: float
    """Of all silences, in [s]."""
    quiet_silence: float
    """The longest silence that was no STOP in the recording, in [s]."""
    timeout: float
    """Half as long again as `quiet_silence`, or as a period of `rate` if that is longer; in [s]."""
    uncovered: int
    """How many silences were longer than `timeout`."""
    median_age: float
    oldest: float
    """When messages were taken in, counted from their stamps, in [s]."""
    spread: float
    """Standard deviation of a coordinate, at most, in [m]; NaN where no obstacle was seen often
    enough. What an obstacle does between two samples counts as spread."""


def measure_source(seen: SourceObservations) -> SourceFindings | None:
    """What a source is like; None if it sent too little to tell."""
    if len(seen.stamps) < _FEWEST_MESSAGES:
        return None
    order = np.argsort(seen.stamps + seen.ages, kind="stable")
    arrivals = (seen.stamps + seen.ages)[order]
    # A message that was overtaken on its way does not make its source look silent.
    newest = np.maximum.accumulate(seen.stamps[order])
    intervals, silences = np.diff(arrivals), arrivals[1:] - newest[:-1]
    # Messages of one tick end one silence.
    apart = intervals > _SAME_TICK
    intervals, silences = intervals[apart], silences[apart]
    if not len(intervals) or not np.ptp(seen.stamps) > 0.0:
        return None
    spreads = []
    for stamps, positions in seen.tracks.values():
        even = np.diff(stamps)
        if len(stamps) < _FEWEST_SAMPLES or not (even <= 2.0 * np.median(even)).mean() > 0.9:
            continue
        # Each coordinate is an estimate by itself, and as good as its samples are many.
        widest = max(estimate_noise(positions[:, axis]) for axis in range(3))
        spreads.append(widest * (1.0 + DEVIATIONS / np.sqrt(len(stamps))))
    period, usual = float(np.median(intervals)), float(np.percentile(silences, 99.0))
    # A source that cannot keep its timeout has no quiet times: most of its silences are usual.
    is_slow = (silences > seen.timeout).mean() > 0.5
    quiet = silences[silences <= (usual if is_slow else seen.timeout)].max()
    timeout = 1.5 * max(float(quiet), period)
    return SourceFindings(
        1.0 / period,
        usual,
        float(silences.max()),
        float(quiet),
        timeout,
        int((silences > timeout).sum()),
        float(np.median(seen.ages)),
        float(seen.ages.max()),
        float(max(spreads)) if spreads else float("nan"),
    )
