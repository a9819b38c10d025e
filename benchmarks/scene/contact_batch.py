"""The first advances for arrays of pairs, without branches, so that they run side by side.

For sweeps over very many pairs in the relative form: body 2 moves, with one bound on acceleration
and one on speed. The mathematics and the account of its rounding are those of `witness`. Blocks of
pairs are copied into one buffer, so that the compiler can tell that nothing overlaps. Pairs out of
the ordinary (magnitudes beyond COMMON, a speed bound met or broken, no acceleration bound) take no
part: they keep the time 0, which `finish_contact_times` leaves to the scalar kernel, as it does
with pairs that still gain. `benchmarks/bench_contact.py` shows what the rungs cost and bring.
"""

from __future__ import annotations

import math

import numpy as np

from armguard.contact.advancement import ball_contact_time
from armguard.contact.bodies import Ball, Bounds
from armguard.contact.gap import NO_BOUND
from armguard.jit.kernels import kernel
from armguard.jit.numerics import GAP_ROUNDING

BLOCK = 128
COMMON = 1e30
GAIN = 1e-3  # a last advance that brings less than this share has settled its pair: the next
# would bring about the square of it

# Rows of the buffer, each BLOCK long.
X, Y, Z, VX, VY, VZ, DISTANCE, ACCEL, TOP, LENGTH, MARGIN, INVERSE, CARRY, TIME, BEFORE = (
    BLOCK * row for row in range(15)
)
ROWS = 15


@kernel
def _copy(source, first, last, target, row):
    # Views of their own, so that no index can be negative: the loop becomes a plain copy.
    part = source[first:last]
    room = target[row : row + part.size]
    for i in range(part.size):
        room[i] = part[i]


@kernel
def _prepare(buffer):
    """What does not change from advance to advance; a length of NaN keeps a pair out."""
    for i in range(BLOCK):
        x, y, z = buffer[X + i], buffer[Y + i], buffer[Z + i]
        vx, vy, vz = buffer[VX + i], buffer[VY + i], buffer[VZ + i]
        accel, speed, distance = buffer[ACCEL + i], buffer[TOP + i], buffer[DISTANCE + i]
        length = abs(x) + abs(y) + abs(z) + distance
        size = abs(vx) + abs(vy) + abs(vz)
        square = vx * vx + vy * vy + vz * vz
        common = (length > 1.0 / COMMON) & (length < COMMON) & (distance >= 0.0)
        common &= ((size > 1.0 / COMMON) & (size < COMMON)) | (size == 0.0)
        common &= ((accel > 1.0 / COMMON) & (accel < COMMON)) | (accel == 0.0)
        common &= (speed > 1.0 / COMMON) | (speed == 0.0)
        common &= square * (1.0 + GAP_ROUNDING) <= speed * speed
        buffer[LENGTH + i] = length if common else math.nan
        buffer[MARGIN + i] = GAP_ROUNDING * size
        # Only says when top speed is taken to be met, which need not be exact: single will do.
        buffer[INVERSE + i] = np.float32(1.0) / np.float32(accel)
        buffer[TOP + i] = min(speed, NO_BOUND)
        buffer[TIME + i] = 0.0
        buffer[CARRY + i] = 0.0


