"""How much one source may send, so that none can take the loop's time or the table's room.

What goes beyond a limit is refused as a whole, counted with source and limit, and a STOP while it
lasts: obstacles that were not taken in may be anywhere.
"""

from __future__ import annotations

from typing import NamedTuple

from armguard.messages.incoming import MessageError
from armguard.streams.inputs import BYTE_LIMIT


class SourceLimits(NamedTuple):
    """What one source may send at most."""

    message_size: int = BYTE_LIMIT
    """Of one message, in bytes; at most `BYTE_LIMIT`."""
    message_rate: float = 10_000.0
    """Messages in one second; so many may also come at once, as after a hold-up."""
    obstacles: int = 20_000
    """Obstacles in the table; voxels are obstacles, too. What would add some beyond is refused. By
    default as many as a usual cloud of a depth camera has points, so that it fits by itself."""
    points: int = 50_000
    """Points of one cloud."""


class LimitError(MessageError):
    """A message by which its source goes beyond a limit."""

    kind = "beyond limit"


class SourceCountError(MessageError):
    """A message of a source that is one more than there can be."""

    kind = "too many sources"


class MessageAllowance:
    """How many messages a source may send now: a bucket that fills at its rate, for one second.

    Args:
        rate: In messages a second.
        now: The present, in [s].
    """

    def __init__(self, rate: float, now: float) -> None:
        self._rate = rate
        self._most = max(1.0, rate)
        self._left = self._most
        self._filled = now

    def take(self, now: float) -> bool:
        """Whether one more message may come at `now` [s]; if so it is counted."""
        # A clock that goes back fills nothing, and one that jumps ahead no more than there is room.
        self._left = min(self._most, self._left + self._rate * max(0.0, now - self._filled))
        self._filled = now
        if not self._left >= 1.0:
            return False
        self._left -= 1.0
        return True
