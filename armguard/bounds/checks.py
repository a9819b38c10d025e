"""Checks of arguments of motion models, and read-only views of arrays."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from armguard.exceptions import ArmguardError
from armguard.jit.arrays import FloatArray


def check_vector(name: str, values: npt.ArrayLike, length: int) -> FloatArray:
    """The values as float64, refused unless finite and of the right length."""
    try:
        vector = np.ascontiguousarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ArmguardError(name, f"are no numbers: {error}") from error
    if not (np.shape(values) == (length,) and np.isfinite(vector).all()):
        raise ArmguardError(
            name,
            f"have shape {np.shape(values)} or are not finite",
            expected=f"{length} finite numbers",
        )
    return vector


def read_only(array: FloatArray) -> FloatArray:
    """A view of the same memory that cannot be written through."""
    view = array.view()
    view.flags.writeable = False
    return view


def check_question(
    point: npt.ArrayLike, direction: npt.ArrayLike, t: float
) -> tuple[FloatArray, FloatArray]:
    """The point and direction as float64.

    Raises:
        ArmguardError: A wrong shape, a value that is not finite, a direction that is no unit
            vector, or a negative time.
    """
    local = check_vector("point", point, 3)
    along = check_vector("direction", direction, 3)
    if not abs(np.linalg.norm(along) - 1.0) <= 1e-9:
        raise ArmguardError("direction", f"has length {np.linalg.norm(along)}", expected="1")
    check_duration("t", t)
    return local, along


def check_duration(name: str, seconds: float) -> float:
    """A time in [s], refused unless it is finite and not negative."""
    if not 0.0 <= seconds < np.inf:
        raise ArmguardError(name, f"is {seconds} s", expected="finite and not negative")
    return float(seconds)
