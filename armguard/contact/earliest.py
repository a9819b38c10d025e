"""Earliest possible contact of two bounded bodies: the public functions and their contract.

For all float64 inputs, a contact time is never NaN, and never above the exact contact time of the
same inputs read as real numbers; NaN anywhere gives 0. `gap` proves this. In short: any unit vector
proves the absence of contact as long as its gap is positive. So rounding must be accounted for only
in one gap and its root, always on the side of contact:

- from a gap 16 e (e = 2**-53) of all lengths in it are subtracted, against some 13 e lost;
- 16 e of |v| is added to a speed along a direction, so that one which cancels loses nothing;
- a step to the root is shortened by 16 e against 10 e lost, and its sum with the time so far too;
- what is too small or large to round relatively is taken for the worse: TINY, LARGE, SHORTEST.

`advancement` describes how separating directions are chosen, which affects tightness only. This
module checks and broadcasts arguments (`arguments`) and converts clock errors to distances.
Position errors must be added to `contact_distance`.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from armguard.contact.advancement import Trace, row_contact_time
from armguard.contact.arguments import (
    Pairs,
    Rows,
    check_advances,
    read_bounds,
    read_pairs,
    read_vectors,
)
from armguard.contact.bodies import Ball, Bounds
from armguard.contact.gap import clock_drift
from armguard.exceptions import ArmguardError
from armguard.jit.arrays import FloatArray
from armguard.jit.kernels import kernel
from armguard.jit.numerics import GAP_ROUNDING


class Certificate(NamedTuple):
    """A time before which there is no contact, with all that is needed to prove it.

    `armguard.contact.verify` checks it in exact arithmetic.
    """

    contact_time: float
    """Contact time from now, in [s]; inf if there is never contact."""

    times: FloatArray
    """Time from which each direction is used, in [s], increasing from 0. Shape (k,)."""

    witnesses: FloatArray
    """Separating directions, from body 1 to body 2, of length 1 except for rounding. Shape (k,
    3)."""


@kernel
def _bounds(rows: Rows, row: int) -> Bounds:
    return Bounds(rows.accel[row], rows.speed[row], rows.velocity_error[row], rows.age[row])


@kernel
def _reach(pairs: Pairs, row: int) -> float:
    """A contact distance, and how far bodies get in the time that their stamps may be off by.

    Whichever way a stamp is off, D of `gap` changes by no more than top speed times that time.
    """
    one, other, contact_distance = pairs.one, pairs.other, pairs.contact_distance[row]
    clock1, clock2 = one.clock_error[row], other.clock_error[row]
    if clock1 == 0.0 and clock2 == 0.0:
        return contact_distance
    v1, velocities = one.velocities[row], other.velocities[row]
    drift1 = clock_drift(v1[0], v1[1], v1[2], _bounds(one, row), clock1)
    bounds = _bounds(other, row)
    drift2 = 0.0
    for j in range(velocities.shape[0]):
        drift = clock_drift(velocities[j, 0], velocities[j, 1], velocities[j, 2], bounds, clock2)
        if not drift <= drift2:  # NaN stays: the sum is NaN with it
            drift2 = drift
            if math.isnan(drift):
                break
    return (contact_distance + drift1 + drift2) * (1.0 + GAP_ROUNDING)


@kernel
def _ball(pairs: Pairs, row: int) -> Ball:
    p, v = pairs.places, pairs.one.velocities
    return Ball(
        p[row, 0], p[row, 1], p[row, 2], v[row, 0], v[row, 1], v[row, 2], _bounds(pairs.one, row)
    )


@kernel
def _pair_loop(pairs: Pairs, advances: int, trace: Trace, out: FloatArray) -> None:
    other = pairs.other
    for i in range(out.size):
        out[i] = row_contact_time(
            _ball(pairs, i), pairs.corners, other.velocities, i, pairs.corners.shape[1],
            _bounds(other, i), _reach(pairs, i), advances, trace,
        )  # fmt: skip


def earliest_contact(
    position: ArrayLike,
    velocity: ArrayLike,
    contact_distance: ArrayLike,
    accel: ArrayLike,
    speed: ArrayLike = math.inf,
    *,
    advances: int = 8,
) -> Any:
    """Earliest time at which two bounded bodies could touch, from their relative motion.

    A lower bound on the first t with |x(t)| <= contact_distance over every relative motion whose
    acceleration stays within `accel` and whose speed stays within `speed`. All arguments broadcast.

    Args:
        position: Position of one body relative to the other, in [m]. Shape (..., 3).
        velocity: Its derivative, in [m/s]. Shape (..., 3).
        contact_distance: Centre distance at contact, in [m], 0 or more. Shape (...).
        accel: Bound on the relative acceleration, in [m/s^2], inf if there is none. Shape (...).
        speed: Bound on the relative speed, in [m/s], inf if there is none. Shape (...).
        advances: Greatest number of advances; more give a tighter time, and every number is safe.

    Returns:
        Times in [s]; 0 if contact is possible now or any input is NaN, inf if it is never possible.
        Shape (...); a float if every argument is scalar.

    Raises:
        ArmguardError: A bound or distance is negative, or shapes do not fit.
    """
    still = np.zeros(3)
    return earliest_contact_pair(
        still, still, 0.0, 0.0,
        read_vectors("position", position), read_vectors("velocity", velocity),
        read_bounds("accel", accel), read_bounds("speed", speed),
        read_bounds("contact_distance", contact_distance), advances=advances,
    )  # fmt: skip


def earliest_contact_pair(
    p1: ArrayLike,
    v1: ArrayLike,
    a1: ArrayLike,
    s1: ArrayLike,
    p2: ArrayLike,
    v2: ArrayLike,
    a2: ArrayLike,
    s2: ArrayLike,
    contact_distance: ArrayLike,
    *,
    age1: ArrayLike = 0.0,
    age2: ArrayLike = 0.0,
    velocity_error1: ArrayLike = 0.0,
    velocity_error2: ArrayLike = 0.0,
    clock_error1: ArrayLike = 0.0,
    clock_error2: ArrayLike = 0.0,
    advances: int = 8,
) -> Any:
    """Earliest time at which two bodies could touch, each with its own bounds (all broadcast).

    Tighter than the relative form with the bounds added up.

    Args:
        p1: Position of body 1 at its stamp, in [m]. Shape (..., 3).
        v1: Its velocity, in [m/s]. Shape (..., 3).
        a1: Bound on its acceleration, in [m/s^2], inf if there is none. Shape (...).
        s1: Bound on its speed, in [m/s], inf if there is none. If the measured speed is greater,
            the measured speed plus its error is the bound. Shape (...).
        p2: As for body 1. Shape (..., 3).
        v2: As for body 1. Shape (..., 3).
        a2: As for body 1. Shape (...).
        s2: As for body 1. Shape (...).
        contact_distance: Both radii, margin and position errors, in [m]. Shape (...).
        age1: Now minus the stamp of body 1, in [s], negative for a newer one. Shape (...).
        age2: As for body 1. Shape (...).
        velocity_error1: Greatest error of the velocity of body 1, in [m/s]. Shape (...).
        velocity_error2: As for body 1. Shape (...).
        clock_error1: Greatest error of the stamp of body 1, either way, in [s]. It adds the
            distance that the body can move in this time at its speed bound. Shape (...).
        clock_error2: As for body 1. Shape (...).
        advances: Greatest number of advances; more give a tighter time, and every number is safe.

    Returns:
        Times from now in [s]; 0 if contact is possible now or any input is NaN, inf if it is never
        possible. Shape (...); a float if every argument is scalar.

    Raises:
        ArmguardError: A bound, error or distance is negative, or shapes do not fit.
    """
    return earliest_contact_hull(
        p1, v1, a1, s1,
        read_vectors("p2", p2)[..., None, :], read_vectors("v2", v2)[..., None, :], a2, s2,
        contact_distance, age1=age1, age2=age2,
        velocity_error1=velocity_error1, velocity_error2=velocity_error2,
        clock_error1=clock_error1, clock_error2=clock_error2, advances=advances,
    )  # fmt: skip


def earliest_contact_hull(
    p1: ArrayLike,
    v1: ArrayLike,
    a1: ArrayLike,
    s1: ArrayLike,
    p2: ArrayLike,
    v2: ArrayLike,
    a2: ArrayLike,
    s2: ArrayLike,
    contact_distance: ArrayLike,
    *,
    age1: ArrayLike = 0.0,
    age2: ArrayLike = 0.0,
    velocity_error1: ArrayLike = 0.0,
    velocity_error2: ArrayLike = 0.0,
    clock_error1: ArrayLike = 0.0,
    clock_error2: ArrayLike = 0.0,
    advances: int = 8,
) -> Any:
    """`earliest_contact_pair` with the rounded hull of up to eight moving points as body 2.

    All arguments are as there, except that `p2` and `v2` have the shape (..., k, 3): k = 1 is a
    ball, 2 a capsule, 8 a box. Bounds, age and error of body 2 hold for each of its points.
    """
    steps = check_advances(advances)
    shape, pairs = read_pairs(
        p1, v1, a1, s1, p2, v2, a2, s2, contact_distance,
        age1, age2, velocity_error1, velocity_error2, clock_error1, clock_error2,
    )  # fmt: skip
    out = np.empty(math.prod(shape))
    _pair_loop(pairs, steps, None, out)
    return out.reshape(shape) if shape else float(out[0])


def certify(
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
    advances: int = 8,
) -> Certificate:
    """The contact time of one pair with its proof.

    Arguments are as for `earliest_contact_pair`, for a single pair; `p2` and `v2` have the shape
    (3,), or (k, 3) for the rounded hull of up to eight points. The time is the same, to the bit.
    """
    steps = check_advances(advances)
    shape, pairs = read_pairs(
        p1, v1, a1, s1,
        np.atleast_2d(read_vectors("p2", p2)), np.atleast_2d(read_vectors("v2", v2)), a2, s2,
        contact_distance, age1, age2, velocity_error1, velocity_error2, clock_error1, clock_error2,
    )  # fmt: skip
    if shape:
        raise ArmguardError("arguments", f"are {shape} pairs", expected="a single pair")
    trace, out = np.full((steps, 4), math.nan), np.empty(1)
    _pair_loop(pairs, steps, trace, out)
    contact_time = float(out[0])
    used = trace[trace[:, 0] < contact_time]
    used = used[np.diff(used[:, 0], append=contact_time) > 0.0]
    return Certificate(contact_time, used[:, 0].copy(), used[:, 1:].copy())
