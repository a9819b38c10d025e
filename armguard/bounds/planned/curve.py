"""The curve through the samples of a plan: cubic between samples, as their velocities demand.

On an interval of length h from q0, v0 to q1, v1, u seconds after its beginning (cubic Hermite),

    q = q0 + v0 u + c u² + d u³,   c = (3 (q1 - q0)/h - 2 v0 - v1)/h,
                                   d = (v0 + v1 - 2 (q1 - q0)/h)/h².

Positions and velocities are continuous, and accelerations are linear in between, so they are
greatest at samples. Extremes of all three are elementary; nothing here is sampled.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from armguard.jit.arrays import FloatArray
from armguard.jit.kernels import kernel
from armguard.jit.numerics import TERM_ROUNDING

FINE, POSITION, VELOCITY, RATE, CURVE = 0, 1, 2, 3, 4
"""What `find_excess` can say: nothing, or what is beyond its limit."""


@kernel
def interval_coefficients(
    times: FloatArray, q: FloatArray, v: FloatArray, k: int, j: int
) -> tuple[float, float, float]:
    """Length, c and d of joint j's interval from sample k on."""
    h = times[k + 1] - times[k]
    slope = (q[k + 1, j] - q[k, j]) / h
    return (
        h,
        (3.0 * slope - 2.0 * v[k, j] - v[k + 1, j]) / h,
        (v[k, j] + v[k + 1, j] - 2.0 * slope) / (h * h),
    )


@kernel
def interval_at(times: FloatArray, t: float) -> int:
    """The interval that a time falls into; the first or last one where it is outside."""
    return min(max(np.searchsorted(times, t, side="right") - 1, 0), times.shape[0] - 2)


@kernel
def evaluate_curve(
    times: FloatArray,
    q: FloatArray,
    v: FloatArray,
    t: float,
    position: FloatArray,
    velocity: FloatArray,
) -> None:
    """Fill position and velocity of all joints at a time; that of an end where it is outside.

    Args:
        times: Of the samples, in [s], rising. Shape (k,), k >= 2.
        q: Positions, in [rad] or [m]. Shape (k, nv).
        v: Velocities, in [rad]/[s] or [m]/[s]. Shape (k, nv).
        t: In [s].
        position: Filled. Shape (nv,).
        velocity: Filled. Shape (nv,).
    """
    k = interval_at(times, t)
    u = min(max(t, times[0]), times[-1]) - times[k]
    for j in range(q.shape[1]):
        _, c, d = interval_coefficients(times, q, v, k, j)
        position[j] = q[k, j] + u * (v[k, j] + u * (c + u * d))
        velocity[j] = v[k, j] + u * (2.0 * c + 3.0 * d * u)


@kernel
def _range_within(
    start: float, speed: float, c: float, d: float, first: float, last: float
) -> tuple[float, float]:
    """Least and greatest value of start + speed u + c u² + d u³ for u from first to last."""
    low = math.inf
    high = -math.inf
    square = c * c - 3.0 * d * speed
    root = math.sqrt(square) if square > 0.0 else 0.0
    # Where it turns: the two roots of its derivative, in the form that does not cancel.
    pivot = -(c + math.copysign(root, c))
    turn = pivot / (3.0 * d) if d != 0.0 else first
    other = speed / pivot if pivot != 0.0 else first
    for u in (first, last, min(max(turn, first), last), min(max(other, first), last)):
        value = start + u * (speed + u * (c + u * d))
        low = min(low, value)
        high = max(high, value)
    size = abs(start) + last * (abs(speed) + last * (abs(c) + last * abs(d)))
    return low - TERM_ROUNDING * size, high + TERM_ROUNDING * size


@kernel
def curve_range(
    times: FloatArray,
    q: FloatArray,
    v: FloatArray,
    first: float,
    last: float,
    low: FloatArray,
    high: FloatArray,
) -> None:
    """Fill the least and greatest position of each joint between two times on the curve.

    Args:
        times: As for `evaluate_curve`.
        q: As for `evaluate_curve`.
        v: As for `evaluate_curve`.
        first: In [s], within `times`.
        last: In [s], within `times`, >= first.
        low: Filled, in [rad] or [m]. Shape (nv,).
        high: Filled, in [rad] or [m]. Shape (nv,).
    """
    low[:] = math.inf
    high[:] = -math.inf
    for k in range(interval_at(times, first), interval_at(times, last) + 1):
        for j in range(q.shape[1]):
            h, c, d = interval_coefficients(times, q, v, k, j)
            begin = min(max(first - times[k], 0.0), h)
            end = min(max(last - times[k], 0.0), h)
            least, most = _range_within(q[k, j], v[k, j], c, d, begin, end)
            low[j] = min(low[j], least)
            high[j] = max(high[j], most)


