"""Decides whether a body broke its bounds, and which bounds count for it then.

Two limits decide about a sample that contradicts the one before it. A sample beyond `body_limits`,
which even an athlete's hand keeps, is an error of measurement: no bound grows. A sample between the
stated bounds and these limits is undecided at first. It counts as possible with `BROKEN_FACTOR`
times the observed values as its bounds, until `FURTHER_SAMPLES` more have arrived. If the body
really moved, it is still moving then: its later velocity agrees with at least half of the observed
change. Otherwise it was measured wrongly, and counts with its stated bounds again.

Only a body that really moved keeps wider bounds, for `BROKEN_FOR` seconds of its stamps.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from armguard.jit.arrays import FloatArray, IntArray
from armguard.jit.kernels import kernel, merged_kernel

MAXIMUM_ACCEL = 1000.0
MAXIMUM_SPEED = 100.0
"""Finite bounds above these, in [m/s²] and [m/s], are another unit or no bounds: `inf` says so."""

BODY_LIMITS = 12.0, 200.0
"""Default speed in [m/s] and acceleration in [m/s²] that no part of a person exceeds
(docs/people.md)."""

BROKEN_FACTOR = 1.5
"""Factor by which the observed values count as bounds of a body that broke its bounds."""

BROKEN_FOR = 2.0
"""How long wider bounds count for a body that really moved, in [s] of its stamps."""

FURTHER_SAMPLES = 3
"""Number of further samples that decide whether a body really moved."""

SEEN_WITHIN = 0.1
"""Between samples farther apart than this, in [s], nothing is seen of how a body moved."""


class Breaks(NamedTuple):
    """What each row's samples have shown beyond its bounds."""

    point: FloatArray
    """Where the point that showed most was in the sample that broke a bound, [m]. Shape (rows, 3).
    """
    heading: FloatArray
    """Its velocity before that, [m/s]; 0 where it broke nothing but its speed. Shape (rows, 3)."""
    change: FloatArray
    """What that velocity changed by in the mean, up to that sample, [m/s]. Shape (rows, 3)."""
    error: FloatArray
    """Position error of that sample, [m]. Shape (rows,)."""
    stamp: FloatArray
    """Of that sample, [s]. Shape (rows,)."""
    latest: FloatArray
    """Stamp of the latest sample since, [s]. Shape (rows,)."""
    accel: FloatArray
    """What counts for the sample while undecided, [m/s²]; 0: what is stated. Shape (rows,)."""
    speed: FloatArray
    """What counts alike, [m/s]. Shape (rows,)."""
    moved_accel: FloatArray
    """What counts for each sample of a body that has moved, [m/s²]. Shape (rows,)."""
    moved_speed: FloatArray
    """What counts alike, [m/s]. Shape (rows,)."""
    stated_accel: FloatArray
    """What the source stated when wider bounds counted last, [m/s²]. Shape (rows,)."""
    stated_speed: FloatArray
    """What it stated alike, [m/s]. Shape (rows,)."""
    until: FloatArray
    """Up to which stamp that counts, [s]; -inf: the body kept its bounds. Shape (rows,)."""
    point_index: IntArray
    """Number of the point. Shape (rows,)."""
    further: IntArray
    """How many more samples decide; 0: nothing is undecided. Shape (rows,)."""


def make_breaks() -> Breaks:
    """No rows."""
    points, numbers, counts = np.zeros((0, 3)), np.zeros(0), np.zeros(0, dtype=np.int64)
    return Breaks._make([points] * 3 + [numbers] * 10 + [counts] * 2)


@kernel
def _measure_point(states: Any, row: int, sample: Any, k: int) -> tuple[float, float, float]:
    """Acceleration and speed that a point needed at the least between a state and a later sample.

    Returns:
        What its position needs by acceleration, what its velocity needs, both in [m/s²], and what
        both need by speed, in [m/s].
    """
    elapsed = sample.stamp[0] - states.stamp[row]
    error = states.position_error[row] + sample.position_error[0]
    before, after = states.velocity_error[row], sample.velocity_error[0]
    step2 = stray2 = change2 = velocity2 = 0.0
    for axis in range(3):
        v0, v1 = states.velocities[row, k, axis], sample.velocities[0, k, axis]
        step = sample.points[0, k, axis] - states.points[row, k, axis]
        step2 += step * step
        stray2 += (step - v0 * elapsed) ** 2
        change2 += (v1 - v0) ** 2
        velocity2 += v1 * v1
    speed = max(math.sqrt(velocity2) - after, (math.sqrt(step2) - error) / elapsed)
    changed = (math.sqrt(change2) - before - after) / elapsed
    strayed = 2.0 * (math.sqrt(stray2) - error - before * elapsed) / (elapsed * elapsed)
    return strayed, changed, speed


