"""Timed paths of joints: how the arm would move without obstacles.

A path is a curve through joint positions. A timed path has its own clock, τ in [s], by which the
arm could follow it within its limits. A shield chooses the pace w = dτ/dt of that clock, between 0
and 1, so that

    q̇ = q' w,    q̈ = q'' w² + q' ẇ,    q⃛ = q''' w³ + 3 q'' w ẇ + q' ẅ.

The curve is a cubic spline with continuous second derivatives: q''' is constant between its knots.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from armguard.exceptions import ArmguardError
from armguard.jit.arrays import FloatArray

try:
    from scipy.interpolate import CubicSpline
except ModuleNotFoundError:
    raise ArmguardError(
        "armguard.shield",
        "needs the package scipy, which is not installed",
        remedy="pip install 'armguard[shield]'",
    ) from None

MOST_SAMPLES = 200_000
"""Greatest number of samples of a path; bounds the time to compute it."""

LEAST_STEP = 1e-7
"""Least time between samples of a trajectory, in [s]."""

LONGEST = 1e6
"""Longest duration of a trajectory, in [s]."""

SHARE = 0.5
"""Fraction of the guaranteed braking, and of the jerk, that a timed path uses by itself; the rest
is for changes of the pace."""

SPEEDING = 0.8
"""Greatest fraction of the acceleration that it uses. With strong guaranteed braking, nothing else
would leave acceleration for a greater pace, and an arm at rest would never start."""

PLACES = 256
"""Places between two waypoints at which the fastest timing is sought."""

FOR_BENDS = 0.7
"""How much of the acceleration the bends of a path may use, where its timing is sought."""

KNOT = 0.01
"""Between knots of a curve that was timed here, in [s]."""

SMOOTHEST = 4.0
"""Knots in which an acceleration is built up at least: a curve through fewer would have more jerk
than it needs, and would be stretched for it."""

RESTING = 2.0
"""Knots at rest at the end of a curve: through each its end swings on with a quarter of what its
acceleration was, which would end in a jump."""

SEARCHES = 4
"""Closer and closer looks at where a path comes near a place."""

MOST_FROM_REST = 2.0
"""In accelerations times squares of the first step: how far a trajectory from rest may get."""

SAME_PLACE = 1e-6
"""Places that are no farther apart than this are the same, in [rad] or [m]."""

STRETCH = 1.0 + 1e-9
"""Timings are longer by this much, so that rounding cannot break a limit."""


class MotionLimits(NamedTuple):
    """Limits of a commanded motion. Shape (nv,) each."""

    velocity: FloatArray
    """In [rad]/[s] or [m]/[s]."""
    acceleration: FloatArray
    """Acceleration when joints get faster, in [rad]/[s²] or [m]/[s²]."""
    braking: FloatArray
    """Deceleration when joints get slower, in [rad]/[s²] or [m]/[s²]; guaranteed up to
    `velocity`."""
    jerk: FloatArray
    """In [rad]/[s³] or [m]/[s³]."""


class Path:
    """A curve through joint positions, in the order of `robot.joints`.

    Args:
        q: Positions, in [rad] or [m]: waypoints of a smooth curve, or samples of a trajectory.
            Shape (n, nv), n >= 2.
        times: Times of the samples, in [s], increasing; the arm is at rest at the first and the
            last sample. None: armguard computes a fast timing within limits.

    Raises:
        ArmguardError: The arrays do not fit each other, or have values that are not finite.
    """

    def __init__(self, q: ArrayLike, times: ArrayLike | None = None) -> None:
        self.q = _read("path", q)
        self.times = None if times is None else _read("times of the path", times)
        count = len(self.q) if self.q.ndim == 2 else 0
        if not 2 <= count <= MOST_SAMPLES:
            shape = f"(samples, joints), 2 to {MOST_SAMPLES:,} samples"
            raise ArmguardError("path", f"has the shape {self.q.shape}", expected=shape)
        if self.times is not None and not (
            self.times.shape == (count,)
            and (np.abs(self.times) <= LONGEST).all()
            and (np.diff(self.times) >= LEAST_STEP).all()
        ):
            expected = f"one for each of its {count} samples, rising, {LONGEST:g} s at most"
            raise ArmguardError("times of the path", "do not fit it", expected=expected)


def _read(name: str, values: ArrayLike) -> FloatArray:
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise ArmguardError(name, "is no array of numbers") from None
    if not np.isfinite(array).all():
        raise ArmguardError(name, "has values that are not finite", expected="finite numbers")
    return array


class TimedPath:
    """A path with its own clock: at a pace of 1 or less, all limits hold on it.

    Args:
        path: The curve. It keeps its times if the limits allow; otherwise it is slowed down as a
            whole.
        limits: Limits of the motion.

    Attributes:
        duration: Time from rest to rest, in [s].

    Raises:
        ArmguardError: The path is of other joints, or does not begin and end at rest.
    """

    def __init__(self, path: Path, limits: MotionLimits) -> None:
        joints = len(limits.velocity)
        if path.q.shape[1] != joints:
            found = f"is of {path.q.shape[1]} joints"
            raise ArmguardError("path", found, expected=f"the robot's {joints}")
        own = limits._replace(
            acceleration=np.minimum(SPEEDING * limits.acceleration, SHARE * limits.braking),
            jerk=SHARE * limits.jerk,
        )
        if path.times is None:
            times, q = _find_fastest(path.q, own)
        else:
            times, q = path.times - path.times[0], path.q
            _check_rest(times, q, limits)
        curve = CubicSpline(times, q, bc_type="clamped")
        stretch = _find_stretch(curve, own)
        if stretch > 1.0 or (path.times is None and stretch > 0.0):
            curve = CubicSpline(times * stretch, q, bc_type="clamped")
        self.duration = float(curve.x[-1])
        self._knots, self._coefficients = curve.x, curve.c

    def evaluate(self, at: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Positions, and their first three derivatives by the path's own clock.

        After its end the path rests.

        Args:
            at: Times by that clock, in [s]. Shape (n,).

        Returns:
            q, q', q'' and q''', in [rad] or [m], by [s], [s²] and [s³]. Shape (n, nv) each.
        """
        inside = np.minimum(at, self.duration)
        k = np.minimum(np.searchsorted(self._knots, inside, side="right"), len(self._knots) - 1) - 1
        since = (inside - self._knots[k])[:, None]
        cubic, square, linear, constant = self._coefficients[:, k]
        moves = (at < self.duration)[:, None]
        return (
            ((cubic * since + square) * since + linear) * since + constant,
            ((3.0 * cubic * since + 2.0 * square) * since + linear) * moves,
            (6.0 * cubic * since + 2.0 * square) * moves,
            6.0 * cubic * moves,
        )

    def find_nearest(self, q: FloatArray, first: float, last: float) -> tuple[float, float]:
        """The time, between two times of its clock, at which the path is nearest to a place.

        Args:
            q: The place, in [rad] or [m]. Shape (nv,).
            first: In [s].
            last: In [s].

        Returns:
            The time in [s], and the greatest distance of any joint there.
        """
        low, high = max(first, 0.0), min(last, self.duration)
        for _ in range(SEARCHES):
            at = np.linspace(low, high, PLACES)
            apart = np.abs(self.evaluate(at)[0] - q).max(axis=1)
            nearest = int(apart.argmin())
            low, high = at[max(nearest - 1, 0)], at[min(nearest + 1, PLACES - 1)]
        return float(at[nearest]), float(apart[nearest])


