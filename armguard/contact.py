"""Earliest possible contact of two bounded bodies, for arrays and for other kernels.

The array faces check their arguments, broadcast them and run the kernels of `advancement`, which
holds the mathematics and the account of its rounding. Position errors, and a clock error times the
speed it applies to, belong into `contact_distance`; NaN anywhere gives 0.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armguard.advancement import (
    ball_contact_time,
    pair_contact_time,
    pair_distance_time,
    trace_contact_time,
)
from armguard.compilation import kernel
from armguard.exceptions import ArmguardError

__all__ = [
    "Certificate",
    "certify",
    "earliest_contact",
    "earliest_contact_hull",
    "earliest_contact_pair",
    "pair_contact_time",
    "pair_distance_time",
]

MAX_POINTS = 8
PAIR_ARGUMENTS = (
    "p1", "v1", "a1", "s1", "p2", "v2", "a2", "s2", "contact_distance",
    "age1", "age2", "velocity_error1", "velocity_error2",
)  # fmt: skip

Floats = NDArray[np.float64]


class Certificate(NamedTuple):
    """A time before which there is no contact, with all that is needed to prove it.

    `armguard.certificate.verify` checks it in exact arithmetic.
    """

    contact_time: float
    """From now, in [s]; inf if there is never contact."""

    times: Floats
    """When each witness takes over, in [s], from 0 on and rising. Shape (k,)."""

    witnesses: Floats
    """Directions from body 1 to body 2, of length 1 but for rounding. Shape (k, 3)."""


@kernel
def _pair_loop(  # type: ignore[no-untyped-def]
    p1, v1, a1, s1, e1, age1, points, velocities, a2, s2, e2, age2, distance, advances, out
):  # fmt: skip
    count = points.shape[1]
    corners = np.zeros((MAX_POINTS, 3))
    motions = np.zeros((MAX_POINTS, 3))
    for i in range(out.size):
        for j in range(count):
            for k in range(3):
                corners[j, k] = points[i, j, k]
                motions[j, k] = velocities[i, j, k]
        out[i] = pair_contact_time(
            p1[i, 0], p1[i, 1], p1[i, 2], v1[i, 0], v1[i, 1], v1[i, 2],
            a1[i], s1[i], e1[i], age1[i],
            corners, motions, count, a2[i], s2[i], e2[i], age2[i],
            distance[i], advances,
        )  # fmt: skip


@kernel
def _trace_pair(  # type: ignore[no-untyped-def]
    p1, v1, a1, s1, e1, age1, points, velocities, a2, s2, e2, age2, distance, advances, trace
):  # fmt: skip
    return trace_contact_time(
        p1[0, 0], p1[0, 1], p1[0, 2], v1[0, 0], v1[0, 1], v1[0, 2], a1[0], s1[0], e1[0], age1[0],
        points[0], velocities[0], points.shape[1], a2[0], s2[0], e2[0], age2[0],
        distance[0], advances, trace,
    )  # fmt: skip


@kernel
def _relative_loop(position, velocity, distance, accel, speed, advances, out):  # type: ignore[no-untyped-def]
    for i in range(out.size):
        out[i] = ball_contact_time(
            position[i, 0], position[i, 1], position[i, 2], distance[i],
            0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0,
            velocity[i, 0], velocity[i, 1], velocity[i, 2], accel[i], speed[i], 0.0, 0.0,
            advances, None,
        )  # fmt: skip


def _vectors(name: str, value: ArrayLike) -> Floats:
    array = np.asarray(value, dtype=np.float64)
    if array.ndim < 1 or array.shape[-1] != 3:
        raise ArmguardError(name, f"has the shape {array.shape}", expected="(..., 3)")
    return array


def _bounds(name: str, value: ArrayLike) -> Floats:
    array = np.asarray(value, dtype=np.float64)
    if (array < 0.0).any():  # NaN passes: it makes its pair's time 0
        index = tuple(int(i) for i in np.argwhere(array < 0.0)[0])
        where = f"{name}[{', '.join(map(str, index))}]" if index else name
        raise ArmguardError(where, f"is {array[index]}", expected="0 or more")
    return array


def _check_advances(advances: int) -> int:
    if isinstance(advances, bool) or not isinstance(advances, (int, np.integer)) or advances < 1:
        raise ArmguardError("advances", f"is {advances!r}", expected="a whole number from 1 on")
    return int(advances)


def _spread(array: Floats, shape: tuple[int, ...], inner: tuple[int, ...]) -> Floats:
    """`array` broadcast to `shape` + `inner` and made flat but for `inner`."""
    return np.ascontiguousarray(np.broadcast_to(array, shape + inner)).reshape((-1, *inner))


def _common_shape(shapes: dict[str, tuple[int, ...]]) -> tuple[int, ...]:
    try:
        return np.broadcast_shapes(*shapes.values())
    except ValueError:
        listing = ", ".join(f"{name} {shape}" for name, shape in shapes.items())
        raise ArmguardError(
            "arguments", f"do not broadcast: {listing}", remedy="make their shapes agree"
        ) from None


def _shaped(out: Floats, shape: tuple[int, ...]) -> Any:
    return out.reshape(shape) if shape else float(out[0])


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
        position: Of one body relative to the other, in [m]. Shape (..., 3).
        velocity: Its derivative, in [m/s]. Shape (..., 3).
        contact_distance: Centre distance at contact, in [m], 0 or more. Shape (...).
        accel: Bound on the relative acceleration, in [m/s^2], inf if there is none. Shape (...).
        speed: Bound on the relative speed, in [m/s], inf if there is none. Shape (...).
        advances: The most tangent advances: more come closer, and every number is safe.

    Returns:
        Times in [s], 0 where contact is possible now or any input is NaN, inf where it never is.
        Shape (...); a float if every argument is a single one.

    Raises:
        ArmguardError: A bound or distance is negative, or shapes do not fit.
    """
    vectors = {
        "position": _vectors("position", position),
        "velocity": _vectors("velocity", velocity),
    }
    scalars = {
        "contact_distance": _bounds("contact_distance", contact_distance),
        "accel": _bounds("accel", accel),
        "speed": _bounds("speed", speed),
    }
    shape = _common_shape(
        {name: array.shape[:-1] for name, array in vectors.items()}
        | {name: array.shape for name, array in scalars.items()}
    )
    out = np.empty(math.prod(shape))
    _relative_loop(
        *(_spread(array, shape, (3,)) for array in vectors.values()),
        *(_spread(array, shape, ()) for array in scalars.values()),
        _check_advances(advances),
        out,
    )
    return _shaped(out, shape)


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
    advances: int = 8,
) -> Any:
    """Earliest time at which two bodies could touch, each with bounds of its own (all broadcast).

    Tighter than the relative form with the bounds added up.

    Args:
        p1: Position of body 1 at its stamp, in [m]. Shape (..., 3).
        v1: Its velocity, in [m/s]. Shape (..., 3).
        a1: Bound on its acceleration, in [m/s^2], inf if there is none. Shape (...).
        s1: Bound on its speed, in [m/s], inf if there is none. A body that is measured to be
            faster counts with its speed and error instead. Shape (...).
        p2: As for body 1. Shape (..., 3).
        v2: As for body 1. Shape (..., 3).
        a2: As for body 1. Shape (...).
        s2: As for body 1. Shape (...).
        contact_distance: Both radii, margin and position errors, in [m]. Shape (...).
        age1: Now minus the stamp of body 1, in [s], negative for a newer one. Shape (...).
        age2: As for body 1. Shape (...).
        velocity_error1: How far the velocity of body 1 may be off, in [m/s]. Shape (...).
        velocity_error2: As for body 1. Shape (...).
        advances: The most tangent advances: more come closer, and every number is safe.

    Returns:
        Times from now in [s], 0 where contact is possible now or any input is NaN, inf where it
        never is. Shape (...); a float if every argument is a single one.

    Raises:
        ArmguardError: A bound, error or distance is negative, or shapes do not fit.
    """
    return earliest_contact_hull(
        p1, v1, a1, s1,
        _vectors("p2", p2)[..., None, :], _vectors("v2", v2)[..., None, :], a2, s2,
        contact_distance, age1=age1, age2=age2,
        velocity_error1=velocity_error1, velocity_error2=velocity_error2, advances=advances,
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
    advances: int = 8,
) -> Any:
    """`earliest_contact_pair` where body 2 is the rounded hull of up to eight moving points.

    All arguments are as there, but for `p2` and `v2`, whose shape is (..., k, 3): k = 1 is a ball,
    2 a capsule, 8 a box. Bounds, age and error of body 2 hold for each of its points.
    """
    steps = _check_advances(advances)
    shape, arrays = _pair_arrays(
        p1, v1, a1, s1, p2, v2, a2, s2, contact_distance,
        age1, age2, velocity_error1, velocity_error2,
    )  # fmt: skip
    out = np.empty(math.prod(shape))
    _pair_loop(*arrays, steps, out)
    return _shaped(out, shape)


