"""Upper bound on the time until the arm is at rest."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armguard.jit.kernels import kernel
from armguard.robot.brakes import BrakeCurves, find_stop, rest_time

ALL_COVERED = -1
"""Instead of a joint's index, if brakes are stated for all possible speeds."""


@kernel
def speed_at_bite(
    velocity: float,
    velocity_error: float,
    velocity_limit: float,
    acceleration_limit: float,
    operating_acceleration: float,
    after: float,
    before: float,
) -> float:
    """The greatest speed of one joint until its brakes engage, in [rad]/[s] or [m]/[s].

    Args:
        velocity: As it was measured, in [rad]/[s] or [m]/[s].
        velocity_error: What that may be off by.
        velocity_limit: Velocity limit, or operating one.
        acceleration_limit: In [rad]/[s²] or [m]/[s²].
        operating_acceleration: With which it speeds up, in [rad]/[s²] or [m]/[s²].
        after: From the stamp until the bite, in [s].
        before: How much later than now the stamp is, in [s]; negative where it is not.
    """
    limit = max(velocity_limit, abs(velocity))
    gained = max(operating_acceleration * after, acceleration_limit * before)
    return min(limit, abs(velocity) + velocity_error + gained)


@kernel
def compute_stop_time(
    velocity: NDArray[np.float64],
    velocity_error: NDArray[np.float64],
    velocity_limit: NDArray[np.float64],
    acceleration_limit: NDArray[np.float64],
    brakes: BrakeCurves,
    age: float,
    horizon: float,
    reaction_time: float,
    operating_acceleration: NDArray[np.float64],
) -> tuple[float, int]:
    """Stop time: by then every joint is at rest, in [s] from now; and a joint beyond its brakes.

    Until braking begins, a joint can accelerate at its operating acceleration from its measured
    speed, up to its velocity limit (or its measured speed, if that is larger within errors). Before
    a state with a future stamp, it can have been faster by as much as it can decelerate.

    Args:
        velocity: Measured joint velocities, [rad/s] or [m/s]. Shape (nv,).
        velocity_error: What they may be off by, [rad/s] or [m/s]. Shape (nv,).
        velocity_limit: Velocity limits, or operating ones, [rad/s] or [m/s]. Shape (nv,).
        acceleration_limit: Acceleration limits, [rad/s²] or [m/s²]. Shape (nv,).
        brakes: Braking of the joints; speeds beyond their range use the last entry, which proves
            nothing.
        age: How long ago the state was measured, in [s]; negative where it is yet to be.
        horizon: Period plus latency, in [s]: until the verdict after this one is obeyed.
        reaction_time: From command to braking torque, in [s].
        operating_acceleration: With which joints speed up, [rad/s²] or [m/s²]; their acceleration
            limits where nothing less is in force. Shape (nv,).

    Returns:
        The time, and the first joint that may be too fast for its stated brakes when they engage;
        `ALL_COVERED` if there is none.
    """
    slowest, uncovered = 0.0, ALL_COVERED
    last = brakes.speed.shape[1] - 1
    # The longest times, either way, between the stamp and the moment when braking begins.
    after, before = max(age, 0.0) + horizon + reaction_time, -age
    for i in range(velocity.shape[0]):
        speed = speed_at_bite(
            velocity[i],
            velocity_error[i],
            velocity_limit[i],
            acceleration_limit[i],
            operating_acceleration[i],
            after,
            before,
        )
        slowest = max(slowest, rest_time(find_stop(brakes, i, speed), speed))
        if uncovered == ALL_COVERED and not speed <= brakes.speed[i, last]:
            uncovered = i
    return horizon + reaction_time + slowest, uncovered
