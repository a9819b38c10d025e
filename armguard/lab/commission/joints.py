"""Measures speeds, accelerations, errors of states and tracking errors of joints."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from armguard.jit.arrays import FloatArray
from armguard.lab.commission.noise import (
    KINKED,
    KINKED_SPEED,
    estimate_noise,
    fit_slopes,
    fit_windows,
)
from armguard.lab.commission.observations import Observations
from armguard.lab.commission.stops import DEVIATIONS

BETWEEN = 0.02
"""Share that is added to the largest of many samples, for what falls between them."""

LEAST_USED = 0.02
"""A joint that never used so much of its velocity limit tells nothing about its limits."""

_SHARE = 0.05
"""Of an acceleration, that noise may make of it: windows are lengthened until it does not more."""

_LONGEST = 0.1
"""Longest window in which an acceleration is looked for, in [s]."""

_ALIKE = 0.9
"""Of the steepest window, that three windows in a row must be as steep as: else the acceleration
does not last for much longer than a window, whose slope is an average and may be too low."""

_HALVES = (2, 3, 5, 8, 12, 20)
"""Samples on either side of one whose velocity is taken from positions."""


_TINY = 1e-12
"""Residuals that are rounding."""


class KeptLimits(NamedTuple):
    """What one joint kept to, at most."""

    velocity: float
    """[rad/s] or [m/s]."""
    acceleration: float
    """With which it sped up, in [rad/s²] or [m/s²]; NaN where noise hides it, or where it does
    not last for three windows."""
    window: float
    """How long it was looked for at once, in [s]: what is shorter looks lower, and may be missed.
    NaN where noise hides it in the longest, too."""


class StateErrors(NamedTuple):
    """What one joint's states are off by, at most."""

    position: float
    """From what is smooth, in [rad] or [m]; what is constant cannot be seen."""
    velocity: float
    """From the differences of positions, in [rad/s] or [m/s]."""


