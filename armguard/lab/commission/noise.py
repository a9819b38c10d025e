"""Estimates the noise of samples of a smooth curve, and the curve's slope."""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from armguard.jit.arrays import BoolArray, FloatArray

_KEPT = 0.99
"""Share of second differences that count: the rest may be changes of acceleration."""

KINKED = 3.0
"""A window of positions whose residuals are so many times the usual ones holds a change of
acceleration."""

KINKED_SPEED = 1.35
"""Alike, of speeds: these show it sooner."""


def estimate_noise(values: FloatArray, where: BoolArray | None = None) -> float:
    """Standard deviation of the noise in evenly spaced samples of something smooth.

    From second differences, which a smooth course makes hardly any: three samples in a row give
    noise of six times its variance. The largest hundredth is left out.

    Args:
        values: Shape (n,).
        where: Which samples count; None: all. Shape (n,).
    """
    if len(values) < 3:
        return 0.0
    second = np.abs(values[2:] - 2.0 * values[1:-1] + values[:-2])
    if where is not None and where[1:-1].any():
        second = second[where[1:-1]]
    kept = np.sort(second)[: max(1, int(_KEPT * len(second)))]
    return float(np.sqrt(np.mean(kept * kept) / 6.0))


def fit_windows(
    stamps: FloatArray, values: FloatArray, half: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Fit a parabola to the samples around each one.

    Args:
        stamps: Rising, in [s]. Shape (n,).
        values: Shape (n,).
        half: Samples on either side of the one in the middle, at least 2.

    Returns:
        Value and slope of each parabola in its middle, and the root mean square of what the samples
        are off by. Shape (n − 2 half,) each.
    """
    width = 2 * half + 1
    times, windows = sliding_window_view(stamps, width), sliding_window_view(values, width)
    time = times - times[:, half : half + 1]
    # In units of the window's length, for the sake of the conditions of the equations.
    scale = time[:, -1:] - time[:, :1]
    basis = np.stack([np.ones_like(time), time / scale, (time / scale) ** 2], axis=-1)
    start = windows[:, half : half + 1]
    normal = basis.transpose(0, 2, 1) @ basis
    right = basis.transpose(0, 2, 1) @ (windows - start)[..., None]
    solution = np.linalg.solve(normal, right)
    residuals = (windows - start) - (basis @ solution)[..., 0]
    return (
        solution[:, 0, 0] + start[:, 0],
        solution[:, 1, 0] / scale[:, 0],
        np.sqrt((residuals**2).sum(axis=1) / (width - 3)),
    )


def fit_slopes(stamps: FloatArray, values: FloatArray, width: int) -> FloatArray:
    """Slope of the straight line through each `width` samples in a row. Shape (n − width + 1,)."""
    times, windows = sliding_window_view(stamps, width), sliding_window_view(values, width)
    time = times - times.mean(axis=1, keepdims=True)
    return (time * windows).sum(axis=1) / (time * time).sum(axis=1)
