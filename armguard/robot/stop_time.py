"""How long the arm takes to come to rest, at most."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armguard.jit.kernels import kernel


@kernel
def compute_stop_time(
    velocity: NDArray[np.float64],
    velocity_error: NDArray[np.float64],
    velocity_limit: NDArray[np.float64],
    acceleration_limit: NDArray[np.float64],
    braking_deceleration: NDArray[np.float64],
    age: float,
    horizon: float,
    reaction_time: float,
) -> float:
    """Time in which every joint surely comes to rest, in [s] from now.

    Until braking begins, a joint may speed up at its acceleration limit from its measured speed,
    but never beyond its velocity limit (or its measured speed, if that is larger within errors).

    Args:
        velocity: Measured joint velocities, [rad/s] or [m/s]. Shape (nv,).
        velocity_error: What they may be off by, [rad/s] or [m/s]. Shape (nv,).
        velocity_limit: Velocity limits, [rad/s] or [m/s]. Shape (nv,).
        acceleration_limit: Acceleration limits, [rad/s²] or [m/s²]. Shape (nv,).
        braking_deceleration: Guaranteed decelerations, [rad/s²] or [m/s²]. Shape (nv,).
        age: How long ago the state was measured, in [s]; negative where it is yet to be.
        horizon: Period plus latency, in [s]: until the verdict after this one is obeyed.
        reaction_time: From command to braking torque, in [s].
    """
    slowest = 0.0
    # The longest time, either way, between the stamp and the moment when braking begins.
    free = max(max(age, 0.0) + horizon + reaction_time, -age)
    for i in range(velocity.shape[0]):
        limit = max(velocity_limit[i], abs(velocity[i]))
        speed = min(limit, abs(velocity[i]) + velocity_error[i] + acceleration_limit[i] * free)
        slowest = max(slowest, speed / braking_deceleration[i])
    return horizon + reaction_time + slowest