@kernel
def _advance(buffer):
    """One tangent advance of every pair of the block, as `gap.follow_forward` for one body."""
    for i in range(BLOCK):
        x, y, z = buffer[X + i], buffer[Y + i], buffer[Z + i]
        vx, vy, vz = buffer[VX + i], buffer[VY + i], buffer[VZ + i]
        accel, top, t, carry = (
            buffer[ACCEL + i],
            buffer[TOP + i],
            buffer[TIME + i],
            buffer[CARRY + i],
        )
        px, py, pz = x + vx * carry, y + vy * carry, z + vz * carry
        square = px * px + py * py + pz * pz
        inverse = 1.0 / math.sqrt(square)
        closing = buffer[MARGIN + i] - (px * vx + py * vy + pz * vz) * inverse
        start = min(closing, top)
        bite = (top - start) * buffer[INVERSE + i]
        bite = bite if start < top else 0.0
        until = min(bite, t)
        gain = accel * until
        cruise = top * (t - until)
        fast = abs(start) + gain
        gap = (px * x + py * y + pz * z) * inverse - buffer[DISTANCE + i]
        gap -= until * (start + 0.5 * gain) + cruise
        gap -= GAP_ROUNDING * (buffer[LENGTH + i] + until * fast + cruise)
        left = bite - until
        slope = start + gain + GAP_ROUNDING * fast
        last_gap = gap - left * (slope + 0.5 * accel * left)
        last_gap -= GAP_ROUNDING * (gap + left * (abs(slope) + accel * left))
        is_last = (last_gap > 0.0) & (left < COMMON * COMMON)
        past = left if is_last else 0.0
        rest = last_gap if is_last else gap
        slope = top * (1.0 + GAP_ROUNDING) if is_last else slope
        accel = 0.0 if is_last else accel
        under = slope * slope + 2.0 * accel * rest
        root = math.sqrt(under)
        above = root - slope
        below = slope + root
        above = 2.0 * rest if slope >= 0.0 else above
        below = below if slope >= 0.0 else accel
        after = (t + (past + above / below * (1.0 - GAP_ROUNDING))) * (1.0 - GAP_ROUNDING)
        # Beyond these windows squares may have lost bits; 0 where nothing moves is exact.
        proved = (square > 1e-80) & (square < 1e160) & (gap > 0.0) & (after > t)
        proved &= ((under > 1e-200) & (under < 1e200)) | ((under == 0.0) & (accel == 0.0))
        t = after if proved else t
        buffer[BEFORE + i] = buffer[TIME + i]
        buffer[TIME + i] = t
        buffer[CARRY + i] = min(t, bite)


@kernel
def batch_contact_times(
    x, y, z, vx, vy, vz, contact_distance, accel, speed, advances, times, before
):  # fmt: skip
    """Lower bounds on the contact times of many pairs, after exactly `advances` advances.

    (x, y, z) are positions of body 2 relative to body 1 [m], (vx, vy, vz) their derivatives [m/s],
    contact_distance [m], accel [m/s^2] and speed [m/s] as for `contact.earliest_contact`; float64
    arrays of the shape (n,). `times` takes the bounds in [s], `before` those one advance earlier;
    both 0 where a pair is out of the ordinary, where contact is possible now or where data is NaN.
    One advance is the line-of-centres bound.
    """
    buffer = np.ones(ROWS * BLOCK)
    for first in range(0, times.size, BLOCK):
        last = min(first + BLOCK, times.size)
        _copy(x, first, last, buffer, X)
        _copy(y, first, last, buffer, Y)
        _copy(z, first, last, buffer, Z)
        _copy(vx, first, last, buffer, VX)
        _copy(vy, first, last, buffer, VY)
        _copy(vz, first, last, buffer, VZ)
        _copy(contact_distance, first, last, buffer, DISTANCE)
        _copy(accel, first, last, buffer, ACCEL)
        _copy(speed, first, last, buffer, TOP)
        _prepare(buffer)
        for _ in range(advances):
            _advance(buffer)
        _copy(buffer, TIME, TIME + last - first, times, first)
        if advances > 1:
            _copy(buffer, BEFORE, BEFORE + last - first, before, first)
    if advances == 1:
        before[:] = 0.0


@kernel
def finish_contact_times(
    x, y, z, vx, vy, vz, contact_distance, accel, speed, advances, times, before
):  # fmt: skip
    """Settle by the scalar kernel what `batch_contact_times` left; returns how many pairs.

    The arguments are the same, with the times it gave; `advances` is the most for one pair.
    """
    finished = 0
    still = Ball(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, Bounds(0.0, 0.0, 0.0, 0.0))
    for i in range(times.size):
        if times[i] > 0.0 and not times[i] - before[i] > GAIN * times[i]:
            continue
        bounds = Bounds(accel[i], speed[i], 0.0, 0.0)
        body = Ball(x[i], y[i], z[i], vx[i], vy[i], vz[i], bounds)
        times[i] = max(
            times[i],
            ball_contact_time(still, body, contact_distance[i], advances, None),
        )
        finished += 1
    return finished
