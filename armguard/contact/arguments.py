"""Arguments of the array faces of `earliest`: checked, broadcast, and laid out for the kernels."""

from __future__ import annotations

from typing import Any

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
    """`array` broadcast to `shape` + `inner` and made flat but for `inner`."""
    return np.ascontiguousarray(np.broadcast_to(array, shape + inner)).reshape((-1, *inner))


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


def read_pairs(*values: ArrayLike) -> tuple[tuple[int, ...], list[FloatArray]]:
    """The common shape, and the arrays checked, broadcast, flat and in the kernels' order."""
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
    bodies = [spread(array, shape, (3,)) for array in vectors.values()]
    corners = [spread(array, shape, (count, 3)) for array in hulls.values()]
    numbers = [spread(array, shape, ()) for array in scalars.values()]
    return shape, [*bodies, *numbers[:5], *corners, *numbers[5:]]
