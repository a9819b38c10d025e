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
    operating_acceleration: NDArray[np.float64],
) -> float:
    """Time in which every joint surely comes to rest, in [s] from now.

    Until braking begins, a joint may speed up at its operating acceleration from its measured
    speed, but never beyond its velocity limit (or its measured speed, if that is larger within
    errors). Before a state that is yet to be measured it may have been as much faster as it can
    slow down.

    Args:
        velocity: Measured joint velocities, [rad/s] or [m/s]. Shape (nv,).
        velocity_error: What they may be off by, [rad/s] or [m/s]. Shape (nv,).
        velocity_limit: Velocity limits, or operating ones, [rad/s] or [m/s]. Shape (nv,).
        acceleration_limit: Acceleration limits, [rad/s²] or [m/s²]. Shape (nv,).
        braking_deceleration: Guaranteed decelerations, [rad/s²] or [m/s²]. Shape (nv,).
        age: How long ago the state was measured, in [s]; negative where it is yet to be.
        horizon: Period plus latency, in [s]: until the verdict after this one is obeyed.
        reaction_time: From command to braking torque, in [s].
        operating_acceleration: With which joints speed up, [rad/s²] or [m/s²]; their acceleration
            limits where nothing less is in force. Shape (nv,).
    """
    slowest = 0.0
    # The longest times, either way, between the stamp and the moment when braking begins.
    after, before = max(age, 0.0) + horizon + reaction_time, -age
    for i in range(velocity.shape[0]):
        limit = max(velocity_limit[i], abs(velocity[i]))
        gained = max(operating_acceleration[i] * after, acceleration_limit[i] * before)
        speed = min(limit, abs(velocity[i]) + velocity_error[i] + gained)
        slowest = max(slowest, speed / braking_deceleration[i])
    return horizon + reaction_time + slowest
