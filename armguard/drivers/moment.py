"""The data of one turn of a driver's loop, and the interface of what acts on it."""

from __future__ import annotations

from typing import NamedTuple, Protocol

from armguard.drivers.arm import ArmState
from armguard.messages.command import CommandMessage
from armguard.verdict import Verdict


class Moment(NamedTuple):
    """One turn of the loop."""

    now: float
    """In [s] of the machine's monotonic clock."""
    verdict: Verdict | None
    """The newest verdict; None: there was none."""
    command: CommandMessage | None
    """The newest command of a shield; None: there was none."""
    state: ArmState
    """The newest state of the robot."""
    is_new: bool
    """Whether that state arrived in this turn."""
    hindrance: str
    """Why the arm must not move under any verdict: a problem of the robot, or its silence;
    otherwise empty."""


class Conduct(Protocol):
    """Gives orders to an arm, in each turn."""

    def act(self, moment: Moment) -> None:
        """Give the arm the order that follows from a moment.

        Raises:
            ArmLostError: The arm does not accept or does not obey the order.
        """
        ...
