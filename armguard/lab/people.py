"""Measures speeds and accelerations of people from tracked points, and how often bounds break.

Positions alone are known, with noise, gaps and swapped markers. An acceleration is the second
difference over 30 ms either side, a speed the difference over the same 60 ms; nothing is smoothed
and nothing fitted. That errs upwards in two ways and downwards in one:

- Noise adds to what is there. White noise of σ on each axis is √6 σ / (30 ms)² in an acceleration:
  with a tenth of a millimetre 0.3 m/s² an axis. `Motion.noise` estimates it.
- What is in doubt is kept. Only gaps and jumps are left out, and what is within 50 ms of them. A
  jump is a step between two samples that no motion within 100 m/s² can take (see below), so that no
  bound below that is flattered by what was left out.
- The second difference is the mean acceleration over those 60 ms, weighted by a triangle. What
  lasts 60 ms shows whole, what lasts 30 ms at three quarters, a shake of 8 Hz at 83 %. So a bound
  that was kept is one on that mean: a blow of 10 ms is beyond it. With 20 ms on either side peaks
  are seen better and noise is 2.25 times larger.

Steps d_i = x_(i+1) − x_i of a motion within A differ by at most A dt² |i − j| on each axis. If the
median of the seven steps around one is y away from it, four of the other six are at least y away;
only two of the six are three steps off, so y is at most 2 A dt². A step farther than 2 · 100 m/s² ·
dt² (20 mm at 100 Hz) from that median is a jump.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armguard.exceptions import ArmguardError
from armguard.people.body_parts import BOUNDS, PartBounds

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

HALF_WINDOW = 0.03
"""From the middle of a second difference to its ends, in [s]."""

MARGIN = 0.05
"""How far from gaps and jumps a sample must be to be clean, in [s]."""

JUMP_ACCEL = 100.0
"""What no motion that is taken for a jump keeps to, in [m]/[s]²."""

SLOWEST_RATE = 25.0
"""Below this, in [Hz], differences are means over so long that they hide what a hand does."""


class Motion(NamedTuple):
    """Accelerations and speeds of tracked points, and the clean samples."""

    accel: Array
    """Magnitudes in [m]/[s]², NaN where not known. Shape (frames, n)."""
    speed: Array
    """Magnitudes in [m]/[s], NaN where not known. Shape (frames, n)."""
    is_clean: Flags
    """Far enough from gaps, jumps and both ends. Shape (frames, n)."""
    is_seen: Flags
    """Whether there is a position at all. Shape (frames, n)."""
    noise: Array
    """What noise makes of a point at rest, in [m]/[s]², root of the mean square. Shape (n,)."""


class BoundReport(NamedTuple):
    """What was measured of one part of the body, beside its bounds."""

    seen: int
    """Samples with a position."""
    clean: int
    """Those that count."""
    accel: tuple[float, float, float]
    """Percentiles 99 and 99.9 and the maximum, in [m]/[s]²; NaN without clean samples."""
    speed: tuple[float, float, float]
    """Percentiles 99 and 99.9 and the maximum, in [m]/[s]; NaN without clean samples."""
    accel_broken: float
    """Share of clean samples above the bound on acceleration; NaN without clean samples."""
    speed_broken: float
    """Share of clean samples above the bound on speed; NaN without clean samples."""
    broken: float
    """Share of clean samples above either; NaN without clean samples."""


def measure_motion(position: ArrayLike, rate: float, half_window: float = HALF_WINDOW) -> Motion:
    """Accelerations and speeds of tracked points.

    Args:
        position: NaN where a point was not seen, in [m]. Shape (frames, n, 3).
        rate: Samples a second, in [Hz], at least 25.
        half_window: From the middle of each difference to its ends, in [s]; rounded to whole
            samples, one at least.

    Raises:
        ArmguardError: Something of this is malformed; the message names it.
    """
    points = np.asarray(position, dtype=np.float64)
    if points.ndim != 3 or points.shape[2] != 3:
        raise ArmguardError("position", f"has shape {points.shape}", expected="(frames, n, 3)")
    if not (SLOWEST_RATE <= rate < math.inf):
        raise ArmguardError(
            "rate", f"is {rate}", expected=f"at least {SLOWEST_RATE:g} Hz, and finite"
        )
    if not (0.0 < half_window <= MARGIN):
        raise ArmguardError(
            "half_window", f"is {half_window}", expected=f"above 0 and at most {MARGIN:g} s"
        )
    count = len(points)
    lag = max(1, round(half_window * rate))
    accel, speed = np.full((2, *points.shape[:2]), np.nan)
    if count > 2 * lag:
        before, here, after = points[: -2 * lag], points[lag:-lag], points[2 * lag :]
        accel[lag:-lag] = np.linalg.norm(after - 2.0 * here + before, axis=2) * (rate / lag) ** 2
        speed[lag:-lag] = np.linalg.norm(after - before, axis=2) * rate / (2 * lag)
    is_seen: Flags = np.all(np.isfinite(points), axis=2)
    dubious: Flags = ~is_seen
    jumps = _find_jumps(points, rate)
    dubious[:-1] |= jumps
    dubious[1:] |= jumps
    is_clean: Flags = ~_spread(dubious, math.ceil(MARGIN * rate)) & np.isfinite(accel)
    return Motion(accel, speed, is_clean, is_seen, _estimate_noise(points, rate, lag))


def check_bounds(
    motions: Iterable[tuple[Motion, Sequence[str]]], bounds: Mapping[str, PartBounds] = BOUNDS
) -> dict[str, BoundReport]:
    """How often clean samples break the bounds of their part.

    Args:
        motions: Recordings, each with the part of the body that each of its points is.
        bounds: By part.

    Returns:
        By part, in the order of `bounds`: those of which there is a point.

    Raises:
        ArmguardError: A part has no bounds, or a recording has more or fewer points than parts.
    """
    seen = dict.fromkeys(bounds, 0)
    samples: dict[str, list[Array]] = {part: [] for part in bounds}
    for motion, parts in motions:
        if len(parts) != motion.accel.shape[1]:
            raise ArmguardError(
                "parts", f"has {len(parts)} names", expected=f"one for {motion.accel.shape[1]}"
            )
        for column, part in enumerate(parts):
            if part not in bounds:
                raise ArmguardError(
                    f"part {part!r}", "has no bounds", expected=f"one of {', '.join(bounds)}"
                )
            clean = motion.is_clean[:, column]
            seen[part] += int(motion.is_seen[:, column].sum())
            samples[part].append(
                np.stack([motion.accel[clean, column], motion.speed[clean, column]])
            )
    return {
        part: _report(seen[part], np.hstack(samples[part]), bounds[part])
        for part in bounds
        if samples[part]
    }


def _report(seen: int, samples: Array, bound: PartBounds) -> BoundReport:
    clean = samples.shape[1]
    if clean == 0:
        unknown = (math.nan,) * 3
        return BoundReport(seen, 0, unknown, unknown, math.nan, math.nan, math.nan)
    # What is NaN keeps to no bound.
    too_hard, too_fast = ~(samples <= np.array([[bound.accel], [bound.speed]]))
    accel, speed = np.percentile(samples, [99.0, 99.9, 100.0], axis=1).T.tolist()
    return BoundReport(
        seen,
        clean,
        tuple(accel),
        tuple(speed),
        float(too_hard.mean()),
        float(too_fast.mean()),
        float((too_hard | too_fast).mean()),
    )


def _find_jumps(points: Array, rate: float) -> Flags:
    """Steps between neighbouring samples that no motion takes. Shape (frames − 1, n)."""
    steps = np.diff(points, axis=0)
    beyond = np.full((3, *points.shape[1:]), np.nan)
    padded = np.concatenate([beyond, steps, beyond])
    around = np.stack([padded[k : k + len(steps)] for k in range(7)])
    # A step that is not known is no jump, and needs no median.
    around[3] = np.where(np.isnan(steps), 0.0, steps)
    farthest = np.abs(steps - np.nanmedian(around, axis=0)).max(axis=2)
    found: Flags = farthest > 2.0 * JUMP_ACCEL / rate**2
    return found


def _spread(flags: Flags, reach: int) -> Flags:
    """Flags, and all within `reach` samples of one."""
    spread = flags.copy()
    for lag in range(1, min(reach, len(flags) - 1) + 1):
        spread[lag:] |= flags[:-lag]
        spread[:-lag] |= flags[lag:]
    return spread


def _estimate_noise(points: Array, rate: float, lag: int) -> Array:
    """What white noise adds to accelerations, from the median of fourth differences.

    In those, motion of people is gone and noise is √70 times what it is in positions; the median
    is unmoved by gaps and jumps.
    """
    noise = np.full(points.shape[1], np.nan)
    fourth = np.abs(np.diff(points, 4, axis=0))
    for column in range(points.shape[1]):
        known = fourth[np.isfinite(fourth[:, column]).all(axis=1), column]
        if len(known):
            sigma = np.median(known, axis=0) / 0.6745 / math.sqrt(70.0)
            noise[column] = math.sqrt(6.0) * np.linalg.norm(sigma) * (rate / lag) ** 2
    return noise
