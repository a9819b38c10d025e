"""full-DF: evaluate every pair in every tick, by distance alone.

The second reference of [Awareness]_ and what is usually done: the nearest pair first, whichever way
it moves. In the monitor its time is the distance over the speed bounds of the pair.
"""

from __future__ import annotations

from armguard.schedules.arguments import Measure
from armguard.schedules.full import FullSchedule


class DistanceSchedule(FullSchedule):
    """All pairs are due, measured by distance; none is ever flagged.

    Attributes:
        measure: What `settle` is to be given.
        every_tick: Whether all pairs are due in every tick.
    """

    measure: Measure = "distance"
    every_tick: bool = True
