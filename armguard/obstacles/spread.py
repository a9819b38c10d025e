"""Tests whether the errors of a body's samples are as small as its source states.

The acceleration bound A of a body limits its motion between samples: with positions x0, x1, x2 at
times h1 and h2 apart and r = h2 / h1, the second difference

    |x2 - x1 - r (x1 - x0)| <= A h2 (h1 + h2) / 2 + (2 + 2 r) dp

if no position error exceeds dp. So three consecutive samples prove that some position error is at
least (second difference - A h2 (h1 + h2) / 2) / (2 + 2 r). Two samples prove the same of the later
velocity, by |v1 - (x1 - x0) / h1| <= A h1 / 2 + 2 dp / h1 + dv.

armguard keeps a running median of these proved errors. It starts at the least of the first ten
samples, rises by 2 % if the next proved error is above it, and falls otherwise. After 50 samples,
errors larger than stated are reported while the median is above 1.5 times the stated error. A body
that keeps its bounds and errors is never reported, since none of its proved errors is above the
stated error. A body with less than half of its samples spoiled by swaps or jumps is very rarely
reported (a jump spoils three): with three in ten spoiled, the median exceeds 1.5 times the stated
error in less than one sample of 10,000,000. A body that always breaks its acceleration bound looks
like one with larger errors. Proved errors are below true errors: normal noise with a deviation of s
along each axis gives about 0.9 s.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from armguard.jit.arrays import BoolArray, FloatArray, IntArray
from armguard.jit.kernels import merged_kernel
from armguard.jit.layout import make_records
from armguard.obstacles.record import Record

STEP = 1.02
"""Factor by which a running median goes up and down."""

TOLD_BEYOND = 1.5
"""Multiple of the stated error above which a running median is reported."""

FEWEST_SAMPLES = 50
"""Number of samples before anything is reported."""

BEGINNING = 10
"""Samples of which a running median begins with the least proved error."""

FORGOTTEN_AFTER = 1.0
"""A sample that is older or newer than the last one by more than this, in [s], starts anew."""

LEAST_ERROR = 1e-9
"""Below the resolution of positions and velocities, in [m] and [m/s], medians stay as they are."""


class Spreads(NamedTuple):
    """State of each row's last samples."""

    last: FloatArray
    """Points of the last sample, [m]. Shape (rows, width, 3)."""
    step: FloatArray
    """How they differ from those of the one before, [m]. Shape (rows, width, 3)."""
    last_stamp: FloatArray
    """[s]. Shape (rows,)."""
    interval: FloatArray
    """Time between these two samples, [s]. Shape (rows,)."""
    position: FloatArray
    """Running median of proved position errors, [m]. Shape (rows,)."""
    velocity: FloatArray
    """Running median of proved velocity errors, [m/s]. Shape (rows,)."""
    position_error: FloatArray
    """Stated with the last sample, or the one before if that is more, [m]. Shape (rows,)."""
    last_error: FloatArray
    """Stated with the last sample, [m]. Shape (rows,)."""
    velocity_error: FloatArray
    """Stated with the last sample, [m/s]. Shape (rows,)."""
    point_count: IntArray
    """Of the last sample. Shape (rows,)."""
    samples: IntArray
    """Since this began, at most `FEWEST_SAMPLES`. Shape (rows,)."""
    is_wide: BoolArray
    """Whether a row is to be reported. Shape (rows,)."""
    wide_count: IntArray
    """How many rows that is. Shape (1,)."""


def make_spreads(rows: int, width: int) -> Spreads:
    """Memory for this many rows of bodies of at most `width` points, without samples."""
    fields: dict[str, tuple[type, tuple[int, ...]]]
    fields = {"last": (float, (width, 3)), "step": (float, (width, 3))}
    fields |= dict.fromkeys(Spreads._fields[2:9], (float, ()))
    fields |= {"point_count": (int, ()), "samples": (int, ()), "is_wide": (bool, ())}
    arrays = make_records(rows, **fields)
    return Spreads._make([*arrays, np.zeros(1, dtype=np.int64)])


def resize_spreads(spreads: Spreads, rows: int, width: int) -> Spreads:
    """The same with more rows or points; unused parts take no memory."""
    resized = make_spreads(rows, width)
    known = np.flatnonzero(spreads.samples)
    for before, after in zip(spreads[:-1], resized[:-1], strict=True):
        if before.ndim > 1:
            after[known, : before.shape[1]] = before[known]
        else:
            after[known] = before[known]
    resized.wide_count[:] = spreads.wide_count
    return resized


