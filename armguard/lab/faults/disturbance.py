"""Disturbances of a stream between a sound sender and the monitor.

A disturbance changes, delays, repeats or drops messages from one time to another. Outside of that
time a disturbed publisher is a publisher.
"""

from __future__ import annotations

import heapq
import itertools
import math
import random
import struct
import time
from typing import Any, Literal

import msgspec
import numpy as np

from armguard.messages.incoming import AnyMessage, JointsMessage, ObstaclesMessage, encode
from armguard.streams.nodes import Publisher

Sending = Literal["drop", "late", "delay", "swap", "repeat"]
"""What happens to when a message is sent, and how often."""

Content = Literal["set", "clock", "drift", "frame", "shorten", "exchange", "teleport"]
"""What happens to what it says."""

Addition = Literal["static", "crowd", "flood"]
"""What a camera sends besides."""

Kind = Literal[Sending, Content, Addition]

_FLOOD_SHARE = 100
"""Messages between two looks at the clock in a flood."""


class Disturbance(msgspec.Struct, frozen=True, kw_only=True):
    """What happens to a stream, and when; times are of the machine's monotonic clock, in [s]."""

    kind: Kind
    begin: float
    end: float
    field: str = ""
    """Of the messages, for `set`; name of a frame, for `frame`."""
    value: str = "0"
    """By how much, or how many; in words, for JSON has no numbers that are not finite."""

    @property
    def amount(self) -> float:
        """The value as a number."""
        return float(self.value)

    def is_active(self, now: float) -> bool:
        """Whether it happens at `now` [s]."""
        return self.begin <= now < self.end


def disturb(
    message: AnyMessage, disturbance: Disturbance, now: float, number: int, chance: random.Random
) -> list[tuple[float, AnyMessage]]:
    """What becomes of a message.

    Args:
        message: Of a sound sender.
        disturbance: What happens to it.
        now: In [s].
        number: Of the message, counted from the first one that is disturbed.
        chance: Decides how long it is delayed.

    Returns:
        Messages, and when each is sent, in [s].
    """
    kind, amount = disturbance.kind, disturbance.amount
    is_second = number % 2 == 1
    if not isinstance(message, ObstaclesMessage | JointsMessage):
        return [(now, message)]
    sending = {
        "drop": [],
        "late": [amount],
        "delay": [chance.uniform(0.0, amount)],
        "swap": [0.0 if is_second else amount],
        "repeat": [0.0, 0.0],
    }
    if kind in sending:
        return [(now + delay, message) for delay in sending[kind]]
    replace = msgspec.structs.replace
    if kind == "clock":
        message = replace(message, stamp=message.stamp + amount)
    elif kind == "drift":
        elapsed = message.stamp - disturbance.begin
        message = replace(message, stamp=message.stamp + amount * elapsed)
    elif kind == "frame":
        message = replace(message, frame=disturbance.field)
    elif kind == "set":
        message = _set(message, disturbance.field, amount)
    elif kind == "shorten":
        message = _shorten(message)
    elif kind == "exchange":
        names = "ids" if isinstance(message, ObstaclesMessage) else "names"
        message = replace(message, **{names: getattr(message, names)[::-1]})
    elif kind == "teleport" and is_second:
        field = "position" if isinstance(message, ObstaclesMessage) else "q"
        message = _set(message, field, amount, is_added=True)
    return [(now, message)]


def _set(message: Any, field: str, value: float, *, is_added: bool = False) -> Any:
    """A message with another number in a field, the first one where the field has several."""
    present = getattr(message, field)
    if isinstance(present, bytes):
        (first,) = struct.unpack_from("<d", present)
        changed: Any = struct.pack("<d", first + value if is_added else value) + present[8:]
    else:
        changed = value
    return msgspec.structs.replace(message, **{field: changed})


def _shorten(message: Any) -> Any:
    """A message that lacks its last number."""
    field = "position" if isinstance(message, ObstaclesMessage) else "q"
    return msgspec.structs.replace(message, **{field: getattr(message, field)[:-8]})


class DisturbedPublisher(Publisher):
    """A publisher whose messages may be disturbed on their way.

    Args:
        address: The monitor's input.
        source: Name under which the obstacles are known.

    Attributes:
        disturbance: What happens to messages from now on; None: nothing does.
    """

    def __init__(self, address: str, source: str = "default") -> None:
        super().__init__(address, source)
        self.disturbance: Disturbance | None = None
        self._followed: Disturbance | None = None
        self._disturbed = 0
        self._order = itertools.count()
        self._waiting: list[tuple[float, int, AnyMessage]] = []
        self._chance = random.Random(0)

    def flush(self, now: float) -> None:
        """Send what was delayed until `now` [s]."""
        while self._waiting and self._waiting[0][0] <= now:
            self._socket.send(encode(heapq.heappop(self._waiting)[2]))

    def flood(self, message: ObstaclesMessage, rate: float, duration: float) -> None:
        """Send one message again and again, as a sender does that has gone mad.

        Args:
            message: Without a number of its own.
            rate: Messages a second.
            duration: How long, in [s].
        """
        data, begin, sent = encode(message), time.monotonic(), 0
        while (elapsed := time.monotonic() - begin) < duration:
            while sent < rate * elapsed:
                for _ in range(_FLOOD_SHARE):
                    self._socket.send(data)
                sent += _FLOOD_SHARE

    def _send(self, message: AnyMessage) -> None:
        now = time.monotonic()
        disturbance, sent = self.disturbance, [(now, message)]
        if disturbance is not self._followed:
            self._followed, self._disturbed = disturbance, 0
        # A short one strikes at least one message, the first that comes once it has begun.
        if disturbance is not None and (
            disturbance.is_active(now) or (now >= disturbance.begin and not self._disturbed)
        ):
            sent = disturb(message, disturbance, now, self._disturbed, self._chance)
            self._disturbed += 1
        for when, one in sent:
            heapq.heappush(self._waiting, (when, next(self._order), one))
        self.flush(now)


def make_crowd(count: int) -> tuple[list[str], np.ndarray[Any, np.dtype[np.float64]]]:
    """Ids and places of many obstacles, in rings about the cell. Positions of shape (count, 3)."""
    turn = np.arange(count) * math.pi * (3.0 - math.sqrt(5.0))
    distance = 3.0 + 3.0 * np.sqrt(np.arange(count) / max(count, 1))
    place = [distance * np.cos(turn), distance * np.sin(turn), np.full(count, 0.5)]
    return [f"crowd-{number}" for number in range(count)], np.stack(place, axis=1)
