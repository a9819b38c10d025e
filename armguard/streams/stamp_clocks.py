"""Converts stamps of sources' clocks to the monitor's time.

A converted stamp is never too new. The time by which it may be too old is returned with it, so that
errors of obstacles can be increased by their possible motion in that time.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, NamedTuple

from armguard.clock import Clock

HELD_UP = 50e-6
"""Two clocks are compared anew if that took longer, in [s]; usually it takes a few hundred ns."""

_COMPARISONS = 8
"""How often two clocks are compared at most, before the best comparison must do."""

_NANOSECOND = 1e-9


class StampClock(NamedTuple):
    """Which clock a source stamps with, and how old its measurements are by then."""

    clock: Literal["monotonic", "unix", "arrival"] = "monotonic"
    latency: float = 0.0
    """From measurement to stamp in [s]; for `arrival`, at most, from measurement to arrival."""
    error: float = 0.0
    """What stamps may be off by, either way, in [s]. Obstacles are widened by it; of joint states
    it has to be in the robot's joint errors already."""


MONOTONIC = StampClock()


class StampTimes:
    """Translates stamps into the monitor's time.

    Args:
        clock: The monitor's.
        monotonic: Reads the clock of `monotonic` stamps, in [s].
        unix: Reads the clock of `unix` stamps, in [s].

    Attributes:
        offset: Machine's monotonic clock minus the monitor's, in [s]; never too small.
        offset_error: What `offset` is too large by, in [s], where the process was held up at every
            try to compare the two.
        start: When this was made, in [s] of the monitor's clock.
        drain_start: When the present drain began, in [s] of the monitor's clock.
        arrived_after: When the last message from the present input had not arrived yet, in [s].
    """

    def __init__(
        self, clock: Clock, monotonic: Callable[[], float], unix: Callable[[], float]
    ) -> None:
        self.now = clock.now
        """Reads the monitor's clock, in [s]."""
        self.start, machine, gap = compare_clocks(clock.now, monotonic, 0.0)
        self.offset = machine - self.start
        # Of one process's own clock the closest of many tries is off by the reading itself.
        self.offset_error = gap if gap > HELD_UP else 0.0
        self.drain_start = self.arrived_after = self.start
        self._unix = unix

    def translate(self, stamp: float, clock: StampClock) -> tuple[float, float]:
        """A stamp in the monitor's time, never too new, and what it may be too old by, in [s]."""
        if clock.clock == "monotonic":
            return stamp - self.offset - clock.latency, self.offset_error
        if clock.clock == "unix":
            # Compared anew each time: the machine's date may be set while we run.
            now, unix, gap = compare_clocks(self.now, self._unix)
            # The difference of two dates first: it is exact, as that of a date and `now` is not.
            return now + (stamp - unix) - clock.latency, gap
        # Of several that arrived together the later ones must not look simultaneous.
        self.arrived_after += _NANOSECOND
        arrival = self.arrived_after - clock.latency
        # It may have arrived since the drain began, which takes its time.
        return arrival, self.now() - arrival


def compare_clocks(
    own: Callable[[], float], other: Callable[[], float], good_enough: float = HELD_UP
) -> tuple[float, float, float]:
    """Read two clocks together: one's own, the other, and what the first may be too early by.

    Whatever holds this process up between two readings makes them differ. One's own clock is read
    before the other and after it: the earlier reading makes stamps older, never newer, and older by
    the gap at most. Of several tries the closest counts.

    Args:
        own: Reads the clock that stamps are translated to, in [s].
        other: Reads the other one, in [s].
        good_enough: A gap, in [s], that needs no further try.
    """
    closest = 0.0, 0.0, float("inf")
    for _ in range(_COMPARISONS):
        before = own()
        reading = other()
        gap = own() - before
        if gap < closest[2]:
            closest = before, reading, gap
        if gap <= good_enough:
            break
    return closest
