"""Follows the numbers by which a source counts its messages."""

from __future__ import annotations

from collections.abc import Sequence


class SequenceWatch:
    """Follows the numbers of one source."""

    def __init__(self) -> None:
        self._last: int | None = None
        self._left: int | None = None

    def follow(self, sequence: int | None) -> Sequence[tuple[str, int, str]]:
        """Take the number of the next message.

        Args:
            sequence: The number; None where the sender does not count.

        Returns:
            Faults as (kind, how many, in words); mostly none.
        """
        if sequence is None:
            return ()
        last, self._last = self._last, sequence
        if last is None or sequence == last + 1:
            return ()
        if self._left is not None and sequence == self._left + 1:
            self._left = last
            problem = f"seq is {sequence} after {last}, and both go on; expected one publisher"
            return [("two publishers", 1, problem)]
        if sequence > last:
            lost = sequence - last - 1
            return [("lost", lost, f"seq is {sequence} after {last}: {lost} messages lost")]
        # The track that was left may be taken up again: then there are two publishers.
        self._left = last
        problem = f"seq is {sequence} after {last}; a publisher that started anew, or a second one"
        return [("sequence went back", 1, problem)]