def measure_limits(seen: Observations, joint: int) -> KeptLimits | None:
    """What a joint kept to; None if it hardly moved."""
    if not seen.find_moving(joint, LEAST_USED).any():
        return None
    stamps, v, period = seen.stamps, seen.v[:, joint], seen.period
    fastest = float(np.abs(v).max())
    noise = estimate_noise(v)
    acceleration, window = np.nan, np.nan
    width = 2
    while width <= max(2, round(_LONGEST / period)) and width <= len(v):
        slopes = fit_slopes(stamps, v, width)
        # Slowing down is not limited by these limits, and an interruption is no slope.
        whole = (stamps[width - 1 :] - stamps[: len(slopes)]) <= 1.5 * (width - 1) * period
        speeding = whole & (slopes * sliding_window_view(v, width).mean(axis=1) > 0.0)
        if not speeding.any():
            break
        spread = noise * np.sqrt(12.0 / (width * (width * width - 1.0))) / period
        steepness = np.where(speeding, np.abs(slopes), 0.0)
        largest = float(steepness.max())
        # Many windows are looked at, so the largest has its share of noise already.
        if spread <= _SHARE * largest / DEVIATIONS:
            window = (width - 1) * period
            if _find_lasting(steepness, width) >= _ALIKE * largest:
                acceleration = largest * (1.0 + BETWEEN)
            break
        width += max(1, width // 4)
    # What is not known may be all that the joint can do.
    most = float(seen.robot.acceleration_limit[joint]) if np.isnan(acceleration) else acceleration
    return KeptLimits(fastest * (1.0 + BETWEEN) + 0.5 * most * period, acceleration, window)


def _find_lasting(steepness: FloatArray, width: int) -> float:
    """The most that three windows in a row, side by side, have in common; 0 if there are none."""
    count = len(steepness) - 2 * width
    if count < 1:
        return 0.0
    rows = [steepness[shift : shift + count] for shift in (0, width, 2 * width)]
    return float(np.min(rows, axis=0).max())


def measure_errors(seen: Observations, joint: int) -> StateErrors | None:
    """What a joint's states are off by; None if there are too few in a row."""
    stamps, q, v, period = seen.stamps, seen.q[:, joint], seen.v[:, joint], seen.period
    moving = seen.find_moving(joint, LEAST_USED)
    # What an encoder's steps do shows only while it moves.
    position_noise, velocity_noise = estimate_noise(q, moving), estimate_noise(v)
    half = _HALVES[0]
    for half in _HALVES:
        # Noise of the slope of a line through so many positions.
        slope_noise = position_noise / (period * np.sqrt(half * (half + 1) * (2 * half + 1) / 3.0))
        if slope_noise <= 0.05 * velocity_noise:
            break
    if len(stamps) <= 2 * half + 1:
        return None
    positions, velocities, residuals = fit_windows(stamps, q, half)
    scatter = fit_windows(stamps, v, half)[2]
    length = stamps[2 * half :] - stamps[: len(positions)]
    usable = length <= 1.5 * 2 * half * period
    # Where the acceleration changes a parabola does not fit, and tells nothing about the state.
    usual = moving[half : len(stamps) - half]
    usual = usual if usual.any() else np.ones_like(usual)
    usable &= residuals <= KINKED * max(float(np.median(residuals[usual])), _TINY)
    usable &= scatter <= KINKED_SPEED * max(float(np.median(scatter[usual])), _TINY)
    if not usable.any():
        return None
    middle = slice(half, len(stamps) - half)
    off_position = np.abs(q[middle] - positions)[usable].max()
    off_velocity = np.abs(v[middle] - velocities)[usable].max()
    return StateErrors(float(off_position) * (1.0 + BETWEEN), float(off_velocity) * (1.0 + BETWEEN))


class TrackingErrors(NamedTuple):
    """How far joints were off their plans, at most."""

    position: FloatArray
    """[rad] or [m]. Shape (nv,)."""
    velocity: FloatArray
    """[rad/s] or [m/s]. Shape (nv,)."""


def measure_tracking(seen: Observations) -> TrackingErrors | None:
    """How far joints were off the plans that they were allowed to do; None if there were none."""
    count = len(seen.robot.joints)
    position, velocity = np.zeros((2, count))
    states = 0
    for plan, ended in seen.plans:
        inside = (seen.stamps >= plan.stamp) & (seen.stamps <= ended)
        elapsed = seen.stamps[inside] - plan.stamp
        on_plan = elapsed <= float(np.asarray(plan.times)[-1])
        planned_q, planned_v = _sample(plan, elapsed[on_plan])
        off = np.abs(seen.q[inside][on_plan] - planned_q)
        off_v = np.abs(seen.v[inside][on_plan] - planned_v)
        states += len(off)
        position = np.maximum(position, off.max(axis=0, initial=0.0))
        velocity = np.maximum(velocity, off_v.max(axis=0, initial=0.0))
    if not states:
        return None
    return TrackingErrors(position * (1.0 + BETWEEN), velocity * (1.0 + BETWEEN))


def _sample(plan: object, times: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The cubic curve through a plan's samples. Shapes (n, nv)."""
    knots, q, v = (np.asarray(getattr(plan, name), float) for name in ("times", "q", "v"))
    place = np.clip(np.searchsorted(knots, times, side="right") - 1, 0, len(knots) - 2)
    length = (knots[place + 1] - knots[place])[:, None]
    s = (times[:, None] - knots[place][:, None]) / length
    rise = q[place + 1] - q[place]
    first, last = length * v[place], length * v[place + 1]
    cubic, square = first + last - 2.0 * rise, 3.0 * rise - 2.0 * first - last
    return (
        q[place] + s * (first + s * (square + s * cubic)),
        (first + s * (2.0 * square + 3.0 * s * cubic)) / length,
    )
