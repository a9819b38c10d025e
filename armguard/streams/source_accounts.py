"""What each source of obstacles has sent, held against its limits.

A short message is decoded first, and then charged to its source. A long one is charged first, by
its header alone, and then decoded. So a message that is refused costs little, however long it is.
What is too long for a client whose key lets it send obstacles alone is refused unread.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from armguard.messages.incoming import (
    CloudMessage,
    MessageError,
    ObstaclesMessage,
    RemoveMessage,
    count_points,
)
from armguard.streams.intake import Intake
from armguard.streams.limits import LimitError, MessageAllowance, SourceCountError, SourceLimits
from armguard.streams.sequence_watch import SequenceWatch

SourceMessage = ObstaclesMessage | CloudMessage | RemoveMessage
"""Messages that say whose they are."""

_SOURCES = 256
"""Most sources known at once, so that made-up names cannot fill the memory."""

_USUAL_LIMITS = SourceLimits()


class _Account(NamedTuple):
    """What is kept of each source that has sent."""

    watch: SequenceWatch
    allowance: MessageAllowance
    limits: SourceLimits


class SourceAccounts:
    """Charges messages to their sources, and refuses those beyond a limit.

    Args:
        intake: The table, where faults are counted, and times.
        limits: By source; those not named here, as `SourceLimits` has it.
    """

    def __init__(self, intake: Intake, limits: Mapping[str, SourceLimits]) -> None:
        self._intake = intake
        self._limits = dict(limits)
        self._accounts: dict[str, _Account] = {}

    def limits_of(self, source: str) -> SourceLimits:
        """How much a source may send."""
        return self._limits.get(source, _USUAL_LIMITS)

    def charge(self, payer: str, size: int, sequence: int | None, named: str | None = None) -> None:
        """Charge a message to the source that sent it.

        Args:
            payer: Source that is charged: that of the sender's key, where there are keys.
            size: Of the message, in bytes.
            sequence: Number of the message, where it has one.
            named: Source that the message names, if it was read.

        Raises:
            LimitError: It takes the source beyond its size or rate.
            SourceCountError: The source is one more than there can be.
        """
        account = self._find(payer, sequence)
        limits = account.limits
        if not account.allowance.take(self._intake.times.drain_start):
            found = "one more than a second may bring"
            expected = f"max_message_rate, {limits.message_rate:g} a second at most"
        elif size > limits.message_size:
            found = f"{size} bytes long"
            expected = f"max_message_size, {limits.message_size} at most"
        else:
            return
        if named == payer:
            # It was refused, and is not lost.
            self._follow(account, payer, sequence)
        raise self._refuse(LimitError("message", found, expected, payer, sequence))

    def follow(self, message: SourceMessage) -> None:
        """Follow the number of a message, and count what was lost before it."""
        self._follow(self._find(message.source, message.seq), message.source, message.seq)

    def check_obstacles(self, message: ObstaclesMessage) -> None:
        """Raise LimitError if a message takes its source beyond its number of obstacles."""
        most = self.limits_of(message.source).obstacles
        obstacles, count = self._intake.obstacles, len(message.ids)
        if not message.snapshot:
            count += obstacles.count_of(message.source)
            if count > most:
                # Those that the table has already are looked up only where that decides.
                count = obstacles.count_of(message.source, message.ids)
        if count > most:
            found = f"one by which {message.source!r} has {count} obstacles"
            raise self._refuse_message(message, found, f"max_obstacles, {most} at most")

    def check_cloud(self, message: CloudMessage, *, are_taken: bool) -> None:
        """Raise LimitError if a cloud has too many points, or none is taken here.

        How many voxels it makes is not known yet: the table counts them before it takes any.
        """
        most, points = self.limits_of(message.source).points, count_points(message.points)
        if not are_taken:
            expected = "obstacles: [clouds] in the cell file lets clouds be taken"
            raise self._refuse_message(message, "a cloud", expected)
        if points > most:
            expected = f"max_points, {most} at most"
            raise self._refuse_message(message, f"one of {points} points", expected)

    def _follow(self, account: _Account, source: str, sequence: int | None) -> None:
        if faults := account.watch.follow(sequence):
            self._intake.count_gaps(faults, source, sequence)

    def _find(self, source: str, sequence: int | None) -> _Account:
        """What is kept of a source; raises SourceCountError for one too many."""
        account = self._accounts.get(source)
        if account is None:
            if len(self._accounts) >= _SOURCES:
                raise SourceCountError(
                    "source", "refused", f"at most {_SOURCES} sources", source, sequence
                )
            limits = self.limits_of(source)
            allowance = MessageAllowance(limits.message_rate, self._intake.times.drain_start)
            account = self._accounts[source] = _Account(SequenceWatch(), allowance, limits)
        return account

    def _refuse_message(self, message: SourceMessage, found: str, expected: str) -> MessageError:
        return self._refuse(LimitError("message", found, expected, message.source, message.seq))

    def _refuse(self, error: MessageError) -> MessageError:
        """Let the verdict know of what is refused."""
        self._intake.tell_verdict(error)
        return error
