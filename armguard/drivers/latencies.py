"""One line per second: what a driver did, and its latencies."""

from __future__ import annotations

import math
import time
from collections import deque

import numpy as np

from armguard.drivers.arm import ArmState
from armguard.drivers.link import Counts
from armguard.drivers.obedience import Order
from armguard.verdict import Verdict

INTERVAL = 1.0
"""Between two lines, in [s]."""

_KEPT = 10_000
"""Number of newest durations from which percentiles are computed."""


def describe_delay(counts: Counts) -> str:
    """How late stops were ordered, in words; empty where that was not measured."""
    p99, most = counts.obeyed_p99, counts.obeyed_max
    if p99 is None or most is None:
        return ""
    return f", ordered within p99 {1e3 * p99:.1f}, max {1e3 * most:.1f} ms"


class Latencies:
    """Collects durations; each second they become a line."""

    def __init__(self, begun: float) -> None:
        self.counts = Counts()
        self._next = begun + INTERVAL
        self._ages: list[float] = []
        self._obeyed: deque[float] = deque(maxlen=_KEPT)
        self._verdicts_before = self._silences_before = self._commands_before = 0
        self._published = math.nan

    def add_state(self, stamp: float, now: float) -> None:
        """Count a joint state that was published, in [s] of the monotonic clock."""
        self.counts.states += 1
        self._ages.append(now - stamp)
        gap = stamp - self._published
        if gap > self.counts.longest_gap:
            self.counts.longest_gap = gap
        self._published = stamp

    def add_order(self, order: Order) -> None:
        """Count a stop that was just ordered because of a verdict or its expiry."""
        if order.since is not None:
            duration = time.monotonic() - order.since
            self.add_stop(duration, was_silent=order.cause != "STOP")

    def add_stop(self, duration: float, *, was_silent: bool) -> None:
        """Count a stop that was ordered `duration` [s] after the tick, or the verdict's end."""
        counts = self.counts
        counts.stops += 1
        counts.silences += was_silent
        self._obeyed.append(duration)
        counts.obeyed_max = max(counts.obeyed_max or 0.0, duration)
        counts.obeyed_p99 = float(np.percentile(self._obeyed, 99.0))

    def make_line(self, now: float, state: ArmState | None, verdict: Verdict | None) -> str:
        """The line about the last second, once a second; otherwise empty.

        Args:
            now: In [s] of the monotonic clock.
            state: The newest one.
            verdict: The newest one.
        """
        if now < self._next:
            return ""
        self._next = now + INTERVAL
        counts, ages = self.counts, self._ages
        words = [f"{len(ages)} states"]
        if ages:
            p50, p99 = 1e3 * np.percentile(ages, [50.0, 99.0])
            words.append(f"age p50 {p50:.1f}, p99 {p99:.1f}, max {1e3 * max(ages):.1f} ms")
        words.append(f"{counts.verdicts - self._verdicts_before} verdicts")
        if counts.stops:
            words.append(f"{counts.stops} stops{describe_delay(counts)}")
        if counts.silences > self._silences_before:
            words.append(f"{counts.silences - self._silences_before} without a valid verdict")
        if counts.commands > self._commands_before:
            came = counts.commands - self._commands_before
            words.append(f"{came} commands, {counts.missed} in all not followed")
        words.append("no verdict yet" if verdict is None else verdict.level.name)
        if state is not None:
            words.append(f"speed {state.scale:.0%}, program {state.program.value}")
        self._ages = []
        self._verdicts_before, self._silences_before = counts.verdicts, counts.silences
        self._commands_before = counts.commands
        return "; ".join(words)
