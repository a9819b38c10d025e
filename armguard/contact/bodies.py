"""Arguments of compiled code about two bodies: positions, velocities and bounds."""

from __future__ import annotations

from typing import NamedTuple

from armguard.jit.arrays import FloatArray


class Bounds(NamedTuple):
    """Bounds of a body's motion, and the age of its state."""

    accel: float
    """Bound on its acceleration, in [m/s²]; inf: none."""
    speed: float
    """Bound on its speed, in [m/s]; inf: none."""
    velocity_error: float
    """Greatest error of its measured velocity, in [m/s]."""
    age: float
    """Now minus its stamp, in [s]; negative where that is newer than now."""


class Ball(NamedTuple):
    """A body whose place is that of one point, at its stamp."""

    x: float
    """Of its centre, in [m]; y and z likewise."""
    y: float
    z: float
    vx: float
    """Of its velocity, in [m/s]; vy and vz likewise."""
    vy: float
    vz: float
    bounds: Bounds


class Hull(NamedTuple):
    """A body that is the convex hull of moving points: two are a capsule, eight a box."""

    points: FloatArray
    """Where its corners are at its stamp, in [m]. Shape (k, 3)."""
    velocities: FloatArray
    """Of the corners, in [m/s]. Shape (k, 3)."""
    size: int
    """How many of the corners count."""
    bounds: Bounds
    """Of each corner."""