def _check_rest(times: FloatArray, q: FloatArray, limits: MotionLimits) -> None:
    """Refuse a trajectory that does not begin and end at rest.

    From rest a joint gets at most a h² / 2 far in its first step h; as much again is for noise of
    samples, and for what speeds up harder than the limits, which is slowed down as a whole.
    """
    for name, h, moved in (
        ("beginning", times[1] - times[0], q[1] - q[0]),
        ("end", times[-1] - times[-2], q[-1] - q[-2]),
    ):
        most = MOST_FROM_REST * limits.acceleration * h * h
        off = np.flatnonzero(~(np.abs(moved) <= most + SAME_PLACE))
        if len(off):
            j = int(off[0])
            raise ArmguardError(
                f"{name} of the path",
                f"moves: joint {j} by {moved[j]:.4g} in {h:.4g} s",
                expected=f"rest, {most[j]:.4g} at most",
                remedy="a trajectory from rest to rest, or waypoints without times",
            )


def _find_stretch(curve: CubicSpline, limits: MotionLimits) -> float:
    """Factor by which a curve's duration must grow so that all limits hold."""
    slope, bend, turn = (curve.derivative(order) for order in (1, 2, 3))
    h = np.diff(curve.x)[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        # A velocity is quadratic between knots: greatest at one of them, or where it turns.
        turning = np.nan_to_num(np.clip(-bend(curve.x[:-1]) / turn.c[0], 0.0, h))
    inner = slope.c[2] + turning * (slope.c[1] + turning * slope.c[0])
    fastest = np.maximum(np.abs(inner).max(axis=0), np.abs(slope(curve.x)).max(axis=0))
    return STRETCH * max(
        float((fastest / limits.velocity).max()),
        math.sqrt(float((np.abs(bend(curve.x)).max(axis=0) / limits.acceleration).max())),
        math.cbrt(float((np.abs(turn.c[0]).max(axis=0) / limits.jerk).max())),
    )


def _find_fastest(waypoints: FloatArray, limits: MotionLimits) -> tuple[FloatArray, FloatArray]:
    """Samples of a smooth curve through waypoints, timed fast within the limits.

    The curve is a spline by the length of its chords. First its speed is as great as bends allow;
    then speeding up and slowing down are bounded, forwards and backwards; then a mean over time
    bounds the jerk. `TimedPath` stretches what exceeds the limits even so.
    """
    apart = np.linalg.norm(np.diff(waypoints, axis=0), axis=1)
    points = waypoints[np.concatenate([[True], apart > 0.0])]
    if len(points) == 1:
        # Nowhere to go: a moment at rest.
        return np.array([0.0, KNOT]), np.repeat(points, 2, axis=0)
    chords = np.concatenate([[0.0], np.cumsum(apart[apart > 0.0])])
    curve = CubicSpline(chords, points, bc_type="natural")
    way = np.linspace(0.0, chords[-1], min(PLACES * len(apart), MOST_SAMPLES) + 1)
    step = way[1]
    slope, bend = np.abs(curve(way, 1)), np.abs(curve(way, 2))
    with np.errstate(divide="ignore", invalid="ignore"):
        # Bends leave something of the acceleration for changes of speed.
        fastest = (limits.velocity / slope).min(axis=1) ** 2
        square = np.minimum(fastest, (FOR_BENDS * limits.acceleration / bend).min(axis=1))
        square[0] = square[-1] = 0.0
        for order in (range(1, len(way)), range(len(way) - 2, -1, -1)):
            before = order.start - order.step
            for k in order:
                left = limits.acceleration - bend[before] * square[before]
                gain = 2.0 * step * float((left / slope[before]).min())
                square[k] = min(square[k], square[before] + gain)
                before = k
    speed = np.sqrt(square)
    passed = np.concatenate([[0.0], np.cumsum(2.0 * step / (speed[1:] + speed[:-1]))])
    # Building up the acceleration with the jerk takes so long.
    width = max(float((limits.acceleration / limits.jerk).max()), SMOOTHEST * KNOT)
    lasting = passed[-1] + width + RESTING * KNOT
    if not lasting <= MOST_SAMPLES * KNOT:
        longest = f"{MOST_SAMPLES * KNOT:g} s at most"
        raise ArmguardError("path", f"takes {passed[-1]:.4g} s", expected=longest)
    times = np.linspace(0.0, lasting, math.ceil(lasting / KNOT) + 4)
    until = _integrate(passed, way, times)
    mean = (until - _integrate(passed, way, times - width)) / width
    return times, curve(np.clip(mean, 0.0, chords[-1]))


def _integrate(passed: FloatArray, way: FloatArray, times: FloatArray) -> FloatArray:
    """The integral until some times of a way that is linear between samples, and rests outside."""
    area = np.concatenate([[0.0], np.cumsum(0.5 * (way[1:] + way[:-1]) * np.diff(passed))])
    inside = np.clip(times, 0.0, passed[-1])
    place = np.interp(inside, passed, way)
    k = np.clip(np.searchsorted(passed, inside, side="right") - 1, 0, len(way) - 2)
    found: FloatArray = area[k] + 0.5 * (inside - passed[k]) * (way[k] + place)
    return found + np.maximum(times - passed[-1], 0.0) * way[-1]
