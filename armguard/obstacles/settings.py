"""What a table of obstacles was made with."""

from __future__ import annotations

from typing import NamedTuple

from armguard.obstacles.frames import Frame
from armguard.obstacles.sources import Source


class ObstacleSettings(NamedTuple):
    """What a table of obstacles was made with."""

    accel: float
    """Where a message gives none and no pattern fits, in [m]/[s]²."""
    speed: float
    """Where a message gives none and no pattern fits, in [m]/[s]."""
    sources: tuple[Source, ...] | None
    """Those that were named; None: sources are to come, of which none was."""
    frames: dict[str, Frame]
    extent: float
    """[m]."""
    bounds: tuple[tuple[str, float, float], ...]
    """Pattern of ids, acceleration and speed."""
