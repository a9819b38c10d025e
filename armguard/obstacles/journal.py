"""What is told of an obstacle table to a journal: all that a replay needs to make the same table.

A journal is told what a call came to, not what it was given: arrays once they were read, or what
was malformed. So it never meets a foreign object, and a replay takes the same way from there on.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

from armguard.jit.arrays import FloatArray
from armguard.obstacles.frames import Frame
from armguard.obstacles.message import ToldSamples
from armguard.obstacles.sources import Source


class ObstacleSettings(NamedTuple):
    """What a table of obstacles was made with."""

    accel: float
    """Where a message gives none and no pattern fits, in [m]/[s]²."""
    speed: float
    """Alike, in [m]/[s]."""
    sources: tuple[Source, ...] | None
    """Those that were named; None: sources are to come, of which none was."""
    frames: dict[str, Frame]
    extent: float
    """[m]."""
    bounds: tuple[tuple[str, float, float], ...]
    """Pattern of ids, acceleration and speed."""


class ObstacleJournal(Protocol):
    """Is told each call that changes a table, in order; must neither block nor raise."""

    def note_update(
        self,
        ids: list[str],
        stamp: float,
        samples: ToldSamples,
        *,
        has_velocity: bool,
        has_accel: bool,
        has_speed: bool,
        source: str,
        frame: str,
        snapshot: bool,
    ) -> None:
        """Is told a message that could be read, before its rows are judged.

        Args:
            ids: Of its rows; a list that is told again holds what it held. Length n.
            stamp: In [s].
            samples: Its rows.
            has_velocity: Whether it gave velocities; if not, those in `samples` stand for them.
            has_accel: Whether it gave bounds on accelerations; if not, they are the table's.
            has_speed: Whether it gave bounds on speeds; if not, they are the table's.
            source: Who sent it.
            frame: Of its coordinates.
            snapshot: Whether it shows the whole cell.
        """
        ...

    def note_static(self, id: str, points: FloatArray, radius: float) -> None:
        """Is told an obstacle that stands still for ever, in [m]. Points of shape (k, 3)."""
        ...

    def note_entrance(
        self, id: str, points: FloatArray, radius: float, speed: float, accel: float
    ) -> None:
        """Is told a region out of which bodies come, as it counts: widened by what is not found.

        Args:
            id: Its name.
            points: Whose hull it is, in [m]. Shape (k, 3).
            radius: Around the hull, in [m].
            speed: Of what comes out, in [m]/[s].
            accel: Of what comes out, in [m]/[s]².
        """
        ...

    def note_removal(self, ids: Sequence[str], stamp: float | None, source: str | None) -> None:
        """Is told a removal; what it means without stamp or source is as in `Obstacles.remove`."""
        ...

    def note_malformed(self, source: str, offender: str, problem: str, stamp: float) -> None:
        """Is told a call of which nothing was taken, stamped in [s], NaN where that was none."""
        ...

    def note_broken(self, source: str, joint: str, problem: str, stamp: float) -> None:
        """Is told that an arm broke a promise, by a state that was stamped in [s]."""
        ...

    def note_points(self, source: str, stamp: float, points: int, dropped: int) -> None:
        """Is told how many of a cloud's points could not be used; its stamp in [s]."""
        ...

    def note_faults_taken(self) -> None:
        """Is told that what was refused was asked for, and is not told again."""
        ...