@kernel
def speed_range(
    times: FloatArray,
    q: FloatArray,
    v: FloatArray,
    first: float,
    last: float,
    low: FloatArray,
    high: FloatArray,
) -> None:
    """Fill the least and greatest velocity of each joint between two times on the curve.

    Arguments as for `curve_range`, results in [rad]/[s] or [m]/[s].
    """
    low[:] = math.inf
    high[:] = -math.inf
    for k in range(interval_at(times, first), interval_at(times, last) + 1):
        for j in range(q.shape[1]):
            h, c, d = interval_coefficients(times, q, v, k, j)
            begin = min(max(first - times[k], 0.0), h)
            end = min(max(last - times[k], 0.0), h)
            turn = -c / (3.0 * d) if d != 0.0 else begin
            size = abs(v[k, j]) + h * (2.0 * abs(c) + 3.0 * abs(d) * h)
            for u in (begin, end, min(max(turn, begin), end)):
                speed = v[k, j] + u * (2.0 * c + 3.0 * d * u)
                low[j] = min(low[j], speed - TERM_ROUNDING * size)
                high[j] = max(high[j], speed + TERM_ROUNDING * size)


@kernel
def find_top_speeds(times: FloatArray, q: FloatArray, v: FloatArray) -> FloatArray:
    """The greatest speed of each joint anywhere on the curve, in [rad]/[s] or [m]/[s]. (nv,)."""
    low, high = np.empty(q.shape[1]), np.empty(q.shape[1])
    speed_range(times, q, v, 0.0, times[-1], low, high)
    return np.maximum(high, -low)


@kernel
def _top_speed_within(speed: float, h: float, c: float, d: float) -> float:
    """The greatest speed on an interval of length h that begins at `speed`, as in `speed_range`."""
    turn = -c / (3.0 * d) if d != 0.0 else 0.0
    size = abs(speed) + h * (2.0 * abs(c) + 3.0 * abs(d) * h)
    fastest = 0.0
    for u in (0.0, h, min(max(turn, 0.0), h)):
        fastest = max(fastest, abs(speed + u * (2.0 * c + 3.0 * d * u)) + TERM_ROUNDING * size)
    return fastest


class CurvePeaks(NamedTuple):
    """The most of what each joint does anywhere on a curve. Shape (nv,) each."""

    acceleration: FloatArray
    """Greatest acceleration, in [rad]/[s²] or [m]/[s²]."""
    speed: FloatArray
    """Greatest speed, as `find_top_speeds` has it, in [rad]/[s] or [m]/[s]."""


@kernel
def find_excess(
    times: FloatArray,
    q: FloatArray,
    v: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    fastest: FloatArray,
    acceleration: FloatArray,
    peaks: CurvePeaks,
) -> tuple[int, int, int, float]:
    """The first place where the curve leaves limits, which need not be at a sample.

    Args:
        times: As for `evaluate_curve`.
        q: As for `evaluate_curve`.
        v: As for `evaluate_curve`.
        lower: Least positions, in [rad] or [m]. Shape (nv,).
        upper: Greatest positions, in [rad] or [m]. Shape (nv,).
        fastest: Greatest speeds, in [rad]/[s] or [m]/[s]. Shape (nv,).
        acceleration: Greatest accelerations, in [rad]/[s²] or [m]/[s²]. Shape (nv,).
        peaks: Filled with what the curve does at most, where it is within limits.

    Returns:
        What is beyond its limit, the joint, the sample before, and the value found: FINE; POSITION
        or VELOCITY; RATE, where the velocities of two samples are too far apart; CURVE, where they
        are not, but no motion within the limit on accelerations leads from one position to the
        other as a cubic.
    """
    for j in range(q.shape[1]):
        peaks.acceleration[j] = peaks.speed[j] = 0.0
    for k in range(times.shape[0] - 1):
        for j in range(q.shape[1]):
            h, c, d = interval_coefficients(times, q, v, k, j)
            low, high = _range_within(q[k, j], v[k, j], c, d, 0.0, h)
            if not lower[j] <= low:
                return POSITION, j, k, low
            if not high <= upper[j]:
                return POSITION, j, k, high
            pace = max(abs(v[k, j]), abs(v[k + 1, j]))
            turn = -c / (3.0 * d) if d != 0.0 else 0.0
            if 0.0 < turn < h:
                pace = max(pace, abs(v[k, j] + turn * c))
            if not pace <= fastest[j]:
                return VELOCITY, j, k, pace
            # What rounding of the samples themselves does to the differences below.
            slack = 8.0 * TERM_ROUNDING * ((abs(q[k, j]) + abs(q[k + 1, j])) / h + pace) / h
            allowed = acceleration[j] + slack
            rate = (v[k + 1, j] - v[k, j]) / h
            if not abs(rate) <= allowed:
                return RATE, j, k, rate
            bend = max(abs(2.0 * c), abs(2.0 * c + 6.0 * d * h))
            if not bend <= allowed:
                return CURVE, j, k, bend
            peaks.acceleration[j] = max(peaks.acceleration[j], bend)
            peaks.speed[j] = max(peaks.speed[j], _top_speed_within(v[k, j], h, c, d))
    return FINE, -1, -1, 0.0
