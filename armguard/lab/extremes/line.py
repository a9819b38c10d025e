"""One line of the table of extremes."""

from __future__ import annotations

from typing import NamedTuple

SOUND, UNSOUND, REFUSED = "sound", "UNSOUND", "refused"
"""What became of a case."""


class Line(NamedTuple):
    """What became of one case."""

    group: str
    case: str
    outcome: str
    """`SOUND`, `UNSOUND` or `REFUSED`."""
    tight: float = float("nan")
    """Contact time over the exact one, or over an adversary's first contact, in the median; NaN
    where there is nothing to compare."""
    worst: float = float("nan")
    """The least of these."""
    price: float = float("nan")
    """Of an evaluation or of a tick, in the median, in [µs]."""
    note: str = ""
    """Against what, or why refused."""
