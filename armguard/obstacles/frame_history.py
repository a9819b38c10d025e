"""Frames of each obstacle's samples: a wrong frame must not look like another body.

Refused samples that agree with each other normally become the accepted track of their id. But if
they also come in another frame than the accepted samples, the frame is probably wrong. Then no
sample in that frame says where the body is, even after enough time to move there. The body could be
anywhere until a sample in the earlier frame is accepted again, or the id is removed.

A sample in another frame that agrees is accepted as any other, so a source can use several frames.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from armguard.jit.arrays import BoolArray, IntArray
from armguard.obstacles.acceptance import LATE, TAKEN, TRACK_CHANGED


class FrameHistory:
    """Frames of accepted samples, and those that contradicted them, by source.

    As long as a source uses one frame, a message only needs `is_usual`.
    """

    def __init__(self) -> None:
        self._usual: dict[int, int] = {}
        self._told: dict[int, dict[int, int]] = {}
        self._wrong: dict[int, dict[int, int]] = {}

    def is_usual(self, source: int, frame: int) -> bool:
        """Whether a message comes in the only frame that its source has ever used."""
        return source not in self._told and self._usual.setdefault(source, frame) == frame

    def find_wrong(
        self,
        source: int,
        frame: int,
        rows: IntArray,
        all_rows: Iterable[int],
        has_state: BoolArray,
    ) -> list[int]:
        """Which samples of a message come in a frame that has contradicted their bodies' states.

        Of a source for which `is_usual` does not hold.

        Args:
            source: Number of the source that speaks.
            frame: Number of the message's frame.
            rows: Row of each sample, -1 for none. Shape (n,).
            all_rows: Those of the source.
            has_state: Whether there is an accepted state, by row: where there is none, the row is
                another body's than before.
        """
        if source not in self._told:
            self._told[source] = dict.fromkeys(all_rows, self._usual[source])
            self._wrong[source] = {}
        wrong = self._wrong[source]
        for row in rows[~has_state[rows]].tolist():
            self._told[source].pop(row, None)
            wrong.pop(row, None)
        if not wrong:
            return []
        return [i for i, row in enumerate(rows.tolist()) if row >= 0 and wrong.get(row) == frame]

    def note(self, source: int, frame: int, rows: IntArray, codes: IntArray) -> None:
        """Note what came of a message, of a source for which `is_usual` does not hold.

        Args:
            source: Number of the source that spoke.
            frame: Number of the message's frame.
            rows: Row of each sample, -1 for none. Shape (n,).
            codes: What the rule made of each sample. Shape (n,).
        """
        told, wrong = self._told[source], self._wrong[source]
        accepted = np.isin(codes, (TAKEN, TRACK_CHANGED))
        for row in rows[accepted].tolist():
            told[row] = frame
            wrong.pop(row, None)
        for row in rows[~accepted & (codes != LATE)].tolist():
            if told.get(row, frame) != frame:
                wrong[row] = frame
