"""Bounds on the displacement of a free body: a point with bounded acceleration and speed.

A body that is measured with some velocity, right to `velocity_error`, has a displacement along a
direction of at most that of the fastest one within its bounds: it accelerates up to its top speed
and keeps it. All of this is rounded up by `SUM_ROUNDING`. `armguard.contact` has the same bound
with the rounding of its own proof (a few ulp, in one expression with the gap of two bodies), and
its verifier has it in rational numbers, independent of both.
"""

from __future__ import annotations

import math

from armguard.jit.kernels import kernel, merged_kernel
from armguard.jit.numerics import SUM_ROUNDING


@kernel
def length_above(x: float, y: float, z: float) -> float:
    """Length of a vector, rounded up."""
    return math.sqrt(x * x + y * y + z * z) * (1.0 + SUM_ROUNDING)


@kernel
def top_speed(measured: float, speed: float, velocity_error: float) -> float:
    """The speed bound that holds: `speed`, or what was measured where that breaks it.

    Args:
        measured: Speed measured, in [m/s], rounded up; see `length_above`.
        speed: Bound on it, in [m/s].
        velocity_error: What the measured velocity may be off by, in [m/s].
    """
    return speed if measured <= speed + velocity_error else measured + velocity_error


@merged_kernel
def free_displacement(start: float, accel: float, top: float, s: float) -> float:
    """Displacement within `s` >= 0 seconds of the fastest body that starts at `start`, rounded up.

    It accelerates at `accel` up to `top`. The start may be negative, and bounds may be infinite.
    """
    start = min(start, top)
    reached = start + accel * s
    if reached < top:
        return s * (start + 0.5 * accel * s) + SUM_ROUNDING * s * (abs(start) + accel * s)
    ramp = min((top - start) / accel, s) if start < top and accel < math.inf else 0.0
    return 0.5 * (start + top) * ramp + top * (s - ramp) + SUM_ROUNDING * top * s


@kernel
def displacement_at(
    closing: float, velocity_error: float, accel: float, top: float, s: float
) -> float:
    """Bound on a body's displacement along a direction, `s` seconds from its stamp, either way.

    Args:
        closing: Velocity measured along the direction, in [m/s].
        velocity_error: What it may be off by, in [m/s].
        accel: Bound on the acceleration, in [m/s²].
        top: Bound on the speed, in [m/s]; see `top_speed`.
        s: In [s]; negative before the stamp, when the body was headed the opposite way.
    """
    if s == 0.0:
        return 0.0
    if s > 0.0:
        displacement: float = free_displacement(closing + velocity_error, accel, top, s)
    else:
        displacement = free_displacement(velocity_error - closing, accel, top, -s)
    return displacement


@kernel
def saturation_time(x: float, y: float, z: float, accel: float, speed: float) -> float:
    """Time from its stamp on from which a body may have its top speed in any direction, in [s].

    What a separating direction is chosen by; no proof rests on it.

    Args:
        x: Of its measured velocity, in [m/s].
        y: As x.
        z: As x.
        accel: Bound on its acceleration, in [m/s²].
        speed: Bound on its speed, in [m/s].
    """
    if not accel > 0.0:
        return math.inf
    return max(speed - math.sqrt(x * x + y * y + z * z), 0.0) / accel