@merged_kernel
def forget_spread(spreads: Spreads, row: int) -> None:
    """Begin anew with a row."""
    spreads.samples[row] = 0
    if spreads.is_wide[row]:
        spreads.is_wide[row] = False
        spreads.wide_count[0] -= 1


def describe_spread(spreads: Spreads, row: int, name: str) -> str:
    """The proved error of a row and its stated error."""
    stated = max(spreads.position_error[row], spreads.last_error[row])
    found = spreads.position[row]
    if found > TOLD_BEYOND * stated:
        return f"the spread of {name} is {1e3 * found:.3g} mm, stated {1e3 * stated:.3g} mm"
    found, stated = spreads.velocity[row], spreads.velocity_error[row]
    return f"velocities of {name} are off by {found:.3g} m/s, stated {stated:.3g} m/s"


@merged_kernel
def _follow_median(median: float, value: float, known: int) -> float:
    """The running median after another value, of which so many samples were known before."""
    if known < BEGINNING:
        # One that begins among glitches must not begin there.
        return min(median, value)
    if value > median:
        return max(median, LEAST_ERROR) * STEP
    if median <= LEAST_ERROR:
        return LEAST_ERROR
    return max(median / STEP, LEAST_ERROR)


@merged_kernel
def _find_excess(square: float, room: float) -> float:
    """By how much a length, given by its square, exceeds the allowed length."""
    if room > 0.0 and square < room * room:
        return 0.0
    return max(0.0, math.sqrt(square) - room)


@merged_kernel
def follow_spread(spreads: Spreads, row: int, sample: Record) -> None:
    """Use a valid sample, accepted or not; late ones are ignored.

    Args:
        spreads: Written.
        row: Of the body.
        sample: The sample, with the bound on acceleration and the errors that its source states.
    """
    states, place, _, accel, _ = sample
    count, stamp = states.point_count[place], states.stamp[place]
    position_error, velocity_error = states.position_error[place], states.velocity_error[place]
    known, stated = spreads.samples[row], position_error
    later, earlier = stamp - spreads.last_stamp[row], spreads.interval[row]
    if known > 0 and not (0.0 < later <= FORGOTTEN_AFTER and count == spreads.point_count[row]):
        if -FORGOTTEN_AFTER <= later <= 0.0:
            return
        forget_spread(spreads, row)
        known = 0
    # Squared, of the point where it is most: how far the velocity is from that of the last step,
    # and the second difference. Without so many samples before they mean nothing, and are not used.
    ratio = later / earlier
    drift2 = bend2 = 0.0
    for k in range(count):
        drift = bend = 0.0
        for axis in range(3):
            point = states.points[place, k, axis]
            step = point - spreads.last[row, k, axis]
            drift += (states.velocities[place, k, axis] - step / later) ** 2
            bend += (step - ratio * spreads.step[row, k, axis]) ** 2
            spreads.last[row, k, axis] = point
            spreads.step[row, k, axis] = step
        drift2, bend2 = max(drift2, drift), max(bend2, bend)
    position, velocity = 0.0, spreads.velocity[row]
    if known > 0:
        stated = max(stated, spreads.position_error[row])
        # Two samples: what the later one's velocity must have been off by.
        room = 0.5 * accel * later + 2.0 * max(stated, spreads.position[row]) / later
        proved = _find_excess(drift2, room)
        velocity = _follow_median(math.inf if known == 1 else velocity, proved, known)
    if known > 1:
        # Three samples: what one of their positions must have been off by.
        room = 0.5 * accel * later * (earlier + later)
        proved = max(0.0, _find_excess(bend2, room) / (2.0 + 2.0 * ratio))
        position = math.inf if known == 2 else spreads.position[row]
        position = _follow_median(position, proved, known)
    if known == FEWEST_SAMPLES:
        is_wide = position > TOLD_BEYOND * stated or velocity > TOLD_BEYOND * velocity_error
        if is_wide != spreads.is_wide[row]:
            spreads.is_wide[row] = is_wide
            spreads.wide_count[0] += 1 if is_wide else -1
    spreads.position[row], spreads.velocity[row] = position, velocity
    spreads.position_error[row] = max(position_error, spreads.last_error[row] if known > 0 else 0.0)
    spreads.last_error[row] = position_error
    spreads.velocity_error[row] = velocity_error
    spreads.samples[row] = min(known + 1, FEWEST_SAMPLES)
    spreads.last_stamp[row], spreads.interval[row] = stamp, later
    spreads.point_count[row] = count
