"""Which arm of the cell a message is about."""

from __future__ import annotations

from collections.abc import Collection

from armguard.messages.incoming import (
    IgnoreMessage,
    JointsMessage,
    MessageError,
    PlanMessage,
    ResetMessage,
    WatchMessage,
)

ArmMessage = JointsMessage | PlanMessage | IgnoreMessage | WatchMessage | ResetMessage
"""Messages that say which arm they are about, where there are several."""


class ArmNames:
    """The arms of the cell.

    Args:
        watched: Name of the watched arm; empty where there is one. Messages about it name it so.
        others: Names of the others.
    """

    def __init__(self, watched: str, others: Collection[str]) -> None:
        self.watched = watched
        self.others = others

    def refuse(self, message: ArmMessage) -> MessageError:
        """The error of a message that does not name the watched arm as the cell has it."""
        found = repr(message.arm) if message.arm else "missing"
        known = ", ".join(map(repr, (self.watched, *self.others)))
        expected = f"one of {known}" if self.watched else "none: the cell has one arm"
        return MessageError("arm", found, expected)
