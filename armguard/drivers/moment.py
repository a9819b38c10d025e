"""What a driver knows at one turn of its loop, and what acts on it."""

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
    """The newest one; None: there was none."""
    command: CommandMessage | None
    """The newest one of a shield; None: there was none."""
    state: ArmState
    """The newest one of the robot."""
    is_new: bool
    """Whether that state has come in this turn."""
    hindrance: str
    """Why the arm must not move, whatever verdicts say: its own trouble, or its silence; otherwise
    empty."""


class Conduct(Protocol):
    """What tells an arm what to do, in each turn."""

    def act(self, moment: Moment) -> None:
        """Tell the arm what follows from a moment.

        Raises:
            ArmLostError: It does not take that, or does not do it.
        """
        ...
