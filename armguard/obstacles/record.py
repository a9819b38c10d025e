"""One measured state of a body, for comparisons in compiled code."""

from __future__ import annotations

from typing import Any, NamedTuple


class Record(NamedTuple):
    """One measured state of a body, with a radius and bounds that may be others than those there.

    It names the place of the rest instead of holding it: to put arrays into a tuple costs compiled
    code more, for counting references to them, than to compare two records.
    """

    states: Any
    """The `States` in which it stands."""
    row: int
    """Its row there."""
    radius: float
    """Around the hull, in [m]."""
    accel: float
    """Bound on acceleration, in [m]/[s]^2; inf for none."""
    speed: float
    """Bound on speed, in [m]/[s]; inf for none."""
