"""Arguments of the array faces of `earliest`: checked, broadcast, and laid out for the kernels."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from armguard.exceptions import ArmguardError
from armguard.jit.arrays import FloatArray

MAX_POINTS = 8
PAIR_ARGUMENTS = (
    "p1", "v1", "a1", "s1", "p2", "v2", "a2", "s2", "contact_distance",
    "age1", "age2", "velocity_error1", "velocity_error2", "clock_error1", "clock_error2",
)  # fmt: skip


def read_vectors(name: str, value: ArrayLike) -> FloatArray:
    """Vectors of three as float64."""
    array = np.asarray(value, dtype=np.float64)
    if array.ndim < 1 or array.shape[-1] != 3:
        raise ArmguardError(name, f"has the shape {array.shape}", expected="(..., 3)")
    return array


def read_bounds(name: str, value: ArrayLike) -> FloatArray:
    """Numbers that must not be negative as float64."""
    array = np.asarray(value, dtype=np.float64)
    if (array < 0.0).any():  # NaN passes: it makes its pair's time 0
        index = tuple(int(i) for i in np.argwhere(array < 0.0)[0])
        where = f"{name}[{', '.join(map(str, index))}]" if index else name
        raise ArmguardError(where, f"is {array[index]}", expected="0 or more")
    return array


def check_advances(advances: int) -> int:
    """A number of advances that makes sense."""
    if isinstance(advances, bool) or not isinstance(advances, (int, np.integer)) or advances < 1:
        raise ArmguardError("advances", f"is {advances!r}", expected="a whole number from 1 on")
    return int(advances)


def spread(array: FloatArray, shape: tuple[int, ...], inner: tuple[int, ...]) -> FloatArray:
    """`array` broadcast to `shape` + `inner` and made flat but for `inner`; read-only."""
    flat = np.ascontiguousarray(np.broadcast_to(array, shape + inner)).reshape((-1, *inner))
    # Copied or not, for compiled code it is of one type: each other one would be compiled for.
    flat.flags.writeable = False
    return flat


def find_common_shape(shapes: dict[str, tuple[int, ...]]) -> tuple[int, ...]:
    """What the shapes of named arguments broadcast to."""
    try:
        return np.broadcast_shapes(*shapes.values())
    except ValueError:
        listing = ", ".join(f"{name} {shape}" for name, shape in shapes.items())
        raise ArmguardError(
            "arguments", f"do not broadcast: {listing}", remedy="make their shapes agree"
        ) from None


def give_shape(out: FloatArray, shape: tuple[int, ...]) -> Any:
    """Flat results in the shape of the arguments: a float for single ones."""
    return out.reshape(shape) if shape else float(out[0])


class Rows(NamedTuple):
    """One body of each of n pairs, as kernels see them."""

    velocities: FloatArray
    """[m/s]. Shape (n, 3), or (n, k, 3) for hulls."""
    accel: FloatArray
    """[m/s²]. Shape (n,)."""
    speed: FloatArray
    """[m/s]. Shape (n,)."""
    velocity_error: FloatArray
    """[m/s]. Shape (n,)."""
    age: FloatArray
    """[s]. Shape (n,)."""
    clock_error: FloatArray
    """What stamps may be off by, in [s]. Shape (n,)."""


class Pairs(NamedTuple):
    """A ball and a hull each."""

    places: FloatArray
    """Of the balls' centres, in [m]. Shape (n, 3)."""
    one: Rows
    """The balls."""
    corners: FloatArray
    """Of the hulls, in [m]. Shape (n, k, 3)."""
    other: Rows
    """The hulls."""
    contact_distance: FloatArray
    """[m]. Shape (n,)."""


def read_pairs(*values: ArrayLike) -> tuple[tuple[int, ...], Pairs]:
    """The common shape, and the arrays checked, broadcast and flat."""
    given = dict(zip(PAIR_ARGUMENTS, values, strict=True))
    vectors = {name: read_vectors(name, given[name]) for name in ("p1", "v1")}
    hulls = {name: read_vectors(name, given[name]) for name in ("p2", "v2")}
    scalars = {
        name: np.asarray(given[name], dtype=np.float64)
        if name.startswith("age")  # which may be negative
        else read_bounds(name, given[name])
        for name in (
            "a1", "s1", "velocity_error1", "age1", "clock_error1",
            "a2", "s2", "velocity_error2", "age2", "clock_error2", "contact_distance",
        )
    }  # fmt: skip
    for name, array in hulls.items():
        if array.ndim < 2:
            raise ArmguardError(name, f"has the shape {array.shape}", expected="(..., k, 3)")
    count = max(array.shape[-2] for array in hulls.values())
    if not 1 <= count <= MAX_POINTS:
        raise ArmguardError("p2", f"has {count} points", expected=f"1 to {MAX_POINTS}")
    find_common_shape({name: array.shape[-2:] for name, array in hulls.items()})
    shape = find_common_shape(
        {name: array.shape[:-1] for name, array in vectors.items()}
        | {name: array.shape[:-2] for name, array in hulls.items()}
        | {name: array.shape for name, array in scalars.items()}
    )
    places, velocities1 = (spread(array, shape, (3,)) for array in vectors.values())
    corners, velocities2 = (spread(array, shape, (count, 3)) for array in hulls.values())
    numbers = [spread(array, shape, ()) for array in scalars.values()]
    one, other = Rows(velocities1, *numbers[:5]), Rows(velocities2, *numbers[5:10])
    return shape, Pairs(places, one, corners, other, numbers[10])
