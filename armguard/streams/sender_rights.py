"""Whether the key that a message came with entitles its sender to send it."""

from __future__ import annotations

from armguard.messages.incoming import (
    AnyMessage,
    CloudMessage,
    IgnoreMessage,
    JointsMessage,
    ObstaclesMessage,
    PlanMessage,
    RemoveMessage,
    ResetMessage,
    WatchMessage,
)
from armguard.streams.authentication import Authenticator, Right, SenderError
from armguard.streams.intake import Intake

_OF_ARMS = JointsMessage | PlanMessage | IgnoreMessage | WatchMessage
"""Messages whose sender must speak for the arm that they name. A reset names an arm, too; who may
send one has a right of its own."""


def check_sender(
    message: AnyMessage, sender: str | None, authenticator: Authenticator, intake: Intake
) -> None:
    """Raise SenderError if the key of a message's sender does not entitle to send it.

    Args:
        message: What was sent.
        sender: Client whose key it came with.
        authenticator: Knows what clients may do.
        intake: Lets the verdict know of obstacles in another's name.
    """
    right: Right = "joints"
    if isinstance(message, ObstaclesMessage | CloudMessage | RemoveMessage):
        right = "obstacles"
    elif isinstance(message, ResetMessage):
        right = "reset"
    if sender is None or not authenticator.may(sender, right):
        found = f"one of {sender!r}, which may not send {right}"
        raise SenderError("message", found, f"a client that may: {right!r}", sender or "unknown")
    if isinstance(message, _OF_ARMS):
        if not authenticator.may_speak_for(sender, message.arm):
            found = f"{message.arm!r} in a message with the key of {sender!r}"
            raise SenderError("arm", found, f"one of the arms of {sender!r}", sender)
    elif not isinstance(message, ResetMessage) and message.source != sender:
        found = f"{message.source!r} in a message with the key of {sender!r}"
        error = SenderError("source", found, repr(sender), sender, message.seq)
        intake.tell_verdict(error)
        raise error
