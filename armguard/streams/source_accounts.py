"""Accounts of sources: enforces limits on the messages of each source.

No source can use up the loop's time or the table's room. A message beyond a limit is refused as a
whole, counted with source and limit, and a STOP while this lasts: obstacles that were refused may
be anywhere.

A short message is decoded first, and then charged to its source. A long one is charged first, by
its header alone, and then decoded. So a message that is refused costs little, however long it is.
What is too long for a client whose key lets it send obstacles alone is refused unread.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from armguard.messages.incoming import CloudMessage, MessageError, ObstaclesMessage, RemoveMessage
from armguard.streams.inputs import BYTE_LIMIT
from armguard.streams.intake import Intake, SequenceWatch
from armguard.streams.stamp_clocks import MONOTONIC, StampClock

SourceMessage = ObstaclesMessage | CloudMessage | RemoveMessage
"""Messages that say whose they are."""

_SOURCES = 256
"""Most sources known at once, so that made-up names cannot fill the memory."""


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


_USUAL_LIMITS = SourceLimits()


class LimitError(MessageError):
    """A message by which its source goes beyond a limit."""

    kind = "beyond limit"
    hides_obstacles = True


class SourceCountError(LimitError):
    """A message of a source that is one more than there can be."""

    kind = "too many sources"


class SourceAccount:
    """What is kept of a source that has sent.

    How many messages it may send now is a bucket that fills at its rate, for one second.

    Args:
        limits: How much it may send.
        clock: How it stamps.
        numbers: Follows the numbers of its messages.
        now: The present, in [s].

    Attributes:
        limits: As above.
        clock: As above.
        numbers: As above.
    """

    def __init__(
        self, limits: SourceLimits, clock: StampClock, numbers: SequenceWatch, now: float
    ) -> None:
        self.limits = limits
        self.clock = clock
        self.numbers = numbers
        self._left = self._most = max(1.0, limits.message_rate)
        self._filled = now

    def allows_message(self, now: float) -> bool:
        """Whether one more message may come at `now` [s]; if so it is counted."""
        # A clock that goes back fills nothing, and one that jumps ahead no more than there is room.
        filling = self.limits.message_rate * max(0.0, now - self._filled)
        self._left = min(self._most, self._left + filling)
        self._filled = now
        if not self._left >= 1.0:
            return False
        self._left -= 1.0
        return True


class SourceAccounts:
    """Charges messages to their sources, and refuses those beyond a limit.

    Args:
        intake: The table, where faults are counted, and times.
        limits: By source; those not named here, as `SourceLimits` has it.
        clocks: How sources stamp; those not named here, with the monotonic clock.
    """

    def __init__(
        self,
        intake: Intake,
        limits: Mapping[str, SourceLimits],
        clocks: Mapping[str, StampClock],
    ) -> None:
        self._intake = intake
        self._limits = limits
        self._clocks = clocks
        self._accounts: dict[str, SourceAccount] = {}

    def limits_of(self, source: str) -> SourceLimits:
        """How much a source may send."""
        return self._limits.get(source, _USUAL_LIMITS)

    def charge(
        self, payer: str, size: int, sequence: int | None, named: str | None = None
    ) -> SourceAccount:
        """Charge a message to the source that sent it.

        Args:
            payer: Source that is charged: that of the sender's key, where there are keys.
            size: Of the message, in bytes.
            sequence: Number of the message, where it has one.
            named: Source that the message names, if it was read.

        Returns:
            What is kept of the source.

        Raises:
            LimitError: It takes the source beyond its size or rate, or the source is one more than
                there can be.
        """
        now = self._intake.times.drain_start
        account = self._accounts.get(payer)
        if account is None:
            if len(self._accounts) >= _SOURCES:
                expected = f"at most {_SOURCES} sources"
                raise SourceCountError("source", "refused", expected, payer, sequence)
            account = self._accounts[payer] = SourceAccount(
                self.limits_of(payer),
                self._clocks.get(payer, MONOTONIC),
                SequenceWatch(self._intake.faults, payer),
                now,
            )
        limits = account.limits
        if not account.allows_message(now):
            found = "above the rate limit"
            expected = f"max_message_rate, {limits.message_rate:g} a second at most"
        elif size > limits.message_size:
            found = f"{size} bytes long"
            expected = f"max_message_size, {limits.message_size} at most"
        else:
            return account
        if named == payer:
            # It was refused, and is not lost.
            account.numbers.follow(sequence)
        raise LimitError("message", found, expected, payer, sequence)
