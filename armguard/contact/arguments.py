"""Checks, broadcasts and packs the array arguments of `earliest` for the kernels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from armguard.exceptions import ArmguardError
from armguard.jit.arrays import FloatArray

MAX_POINTS = 8
PAIR_ARGUMENTS = (
    "p1", "v1", "a1", "s1", "p2", "v2", "a2", "s2", "contact_distance",
    "age1", "age2", "velocity_error1", "velocity_error2", "clock_error1", "clock_error2",
)  # fmt: skip

_FIELDS = ("v", "a", "s", "velocity_error", "age", "clock_error")
"""Arguments of either body, in the order of `Rows`."""


def read_vectors(name: str, value: ArrayLike) -> FloatArray:
    """Vectors of three as float64."""
    array = np.asarray(value, dtype=np.float64)
    if array.ndim < 1 or array.shape[-1] != 3:
        raise ArmguardError(name, f"has the shape {array.shape}", expected="(..., 3)")
    return array


def read_bounds(name: str, value: ArrayLike) -> FloatArray:
    """Numbers as float64; only those of an age may be negative."""
    array = np.asarray(value, dtype=np.float64)
    if (array < 0.0).any() and not name.startswith("age"):  # NaN passes: its pair's time is 0
        index = tuple(int(i) for i in np.argwhere(array < 0.0)[0])
        where = f"{name}[{', '.join(map(str, index))}]" if index else name
        raise ArmguardError(where, f"is {array[index]}", expected="0 or more")
    return array


def check_advances(advances: int) -> int:
    """A number of advances that makes sense."""
    if isinstance(advances, bool) or not isinstance(advances, (int, np.integer)) or advances < 1:
        raise ArmguardError("advances", f"is {advances!r}", expected="an integer from 1 on")
    return int(advances)


def _find_common_shape(shapes: dict[str, tuple[int, ...]]) -> tuple[int, ...]:
    """What the shapes of named arguments broadcast to."""
    try:
        return np.broadcast_shapes(*shapes.values())
    except ValueError:
        listing = ", ".join(f"{name} {shape}" for name, shape in shapes.items())
        raise ArmguardError(
            "arguments", f"do not broadcast: {listing}", remedy="make their shapes agree"
        ) from None


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
    """The common shape, and the arrays checked, broadcast, flat and read-only."""
    arrays = {
        name: (read_vectors if name[0] in "pv" and len(name) == 2 else read_bounds)(name, value)
        for name, value in zip(PAIR_ARGUMENTS, values, strict=True)
    }
    hulls = {name: arrays[name].shape[-2:] for name in ("p2", "v2")}
    for name, shape in hulls.items():
        if len(shape) < 2:
            raise ArmguardError(name, f"has the shape {shape}", expected="(..., k, 3)")
    count = max(shape[0] for shape in hulls.values())
    if not 1 <= count <= MAX_POINTS:
        raise ArmguardError("p2", f"has {count} points", expected=f"1 to {MAX_POINTS}")
    _find_common_shape(hulls)
    inner = {"p1": (3,), "v1": (3,), "p2": (count, 3), "v2": (count, 3)}
    common = _find_common_shape(
        {
            name: array.shape[: array.ndim - len(inner.get(name, ()))]
            for name, array in arrays.items()
        }
    )
    flat = {}
    for name, array in arrays.items():
        own = inner.get(name, ())
        flat[name] = np.ascontiguousarray(np.broadcast_to(array, common + own)).reshape((-1, *own))
        # Copied or not, for compiled code it is of one type: each other one would be compiled for.
        flat[name].flags.writeable = False
    one, other = (Rows(*(flat[f"{field}{i}"] for field in _FIELDS)) for i in "12")
    return common, Pairs(flat["p1"], one, flat["p2"], other, flat["contact_distance"])