@kernel
def measure_bounds(states: Any, row: int, sample: Any) -> tuple[float, float]:
    """Acceleration and speed that a body needed at the least between a state and a later sample.

    In [m/s²] and [m/s]; inf where nothing can be said of that.
    """
    elapsed = sample.stamp[0] - states.stamp[row]
    if not (0.0 < elapsed <= SEEN_WITHIN and states.point_count[row] == sample.point_count[0]):
        return math.inf, math.inf
    accel = speed = 0.0
    for k in range(sample.point_count[0]):
        strayed, changed, fast = _measure_point(states, row, sample, k)
        accel, speed = max(accel, strayed, changed), max(speed, fast)
    return accel, speed


@kernel
def begin_break(
    breaks: Breaks, row: int, states: Any, place: int, sample: Any, accel: float, speed: float
) -> None:
    """Let a sample that broke bounds be undecided.

    While another one is, it begins anew if it shows more than what counts for that one.

    Args:
        breaks: Written.
        row: Of the body.
        states: Where the sample before it stands.
        place: Its place there.
        sample: The sample.
        accel: Bound on acceleration that it was measured by, in [m/s²].
        speed: Bound on speed alike, in [m/s].
    """
    seen_accel, seen_speed = measure_bounds(states, place, sample)
    if not sample.stamp[0] <= breaks.until[row]:
        breaks.stated_accel[row], breaks.stated_speed[row] = sample.accel[0], sample.speed[0]
    if (
        breaks.further[row] == 0
        or seen_accel > max(accel, breaks.accel[row])
        or seen_speed > max(speed, breaks.speed[row])
    ):
        breaks.further[row] = FURTHER_SAMPLES
        breaks.stamp[row] = sample.stamp[0]
        breaks.error[row] = sample.position_error[0]
        breaks.accel[row] = breaks.speed[row] = 0.0
        elapsed = sample.stamp[0] - states.stamp[place]
        by_accel = seen_accel > accel
        most, index = -math.inf, 0
        for k in range(sample.point_count[0]):
            strayed, changed, fast = _measure_point(states, place, sample, k)
            shown = max(strayed, changed) if by_accel else fast
            if shown > most:
                most, index = shown, k
        strayed, changed, _ = _measure_point(states, place, sample, index)
        breaks.point_index[row] = index
        for axis in range(3):
            v0 = states.velocities[place, index, axis] if by_accel else 0.0
            step = sample.points[0, index, axis] - states.points[place, index, axis]
            change = step / elapsed - v0
            if by_accel and changed > strayed:
                # From an even change of velocity, half of it in the mean.
                change = 0.5 * (sample.velocities[0, index, axis] - v0)
            breaks.point[row, axis] = sample.points[0, index, axis]
            breaks.heading[row, axis], breaks.change[row, axis] = v0, change
    if seen_accel > accel:
        breaks.accel[row] = max(breaks.accel[row], BROKEN_FACTOR * seen_accel)
    if seen_speed > speed:
        breaks.speed[row] = max(breaks.speed[row], BROKEN_FACTOR * seen_speed)
    breaks.latest[row] = sample.stamp[0]


@kernel
def count_as_moved(breaks: Breaks, row: int, stamp: float, accel: float, speed: float) -> None:
    """Let bounds, in [m/s²] and [m/s], count for a body that has moved until a stamp in [s]."""
    if not stamp <= breaks.until[row]:
        breaks.moved_accel[row] = breaks.moved_speed[row] = 0.0
    breaks.moved_accel[row] = max(breaks.moved_accel[row], accel)
    breaks.moved_speed[row] = max(breaks.moved_speed[row], speed)
    breaks.until[row] = max(breaks.until[row], stamp + BROKEN_FOR)


@kernel
def has_moved(breaks: Breaks, row: int, sample: Any) -> bool:
    """Whether the body that broke its bounds goes on as it must have moved then, by half or more.

    With the velocity w since then, the velocity v0 before and its mean change u up to the sample
    that broke a bound: (w - v0) u >= u² / 2, within what errors of the two positions do to w.
    """
    k, elapsed = breaks.point_index[row], sample.stamp[0] - breaks.stamp[row]
    along = square = 0.0
    for axis in range(3):
        change = breaks.change[row, axis]
        velocity = (sample.points[0, k, axis] - breaks.point[row, axis]) / elapsed
        along += (velocity - breaks.heading[row, axis]) * change
        square += change * change
    slack = (breaks.error[row] + sample.position_error[0]) / elapsed * math.sqrt(square)
    # What is no number has moved, which is the worse of the two.
    return not along + slack < 0.5 * square


@merged_kernel
def count_bounds(sample: Any, accel: float, speed: float) -> None:
    """Let a sample's bounds be no narrower than these, in [m/s²] and [m/s].

    Compared as they are here, what is no number stays none, and is refused as that.
    """
    if sample.accel[0] < accel:
        sample.accel[0] = accel if accel <= MAXIMUM_ACCEL else math.inf
    if sample.speed[0] < speed:
        is_unknown = sample.velocity_error[0] >= sample.speed[0]
        sample.speed[0] = speed if speed <= MAXIMUM_SPEED else math.inf
        if is_unknown:
            # Of its velocity nothing was known but the bound.
            sample.velocity_error[0] = sample.speed[0]
