"""Buckets of imminence, and the colour of each.

A pair belongs to bucket k = floor(log2(tau / dt)), clipped to 0 ... 15: every bucket is twice as
long as the one before. A colour stands for a time, whatever the rate of the monitor: red within a
tenth of a second, over amber and yellow to green at a few seconds and blue-grey beyond. Colours
between these are mixed in Oklab, so that equal steps look equal, and lightness
rises from red to yellow and falls again, so that the scale also works without telling red from
green.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

BUCKET_COUNT = 16
NO_BUCKET = 255
"""Stands for "takes part in no pair that is being watched"."""

NO_BUCKET_COLOUR = "#6f7d8c"
REFUSED_COLOUR = "#d65cff"

# [s] at the start of a bucket, and its colour.
_ANCHORS = (
    (0.064, "#f0142f"),
    (0.25, "#ff6a13"),
    (0.5, "#ffab0f"),
    (1.0, "#ffe23d"),
    (2.0, "#a4dc3f"),
    (4.0, "#3fb871"),
    (8.0, "#3f8f96"),
    (16.0, "#64788c"),
)

_OKLAB_FROM_LINEAR = np.array(
    [
        [0.4122214708, 0.5363325363, 0.0514459929],
        [0.2119034982, 0.6806995451, 0.1073969566],
        [0.0883024619, 0.2817188376, 0.6299787005],
    ]
)


def compute_buckets(contact_times: ArrayLike, period: float) -> NDArray[np.uint8]:
    """The bucket of each contact time.

    Args:
        contact_times: Earliest contact, in [s]. NaN is unknown and counts as 0. Shape (...).
        period: One tick of the monitor, in [s].

    Returns:
        Buckets 0 (at once) to 15 (far off in time). Shape (...).
    """
    ticks = np.asarray(contact_times, dtype=np.float64) / period
    # An unknown time fails the comparison and becomes the most imminent.
    ticks = np.where(ticks >= 1.0, np.minimum(ticks, 2.0**BUCKET_COUNT), 1.0)
    # frexp is exact at powers of two, where a rounded log2 might not be.
    exponent = np.frexp(ticks)[1] - 1
    buckets: NDArray[np.uint8] = np.minimum(exponent, BUCKET_COUNT - 1).astype(np.uint8)
    return buckets


def compute_colours(period: float) -> NDArray[np.float32]:
    """The colour of every bucket value, `NO_BUCKET` included.

    Args:
        period: One tick of the monitor, in [s].

    Returns:
        sRGB values from 0 to 1, indexed by bucket. Shape (256, 3).
    """
    anchor_times = np.log2([time for time, _ in _ANCHORS])
    anchor_colours = _compute_oklab(np.array([parse_colour(code) for _, code in _ANCHORS]))
    times = np.log2(period) + np.arange(BUCKET_COUNT)
    mixed = np.stack(
        [np.interp(times, anchor_times, anchor_colours[:, axis]) for axis in range(3)], axis=1
    )
    colours = np.tile(parse_colour(NO_BUCKET_COLOUR), (256, 1))
    colours[:BUCKET_COUNT] = _compute_srgb(mixed)
    return colours.astype(np.float32)


def describe_buckets(period: float) -> list[tuple[str, str, float]]:
    """The legend: time range, colour and start in [s] of each step, most imminent first.

    Buckets that share a colour, as those at both ends of the scale do, share a line.

    Args:
        period: One tick of the monitor, in [s].
    """
    codes = [format_colour(colour) for colour in compute_colours(period)[:BUCKET_COUNT]]
    starts = [0] + [k for k in range(1, BUCKET_COUNT) if codes[k] != codes[k - 1]]
    lines = []
    for index, start in enumerate(starts):
        begin = _format_time(period * 2**start)
        if index + 1 == len(starts):
            text = f"over {begin}"
        else:
            end = _format_time(period * 2 ** starts[index + 1])
            number, unit = begin.split()
            text = f"{number if end.endswith(f' {unit}') else begin} to {end}"
            text = text if start else f"under {end}"
        lines.append((text, codes[start], period * 2**start if start else 0.0))
    return lines


def parse_colour(code: str) -> NDArray[np.float64]:
    """An sRGB colour "#rrggbb" as values from 0 to 1. Shape (3,)."""
    return np.array([int(code[i : i + 2], 16) for i in (1, 3, 5)]) / 255.0


def format_colour(colour: NDArray[np.float32]) -> str:
    """The inverse of `parse_colour`."""
    return "#" + "".join(f"{round(float(value) * 255):02x}" for value in colour)


def _format_time(seconds: float) -> str:
    return f"{seconds * 1e3:.3g} ms" if seconds < 0.9995 else f"{seconds:.2g} s"


def _compute_oklab(srgb: NDArray[np.float64]) -> NDArray[np.float64]:
    # The two outer steps of Oklab: interpolation is linear, so its last matrix cancels out.
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    oklab: NDArray[np.float64] = np.cbrt(linear @ _OKLAB_FROM_LINEAR.T)
    return oklab


def _compute_srgb(oklab: NDArray[np.float64]) -> NDArray[np.float64]:
    linear = np.clip(oklab**3 @ np.linalg.inv(_OKLAB_FROM_LINEAR).T, 0.0, 1.0)
    srgb: NDArray[np.float64] = np.where(
        linear <= 0.0031308, linear * 12.92, 1.055 * linear ** (1 / 2.4) - 0.055
    )
    return srgb
