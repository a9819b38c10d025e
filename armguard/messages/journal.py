"""What a journal is given: all that a replay needs to give the same verdicts.

A table gives what a call came to, not what it was given: arrays once they were read, or what was
malformed. A monitor gives the arguments of steps and plans as they came.
"""

from __future__ import annotations

from typing import Any, Protocol

from armguard.messages.batch import ObstacleBatch
from armguard.messages.incoming import Message
from armguard.verdict import PlanVerdict, Verdict


class Journal(Protocol):
    """Keeps what reaches a monitor and its table, and the answers; never blocks or raises."""

    def note_state(self, stamp: object, q: Any, v: Any, now: object) -> None:
        """Takes the arguments of a step before anything is done with them; they may be anything."""
        ...

    def note_verdict(self, verdict: Verdict) -> None:
        """Takes the answer to a step."""
        ...

    def note_plan(self, plan: object) -> None:
        """Takes a plan before it is judged; it may be anything."""
        ...

    def note_plan_verdict(self, verdict: PlanVerdict) -> None:
        """Takes the answer to the last plan."""
        ...

    def note_update(self, batch: ObstacleBatch) -> None:
        """Takes obstacle states that could be read, before any of them is judged.

        Args:
            batch: Its list of ids keeps what it holds; its arrays are overwritten by the next call.
        """
        ...

    def note_message(self, message: Message) -> None:
        """Takes any other input.

        A `RemoveMessage` of the application itself has no source, and one that holds from the
        present on has NaN for its stamp.
        """
        ...

    def note(self, text: str) -> None:
        """Takes a line for people, such as which pairs are watched no longer, or watched again."""
        ...
