"""One measured state of a body as compiled code compares it with others."""

from __future__ import annotations

from typing import NamedTuple

from armguard.jit.arrays import FloatArray


class Record(NamedTuple):
    """One measured state of a body, and the bounds that were told with it."""

    points: FloatArray
    """Of the hull, in [m]; the first `size` of them count. Shape (k, 3)."""
    velocities: FloatArray
    """Of the points, in [m]/[s]. Shape (k, 3)."""
    size: int
    """How many points the hull has."""
    radius: float
    """Around the hull, in [m]."""
    accel: float
    """Bound on acceleration, in [m]/[s]^2; inf for none."""
    speed: float
    """Bound on speed, in [m]/[s]; inf for none."""
    position_error: float
    """What positions may be off by, in [m]."""
    velocity_error: float
    """What velocities may be off by, in [m]/[s]."""
    stamp: float
    """When it was measured, in [s]."""
