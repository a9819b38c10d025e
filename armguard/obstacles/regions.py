"""The body regions that an obstacle may be, and the contact limits of these regions.

Each row of the obstacle table has a set of regions: all that were ever stated of it, the accepted
and the refused samples alike. A row that changed its region, or of which two states are possible,
therefore has the strictest of their limits. Where a sample states no region, that is in the set as
well, and such a row may never be touched.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from armguard.jit.arrays import FloatArray
from armguard.jit.kernels import kernel

NO_REGION = 1
"""The set of a sample that states no region. Region number k adds 2**k to a set."""


class RegionLimits(NamedTuple):
    """What contact is permitted, by number of region; without entries where no limit is stated."""

    max_speed: FloatArray
    """How fast a surface may be that touches it, in [m/s]; 0: it may never be touched.
    Shape (regions + 1,) or (0,)."""
    max_way: FloatArray
    """How far a surface may still go that clamps it, in [m]; 0: it may never be clamped. Alike."""
    gap: FloatArray
    """How near to it anything else counts as what it can be clamped against, in [m]. Alike."""
    thickness: FloatArray
    """How thick it is at the least, in [m]. Alike."""


class ContactLimit(NamedTuple):
    """What contact with one obstacle is permitted; as in `RegionLimits`."""

    max_speed: float
    max_way: float
    gap: float
    thickness: float


def make_no_limits() -> RegionLimits:
    """Of a cell in which nothing may be touched."""
    return RegionLimits(*(np.zeros(0) for _ in RegionLimits._fields))


@kernel
def strictest_limit(limits: RegionLimits, regions: int) -> ContactLimit:
    """The strictest of the limits of a set of regions; the empty set may never be touched."""
    max_speed = max_way = thickness = np.inf
    gap = 0.0
    for number in range(limits.max_speed.shape[0]):
        if (regions >> number) & 1:
            max_speed = min(max_speed, limits.max_speed[number])
            max_way = min(max_way, limits.max_way[number])
            thickness = min(thickness, limits.thickness[number])
            gap = max(gap, limits.gap[number])
    if not max_speed < np.inf:
        return ContactLimit(0.0, 0.0, np.inf, 0.0)
    return ContactLimit(max_speed, max_way, gap, thickness)
