"""Checks a certificate of no contact in exact arithmetic, independently of how it was computed.

A certificate lists separating directions and the times at which they take over. While a direction
is in charge, its gap is concave in time, so it is positive throughout if it is positive at the
start and not negative at the end: two inequalities a direction. They are decided in rational
numbers (`fractions`); the few square roots and quotients in them are replaced by rational bounds on
the side that makes the check harder. Not a line is shared with the kernels.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import ArrayLike

from armguard.contact.earliest import Certificate

PRECISION = 160  # bits of a bounded square root or quotient: far below the kernels' slack

Vector = tuple[Fraction, Fraction, Fraction]


@dataclass(frozen=True)
class _Body:
    """One body, or one corner of it, as its stamp describes it; None stands for no bound."""

    position: Vector
    velocity: Vector
    accel: Fraction | None
    top_speed: Fraction | None
    velocity_error: Fraction
    age: Fraction
    clock_error: Fraction


def verify(
    certificate: Certificate,
    p1: ArrayLike,
    v1: ArrayLike,
    a1: float,
    s1: float,
    p2: ArrayLike,
    v2: ArrayLike,
    a2: float,
    s2: float,
    contact_distance: float,
    *,
    age1: float = 0.0,
    age2: float = 0.0,
    velocity_error1: float = 0.0,
    velocity_error2: float = 0.0,
    clock_error1: float = 0.0,
    clock_error2: float = 0.0,
) -> bool:
    """Whether `certificate` proves that there is no contact before its `contact_time`.

    The inputs are those of `armguard.contact.certify`, read as the real numbers they stand for.
    A time of 0 claims nothing and needs no proof.

    Returns:
        True only if every claim holds. False for a wrong, incomplete or malformed certificate and
        for inputs that allow none (NaN, infinite positions, negative bounds).
    """
    contact_time = float(certificate.contact_time)
    if contact_time == 0.0:
        return True
    times = np.asarray(certificate.times, dtype=np.float64)
    directions = np.asarray(certificate.witnesses, dtype=np.float64)
    errors = (velocity_error1, velocity_error2, clock_error1, clock_error2, contact_distance)
    if not (
        contact_time > 0.0
        and times.ndim == 1
        and times.size >= 1
        and directions.shape == (times.size, 3)
        and np.isfinite(times).all()
        and np.isfinite(directions).all()
        and times[0] == 0.0
        and (np.diff(times) > 0.0).all()
        and times[-1] < contact_time
        and all(bound >= 0.0 for bound in (a1, s1, a2, s2, *errors))
    ):
        return False
    try:
        corners = np.asarray(p2, dtype=np.float64).reshape(-1, 3)
        motions = np.broadcast_to(np.asarray(v2, dtype=np.float64).reshape(-1, 3), corners.shape)
        first = _body(p1, v1, a1, s1, velocity_error1, age1, clock_error1)
        others = [
            _body(p, v, a2, s2, velocity_error2, age2, clock_error2)
            for p, v in zip(corners, motions, strict=True)
        ]
        distance = Fraction(float(contact_distance))
    except (OverflowError, ValueError):  # shapes, and what Fraction makes of inf and NaN
        return False
    starts = [Fraction(float(t)) for t in times]
    ends = [*starts[1:], Fraction(contact_time) if contact_time < math.inf else None]
    return bool(others) and all(
        _separates(_vector(direction), first, other, distance, start, end)
        for direction, start, end in zip(directions, starts, ends, strict=True)
        for other in others
    )


def _vector(values: ArrayLike) -> Vector:
    x, y, z = np.asarray(values, dtype=np.float64).tolist()
    return Fraction(x), Fraction(y), Fraction(z)


def _body(
    position: ArrayLike,
    velocity: ArrayLike,
    accel: float,
    speed: float,
    velocity_error: float,
    age: float,
    clock_error: float,
) -> _Body:
    motion = _vector(velocity)
    is_measured = velocity_error < math.inf  # else it may be anything up to the top speed at once
    error = Fraction(float(velocity_error)) if is_measured else Fraction(0)
    top_speed = None if speed == math.inf else Fraction(float(speed))
    square = _dot(motion, motion)
    if is_measured and top_speed is not None and square > (top_speed + error) ** 2:
        top_speed = _root_bounds(square)[1] + error  # the bound is broken: what was seen counts
    return _Body(
        _vector(position),
        motion,
        Fraction(float(accel)) if is_measured and accel < math.inf else None,
        top_speed,
        error,
        Fraction(float(age)),
        Fraction(float(clock_error)),
    )


def _dot(a: Vector, b: Vector) -> Fraction:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _floor(value: Fraction) -> Fraction:
    """The largest dyadic number of about PRECISION bits that is no larger than `value`."""
    unit = _power(PRECISION - value.numerator.bit_length() + value.denominator.bit_length())
    return math.floor(value * unit) / unit


def _root_bounds(square: Fraction) -> tuple[Fraction, Fraction]:
    """Rational numbers just below and above the square root."""
    if square == 0:
        return square, square
    unit = _power(
        PRECISION + (square.denominator.bit_length() - square.numerator.bit_length()) // 2
    )
    root = math.isqrt(math.floor(square * unit * unit))
    return root / unit, (root + 1) / unit


def _power(exponent: int) -> Fraction:
    """Two to an exponent."""
    return Fraction(1 << exponent) if exponent >= 0 else Fraction(1, 1 << -exponent)


def _separates(
    direction: Vector,
    first: _Body,
    other: _Body,
    contact_distance: Fraction,
    start: Fraction,
    end: Fraction | None,
) -> bool:
    """Whether the direction separates the two from `start` on and before `end` (None: for ever)."""
    square = _dot(direction, direction)
    if square == 0:
        return False
    low, high = _root_bounds(square)
    inverse_low, inverse_high = _floor(1 / high), -_floor(-1 / low)

    def lower(value: Fraction) -> Fraction:  # of value / |direction|
        return value * (inverse_low if value >= 0 else inverse_high)

    def upper(value: Fraction) -> Fraction:
        return value * (inverse_high if value >= 0 else inverse_low)

    between = (
        other.position[0] - first.position[0],
        other.position[1] - first.position[1],
        other.position[2] - first.position[2],
    )
    apart = lower(_dot(direction, between)) - contact_distance
    along1 = _dot(direction, first.velocity)
    along2 = -_dot(direction, other.velocity)

    def gap(t: Fraction) -> Fraction | None:
        left = apart
        for body, along in ((first, along1), (other, along2)):
            advance = _advance(body, upper(along), upper(-along), body.age + t)
            drift = _drift(body)
            if advance is None or drift is None:
                return None
            left -= advance + drift
        return left

    at_start = gap(start)
    if at_start is None or not at_start > 0:
        return False
    if end is not None:
        at_end = gap(end)
        return at_end is not None and at_end >= 0
    # For ever: concave and positive, the gap stays so if in the long run it does not shrink.
    long_run = [_final_speed(first, upper(along1)), _final_speed(other, upper(along2))]
    return long_run[0] is not None and long_run[1] is not None and long_run[0] + long_run[1] <= 0


def _advance(body: _Body, closing: Fraction, receding: Fraction, s: Fraction) -> Fraction | None:
    """How far the body can come along the direction in `s` seconds from its stamp; None: anywhere.

    `closing` and `receding` bound its measured speed along the direction and against it.
    """
    if s < 0:
        closing, s = receding, -s
    top = body.top_speed
    speed = closing + body.velocity_error
    if top is None:
        if body.accel is None:
            return None
        return speed * s + body.accel * s * s / 2
    speed = min(speed, top)
    if body.accel is None or speed == top:
        return top * s
    if body.accel * s <= top - speed:
        return speed * s + body.accel * s * s / 2
    return top * s - _floor((top - speed) ** 2 / (2 * body.accel))


def _drift(body: _Body) -> Fraction | None:
    """How far the body can move within its clock error; None: anywhere."""
    if body.clock_error == 0:
        return body.clock_error
    return None if body.top_speed is None else body.top_speed * body.clock_error


def _final_speed(body: _Body, closing: Fraction) -> Fraction | None:
    """The speed along the direction that the body tends to; None if there is no bound."""
    speed = closing + body.velocity_error
    if body.accel == 0:
        return speed if body.top_speed is None else min(speed, body.top_speed)
    return body.top_speed
