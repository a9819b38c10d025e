"""What is told of a monitor to a journal: all that a replay needs to give the same verdicts."""

from __future__ import annotations

from typing import Any, Protocol

from armguard.pairs.exemptions import Exemption
from armguard.verdict import PlanVerdict, Verdict


class MonitorJournal(Protocol):
    """Is told what reaches a monitor and what it answers; must neither block nor raise.

    Arguments may be anything at all: a monitor takes what comes from outside as it is.
    """

    def note_state(self, stamp: object, q: Any, v: Any, now: object) -> None:
        """Is told the arguments of a step before anything is done with them."""
        ...

    def note_verdict(self, verdict: Verdict) -> None:
        """Is told the answer."""
        ...

    def note_plan(self, plan: object) -> None:
        """Is told a plan before it is judged."""
        ...

    def note_plan_verdict(self, verdict: PlanVerdict) -> None:
        """Is told the answer to the last plan."""
        ...

    def note_payload(self, payload: float) -> None:
        """Is told what the arm carries from the next step on, in [kg]."""
        ...

    def note_exemption(self, exemption: Exemption) -> None:
        """Is told that pairs are not to be watched for the time being, from the next step on."""
        ...

    def note_exemption_end(self, number: int) -> None:
        """Is told that an exemption is to end, by its number, with the next step."""
        ...

    def note(self, text: str) -> None:
        """Is told in a line for people which pairs are watched no longer, or watched again."""
        ...

    def note_reset(self) -> None:
        """Is told that past joint states and latched faults are to be forgotten."""
        ...
