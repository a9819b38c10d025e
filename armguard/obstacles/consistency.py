"""Tests whether a new measured state is within what an older one allows.

A certificate made from an old state is true as long as the body keeps its bounds. This test
compares any two measurements of an obstacle, including late ones; for the arm see
`robot.joint_history`.

Rounding errs towards acceptance, see `jit.numerics`. NaN never passes.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from armguard.jit.kernels import kernel, merged_kernel
from armguard.jit.numerics import (
    ACCEPTANCE_SLACK,
    ALLOWED,
    POSITION_BY_ACCEL,
    POSITION_BY_SPEED,
    SHAPE,
    VELOCITY_BY_ACCEL,
    VELOCITY_BY_SPEED,
)
from armguard.obstacles.record import Record

SHRINKING = 1.0 - 2.0**-50
"""Factor of a square, below which its root is below that of the whole, however all is rounded."""


class Allowance(NamedTuple):
    """What the bounds of a record allow in the time to another one, whichever of them is older."""

    elapsed: float
    """From record 0 to record 1, in [s]; negative where record 1 is the older one."""
    duration: float
    """Its magnitude, with what rounding of the stamps may hide, in [s]."""
    by_accel: float
    """Departure from uniform motion, with all errors and the radius of record 0, in [m]."""
    by_speed: float
    """Displacement, with the same, in [m]."""
    velocity_change: float
    """With all errors, in [m/s]."""
    top_speed: float
    """With all errors, in [m/s]."""


@merged_kernel
def body_allows(record0: Record, record1: Record) -> int:
    """Whether record 1 of a body can be true if record 0 and its bounds are.

    With h = stamp1 - stamp0, for every point of the hull:
    |x1 - x0 - v0 h| + r1 <= r0 + A h^2 / 2 + dv0 |h| + dp0 + dp1, |x1 - x0| + r1 <= r0 + V |h|
    + dp0 + dp1, |v1 - v0| <= A |h| + dv0 + dv1 and |v1| <= V + dv1, with A and V of record 0.

    Args:
        record0: The one whose bounds count.
        record1: The other, which may be the older one; its bounds play no part.

    Returns:
        ALLOWED (0), or the code of the first bound that is broken.
    """
    if clearly_allows(record0, record1):
        return ALLOWED
    return find_broken_bound(record0, record1)


@merged_kernel
def clearly_allows(record0: Record, record1: Record) -> bool:
    """Whether `find_broken_bound` finds none, without the roots and slacks that seldom decide.

    Slack only widens bounds, where errors and radii are not negative; so what keeps them without it
    keeps them. That takes half as long. NaN is never clear.
    """
    states0, row0, _, _, _ = record0
    states1, row1, radius1, _, _ = record1
    if not _have_same_shape(record0, record1):
        return False
    allowance = _find_allowance(record0, record1)
    elapsed, duration, by_accel, by_speed, velocity_change, top_speed = allowance
    if not duration < math.inf:
        # Then slack is NaN for what stands still.
        return False
    stray_limit = find_square_limit(by_accel - radius1)
    step_limit = find_square_limit(by_speed - radius1)
    change_limit, velocity_limit = find_square_limit(velocity_change), find_square_limit(top_speed)
    for k in range(states0.point_count[row0]):
        stray2 = step2 = change2 = velocity2 = 0.0
        for axis in range(3):
            v0, v1 = states0.velocities[row0, k, axis], states1.velocities[row1, k, axis]
            step = states1.points[row1, k, axis] - states0.points[row0, k, axis]
            stray, change = step - v0 * elapsed, v1 - v0
            step2 += step * step
            stray2 += stray * stray
            change2 += change * change
            velocity2 += v1 * v1
        if not (
            stray2 < stray_limit
            and step2 < step_limit
            and change2 < change_limit
            and velocity2 < velocity_limit
        ):
            return False
    return True


@kernel
def find_broken_bound(record0: Record, record1: Record) -> int:
    """Code of the first bound of a record that another one breaks; see `body_allows`."""
    states0, row0, radius0, _, _ = record0
    states1, row1, radius1, _, _ = record1
    if not _have_same_shape(record0, record1):
        return SHAPE
    allowance = _find_allowance(record0, record1)
    duration = allowance.duration
    room = radius0 + states0.position_error[row0] + states1.position_error[row1]
    clock_slack = ACCEPTANCE_SLACK * (abs(states0.stamp[row0]) + abs(states1.stamp[row1]))
    # Each point by itself; the bounds hold for every one of them.
    for k in range(states0.point_count[row0]):
        # Squared: departure from uniform motion, displacement, change of velocity, and speed;
        # and the magnitudes that rounding goes by.
        stray2 = step2 = change2 = velocity2 = 0.0
        length = rate = 0.0
        for axis in range(3):
            x0, x1 = states0.points[row0, k, axis], states1.points[row1, k, axis]
            v0, v1 = states0.velocities[row0, k, axis], states1.velocities[row1, k, axis]
            step = x1 - x0
            stray = step - v0 * allowance.elapsed
            step2 += step * step
            stray2 += stray * stray
            change2 += (v1 - v0) * (v1 - v0)
            velocity2 += v1 * v1
            length += abs(x0) + abs(x1) + abs(v0) * duration
            rate += abs(v0) + abs(v1)
        slack = ACCEPTANCE_SLACK * (length + room + radius1)
        if not _keeps_bound(stray2, radius1, allowance.by_accel + slack + clock_slack * rate):
            return POSITION_BY_ACCEL
        if not _keeps_bound(step2, radius1, allowance.by_speed + slack):
            return POSITION_BY_SPEED
        if not _keeps_bound(change2, 0.0, allowance.velocity_change + ACCEPTANCE_SLACK * rate):
            return VELOCITY_BY_ACCEL
        top_speed = allowance.top_speed
        if not _keeps_bound(velocity2, 0.0, top_speed + ACCEPTANCE_SLACK * (rate + top_speed)):
            return VELOCITY_BY_SPEED
    return ALLOWED


@merged_kernel
def _have_same_shape(record0: Record, record1: Record) -> bool:
    states0, row0, _, _, _ = record0
    states1, row1, _, _, _ = record1
    count0, count1 = states0.point_count[row0], states1.point_count[row1]
    width0, width1 = states0.points.shape[1], states1.points.shape[1]
    return 1 <= count1 == count0 <= width0 and count1 <= width1


@merged_kernel
def _find_allowance(record0: Record, record1: Record) -> Allowance:
    states0, row0, radius0, accel0, speed0 = record0
    states1, row1, _, _, _ = record1
    stamp0, stamp1 = states0.stamp[row0], states1.stamp[row1]
    velocity_error0, velocity_error1 = states0.velocity_error[row0], states1.velocity_error[row1]
    elapsed = stamp1 - stamp0
    duration = abs(elapsed) + ACCEPTANCE_SLACK * (abs(stamp0) + abs(stamp1))
    # An infinite bound must not meet a duration of zero in a product: that would be NaN.
    by_speed = math.inf if speed0 == math.inf else speed0 * duration
    velocity_change = math.inf if accel0 == math.inf else accel0 * duration
    if accel0 == math.inf or velocity_error0 == math.inf:
        by_accel = math.inf
    else:
        by_accel = (0.5 * accel0 * duration + velocity_error0) * duration
    room = radius0 + states0.position_error[row0] + states1.position_error[row1]
    return Allowance(
        elapsed,
        duration,
        room + by_accel,
        room + by_speed,
        velocity_change + (velocity_error0 + velocity_error1),
        speed0 + velocity_error1,
    )


@merged_kernel
def find_square_limit(room: float) -> float:
    """What a square is below if its root is clearly within a room; 0 where nothing is."""
    return SHRINKING * room * room if room > 0.0 else 0.0


@merged_kernel
def _keeps_bound(square: float, added: float, bound: float) -> bool:
    """Whether a finite length, of which the square is told, and what is added are in a bound."""
    length = math.sqrt(square)
    return length < math.inf and length + added <= bound
