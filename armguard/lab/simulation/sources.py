"""Where simulated obstacles come from: one small protocol, whatever plays behind it.

A source hands its samples to a sink as they fall due. A sink is anything with the `update` of the
obstacle table: the table itself, or a publisher that sends the same call over a network.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol


class ObstacleSink(Protocol):
    """What takes obstacle states; `armguard.Obstacles` is one."""

    @property
    def update(self) -> Callable[..., object]:
        """Takes the states of some obstacles; see `armguard.Obstacles.update`."""
        ...


class ObstacleSource(Protocol):
    """What publishes obstacle states.

    Attributes:
        name: The source's name in the table.
        rate: Samples a second, in [Hz].
        duration: Stamp of the last sample at the latest, in [s]; inf where it never ends.
    """

    name: str
    rate: float
    duration: float

    def publish(self, sink: ObstacleSink, now: float) -> None:
        """Hand over every sample due up to `now` that was not published yet, oldest first.

        Args:
            sink: Where the samples go.
            now: In [s] since the start of the simulation.
        """
        ...


class SampledSource:
    """Publishes at its own rate: sample k has the stamp k / rate.

    Args:
        name: The source's name in the table.
        rate: Samples a second, in [Hz].
        duration: No sample is stamped later than this, in [s].
    """

    def __init__(self, name: str, rate: float, duration: float) -> None:
        self.name = name
        self.rate = rate
        self.duration = duration
        self._next = 0

    def publish(self, sink: ObstacleSink, now: float) -> None:
        """Hand over every sample due up to `now` that was not published yet, oldest first."""
        while (stamp := self._next / self.rate) <= min(now, self.duration):
            self._next += 1
            self._publish_sample(sink, self._next - 1, stamp)

    def _publish_sample(self, sink: ObstacleSink, index: int, stamp: float) -> None:
        raise NotImplementedError
