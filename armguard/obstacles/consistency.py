"""Is a new measured state inside what an older one allows?

A certificate made from an old state stays true for as long as the body keeps its bounds. This
test says whether a newer (or late) measurement of an obstacle agrees with that, between any two
records; for the arm see `robot.joint_history`.

Rounding goes towards acceptance, as `jit.numerics` has it. NaN never passes.
"""

from __future__ import annotations

import math

from armguard.jit.kernels import merged_kernel
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


@merged_kernel
def _keeps_bound(square: float, added: float, bound: float) -> bool:
    """Whether a finite length, of which the square is told, and what is added are within a bound.

    Nearly always that is clear without the root, which takes as long as all else.
    """
    room = bound - added
    if room > 0.0 and square < SHRINKING * room * room:
        return True
    length = math.sqrt(square)
    return length < math.inf and length + added <= bound


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
    states0, row0, radius0, accel0, speed0 = record0
    states1, row1, radius1, _, _ = record1
    count0, count1 = states0.point_count[row0], states1.point_count[row1]
    if not (1 <= count1 == count0 <= states0.points.shape[1] and count1 <= states1.points.shape[1]):
        return SHAPE
    stamp0, stamp1 = states0.stamp[row0], states1.stamp[row1]
    velocity_error0, velocity_error1 = states0.velocity_error[row0], states1.velocity_error[row1]
    # What the bounds allow in the time between the records, whichever of them is older.
    elapsed = stamp1 - stamp0
    clock_slack = ACCEPTANCE_SLACK * (abs(stamp0) + abs(stamp1))
    duration = abs(elapsed) + clock_slack
    # An infinite bound must not meet a duration of zero in a product: that would be NaN.
    by_speed = math.inf if speed0 == math.inf else speed0 * duration
    velocity_change = math.inf if accel0 == math.inf else accel0 * duration
    if accel0 == math.inf or velocity_error0 == math.inf:
        by_accel = math.inf
    else:
        by_accel = (0.5 * accel0 * duration + velocity_error0) * duration
    room = radius0 + states0.position_error[row0] + states1.position_error[row1]
    velocity_change += velocity_error0 + velocity_error1
    top_speed = speed0 + velocity_error1
    # Each point by itself; the bounds hold for every one of them.
    for k in range(count0):
        # Squared: departure from uniform motion, displacement, change of velocity, and speed;
        # and the magnitudes that rounding goes by.
        stray2 = step2 = change2 = velocity2 = 0.0
        length = rate = 0.0
        for axis in range(3):
            x0, x1 = states0.points[row0, k, axis], states1.points[row1, k, axis]
            v0, v1 = states0.velocities[row0, k, axis], states1.velocities[row1, k, axis]
            step = x1 - x0
            stray = step - v0 * elapsed
            step2 += step * step
            stray2 += stray * stray
            change2 += (v1 - v0) * (v1 - v0)
            velocity2 += v1 * v1
            length += abs(x0) + abs(x1) + abs(v0) * duration
            rate += abs(v0) + abs(v1)
        bound = room + by_accel + ACCEPTANCE_SLACK * (length + room + radius1) + clock_slack * rate
        if not _keeps_bound(stray2, radius1, bound):
            return POSITION_BY_ACCEL
        bound = room + by_speed + ACCEPTANCE_SLACK * (length + room + radius1)
        if not _keeps_bound(step2, radius1, bound):
            return POSITION_BY_SPEED
        if not _keeps_bound(change2, 0.0, velocity_change + ACCEPTANCE_SLACK * rate):
            return VELOCITY_BY_ACCEL
        fastest = top_speed + ACCEPTANCE_SLACK * (rate + top_speed)
        if not _keeps_bound(velocity2, 0.0, fastest):
            return VELOCITY_BY_SPEED
    return ALLOWED
