"""The curve through the samples of a plan: cubic between samples, as their velocities demand.

On an interval of length h from q0, v0 to q1, v1, u seconds after its beginning (cubic Hermite),

    q = q0 + v0 u + c u² + d u³,   c = (3 (q1 - q0)/h - 2 v0 - v1)/h,
                                   d = (v0 + v1 - 2 (q1 - q0)/h)/h².

Positions and velocities are continuous, and accelerations are linear in between, so they are
greatest at samples. Extremes of all three are elementary; nothing here is sampled.
"""

from __future__ import annotations

import math

import numpy as np

from armguard.bounds.limits import JointLimits
from armguard.bounds.planned.findings import CURVE, FINE, POSITION, RATE, VELOCITY
from armguard.jit.arrays import FloatArray
from armguard.jit.kernels import kernel, merged_kernel
from armguard.jit.numerics import LIMIT_SLACK, TERM_ROUNDING


@merged_kernel
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


@merged_kernel
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
    order: int,
    low: FloatArray,
    high: FloatArray,
) -> None:
    """Fill the least and greatest position or velocity of each joint between two times.

    Args:
        times: As for `evaluate_curve`.
        q: As for `evaluate_curve`.
        v: As for `evaluate_curve`.
        first: In [s], within `times`.
        last: In [s], within `times`, >= first.
        order: 0: positions, in [rad] or [m]; 1: velocities, in [rad]/[s] or [m]/[s].
        low: Filled. Shape (nv,).
        high: Filled. Shape (nv,).
    """
    low[:] = math.inf
    high[:] = -math.inf
    for k in range(interval_at(times, first), interval_at(times, last) + 1):
        for j in range(q.shape[1]):
            h, c, d = interval_coefficients(times, q, v, k, j)
            begin = min(max(first - times[k], 0.0), h)
            end = min(max(last - times[k], 0.0), h)
            if order == 0:
                least, most = _range_within(q[k, j], v[k, j], c, d, begin, end)
            else:
                least, most = _speed_range_within(v[k, j], c, d, begin, end, h)
            low[j] = min(low[j], least)
            high[j] = max(high[j], most)


@merged_kernel
def _speed_range_within(
    speed: float, c: float, d: float, first: float, last: float, h: float
) -> tuple[float, float]:
    """Least and greatest value of speed + 2 c u + 3 d u² for u from first to last, up to h."""
    low, high = math.inf, -math.inf
    turn = -c / (3.0 * d) if d != 0.0 else first
    size = abs(speed) + h * (2.0 * abs(c) + 3.0 * abs(d) * h)
    for u in (first, last, min(max(turn, first), last)):
        value = speed + u * (2.0 * c + 3.0 * d * u)
        low = min(low, value - TERM_ROUNDING * size)
        high = max(high, value + TERM_ROUNDING * size)
    return low, high


@kernel
def find_top_speeds(times: FloatArray, q: FloatArray, v: FloatArray) -> FloatArray:
    """The greatest speed of each joint anywhere on the curve, in [rad]/[s] or [m]/[s]. (nv,)."""
    low, high = np.empty(q.shape[1]), np.empty(q.shape[1])
    curve_range(times, q, v, 0.0, times[-1], 1, low, high)
    return np.maximum(high, -low)


@kernel
def top_speed_between(before: float, after: float, h: float, c: float, d: float) -> float:
    """The greatest speed on an interval of length h, between samples of these velocities."""
    turn = -c / (3.0 * d) if d != 0.0 else 0.0
    pace = max(abs(before), abs(after))
    return max(pace, abs(before + turn * c)) if 0.0 < turn < h else pace


@kernel
def find_excess(
    times: FloatArray,
    q: FloatArray,
    v: FloatArray,
    limits: JointLimits,
    acceleration: FloatArray,
    speed: FloatArray,
) -> tuple[int, int, float, float, float, float]:
    """The first place where the curve leaves limits with errors, which need not be at a sample.

    Args:
        times: As for `evaluate_curve`.
        q: As for `evaluate_curve`.
        v: As for `evaluate_curve`.
        limits: Of the joints.
        acceleration: Filled with the greatest acceleration of each joint, in [rad]/[s²] or
            [m]/[s²], where the curve is within limits. Shape (nv,).
        speed: Filled with the greatest speeds, as `find_top_speeds` has them. Shape (nv,).

    Returns:
        The fields of a `Finding`: FINE; POSITION or VELOCITY; RATE, where the velocities of two
        samples are too far apart; CURVE, where they are not, but no motion within the limit on
        accelerations leads from one position to the other as a cubic.
    """
    acceleration[:] = 0.0
    speed[:] = 0.0
    for k in range(times.shape[0] - 1):
        for j in range(q.shape[1]):
            h, c, d = interval_coefficients(times, q, v, k, j)
            low, high = _range_within(q[k, j], v[k, j], c, d, 0.0, h)
            least = limits.lower[j] - limits.position_error[j] - LIMIT_SLACK
            most = limits.upper[j] + limits.position_error[j] + LIMIT_SLACK
            if not (least <= low and high <= most):
                return POSITION, j, high if least <= low else low, least, most, times[k]
            pace = top_speed_between(v[k, j], v[k + 1, j], h, c, d)
            fastest = limits.velocity[j] + limits.velocity_error[j] + LIMIT_SLACK
            if not pace <= fastest:
                return VELOCITY, j, pace, 0.0, fastest, times[k]
            # What rounding of the samples themselves does to the differences below.
            slack = 8.0 * TERM_ROUNDING * ((abs(q[k, j]) + abs(q[k + 1, j])) / h + pace) / h
            limit = limits.acceleration[j]
            allowed = limit * (1.0 + LIMIT_SLACK) + slack
            rate = (v[k + 1, j] - v[k, j]) / h
            if not abs(rate) <= allowed:
                return RATE, j, rate, 0.0, limit, times[k]
            bend = max(abs(2.0 * c), abs(2.0 * c + 6.0 * d * h))
            if not bend <= allowed:
                return CURVE, j, bend, 0.0, limit, times[k]
            acceleration[j] = max(acceleration[j], bend)
            least, most = _speed_range_within(v[k, j], c, d, 0.0, h, h)
            speed[j] = max(speed[j], most, -least)
    return FINE, -1, 0.0, 0.0, 0.0, 0.0