def _pair_arrays(*values: ArrayLike) -> tuple[tuple[int, ...], list[Floats]]:
    """The common shape, and the arrays checked, broadcast, flat and in the kernels' order."""
    given = dict(zip(PAIR_ARGUMENTS, values, strict=True))
    vectors = {name: _vectors(name, given[name]) for name in ("p1", "v1")}
    hulls = {name: _vectors(name, given[name]) for name in ("p2", "v2")}
    scalars = {
        name: np.asarray(given[name], dtype=np.float64)
        if name.startswith("age")  # which may be negative
        else _bounds(name, given[name])
        for name in (
            "a1", "s1", "velocity_error1", "age1", "a2", "s2", "velocity_error2", "age2",
            "contact_distance",
        )
    }  # fmt: skip
    for name, array in hulls.items():
        if array.ndim < 2:
            raise ArmguardError(name, f"has the shape {array.shape}", expected="(..., k, 3)")
    count = max(array.shape[-2] for array in hulls.values())
    if not 1 <= count <= MAX_POINTS:
        raise ArmguardError("p2", f"has {count} points", expected=f"1 to {MAX_POINTS}")
    shape = _common_shape(
        {name: array.shape[:-1] for name, array in vectors.items()}
        | {name: array.shape[:-2] for name, array in hulls.items()}
        | {name: array.shape for name, array in scalars.items()}
    )
    bodies = [_spread(array, shape, (3,)) for array in vectors.values()]
    corners = [_spread(array, shape, (count, 3)) for array in hulls.values()]
    numbers = [_spread(array, shape, ()) for array in scalars.values()]
    return shape, [*bodies, *numbers[:4], *corners, *numbers[4:]]


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
    advances: int = 8,
) -> Certificate:
    """The contact time of one pair together with its proof.

    Arguments are as for `earliest_contact_pair`, for a single pair; `p2` and `v2` have the shape
    (3,), or (k, 3) for the rounded hull of up to eight points. The time is the same, to the bit.
    """
    steps = _check_advances(advances)
    shape, arrays = _pair_arrays(
        p1, v1, a1, s1, np.atleast_2d(_vectors("p2", p2)), np.atleast_2d(_vectors("v2", v2)),
        a2, s2, contact_distance, age1, age2, velocity_error1, velocity_error2,
    )  # fmt: skip
    if shape:
        raise ArmguardError("arguments", f"are {shape} pairs", expected="a single pair")
    trace = np.full((2 * steps, 4), math.nan)
    contact_time = float(_trace_pair(*arrays, steps, trace))
    used = trace[trace[:, 0] < contact_time]
    used = used[np.diff(used[:, 0], append=contact_time) > 0.0]
    return Certificate(contact_time, used[:, 0].copy(), used[:, 1:].copy())
