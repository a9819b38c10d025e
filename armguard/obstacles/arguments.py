"""Reads arguments of calls on the obstacle table: arrays of the right shape, or an error.

An error is raised only if the whole call is unusable: wrong lengths, shapes or types, repeated ids,
or a stamp that is not a time. The acceptance rule handles wrong numbers of one obstacle.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from armguard.body_regions import NUMBERS, REGIONS
from armguard.exceptions import ObstacleError
from armguard.jit.arrays import FloatArray, IntArray
from armguard.obstacles.regions import NO_REGION
from armguard.obstacles.table import MAXIMUM_POINTS

_FLOAT64 = np.dtype(np.float64)

_SETS = {"": NO_REGION} | {region: 1 << number for region, number in NUMBERS.items()}


def show(value: object) -> str:
    """A value as it was written, short enough for one line."""
    text = repr(value).replace("\n", " ")
    return text if len(text) <= 60 else text[:57] + "..."


def read_ids(ids: Sequence[str]) -> list[str]:
    """Names of obstacles: strings of whole characters, none empty, none twice."""
    if isinstance(ids, (str, bytes)):
        raise ObstacleError("ids", f"is the string {show(ids)}", expected="a list of strings")
    try:
        names = list(ids)
    except TypeError:
        raise ObstacleError("ids", f"is {show(ids)}", expected="a list of strings") from None
    if not {str}.issuperset(map(type, names)):
        for i, name in enumerate(names):
            if not isinstance(name, str):
                raise ObstacleError("ids", f"holds {show(name)}", expected="strings only")
            names[i] = str(name)
    distinct = set(names)
    if "" in distinct:
        raise ObstacleError("ids", "holds an empty string", expected="names")
    if len(distinct) != len(names):
        for name in names:
            # Each is taken out once; a second one is not there any more.
            if name not in distinct:
                break
            distinct.discard(name)
        raise ObstacleError("ids", f"names {show(name)} twice", expected="each id once")
    if not is_writable("".join(names)):
        offender = next(name for name in names if not is_writable(name))
        raise ObstacleError("ids", f"holds {show(offender)}", expected="text that UTF-8 can hold")
    return names


def is_writable(text: str) -> bool:
    """Whether a text can be written: Python's may hold halves of characters, which UTF-8 cannot.

    Such a name could be neither published nor recorded.
    """
    try:
        text.encode()
    except UnicodeEncodeError:
        return False
    return True


def read_time(name: str, value: object) -> float:
    """A finite time, in [s]."""
    if type(value) is float and -math.inf < value < math.inf:
        return value
    time = math.nan
    if isinstance(value, (int, float, np.floating, np.integer)) and not isinstance(value, bool):
        try:
            time = float(value)
        except OverflowError:
            time = math.inf
    if not math.isfinite(time):
        raise ObstacleError(name, f"is {show(value)}", expected="a finite time in [s]")
    return time


def read_bound(name: str, value: object, limit: float, unit: str) -> float:
    """A bound that may be infinite, but finite only up to `limit`, and not negative."""
    if isinstance(value, bool) or not isinstance(value, (int, float, np.floating, np.integer)):
        raise ObstacleError(name, f"is {show(value)}", expected=f"a number in [{unit}]")
    if not value >= 0:
        raise ObstacleError(name, f"is {show(value)}", expected="at least 0, or inf for none")
    if not (value <= limit or value == math.inf):
        raise ObstacleError(
            name,
            f"is {show(value)}",
            expected=f"at most {limit:g} {unit}",
            remedy="say inf where there is no bound",
        )
    return float(value)


def read_points(name: str, value: ArrayLike | list[ArrayLike], count: int) -> FloatArray:
    """Points or velocities of `count` obstacles. Shape (count, 3) or (count, k, 3), k up to 8."""
    array = read_array(name, value)
    shape = array.shape
    if shape == (count, 3):
        return array
    if count == 0 and array.size == 0:
        return np.zeros((0, 3))
    if len(shape) == 3 and shape == (count, shape[1], 3) and shape[1] > 0:
        if shape[1] <= MAXIMUM_POINTS:
            return array
        raise ObstacleError(
            name, f"has {array.shape[1]} points each", expected=f"at most {MAXIMUM_POINTS}"
        )
    raise ObstacleError(
        name,
        f"has shape {array.shape} for {count} ids",
        expected=f"({count}, 3) or ({count}, k, 3)",
    )


def read_field(name: str, value: ArrayLike, count: int) -> float | FloatArray:
    """One number for all obstacles, or one for each: an array of shape (count,)."""
    if type(value) is float:
        return value
    array = read_array(name, value)
    if array.shape == ():
        return float(array)
    if array.shape == (count,):
        return array
    raise ObstacleError(
        name, f"has shape {array.shape} for {count} ids", expected=f"one number or ({count},)"
    )


def read_regions(value: str | Sequence[str], count: int) -> int | IntArray:
    """Sets of regions of `count` obstacles: one for all, or one for each, of shape (count,)."""
    texts: list[object]
    try:
        texts = [value] if isinstance(value, str) else list(value)
    except TypeError:
        texts = [value]
    for text in texts:
        if not isinstance(text, str) or text not in _SETS:
            expected = f"one of {', '.join(REGIONS)}, or '' for none"
            raise ObstacleError("region", f"is {show(text)}", expected=expected)
    sets = [_SETS[str(text)] for text in texts]
    if isinstance(value, str):
        return sets[0]
    if len(sets) != count:
        raise ObstacleError(
            "region", f"has {len(sets)} texts for {count} ids", expected=f"one text or {count}"
        )
    return np.array(sets, dtype=np.int64)


def read_array(name: str, value: ArrayLike | list[ArrayLike]) -> FloatArray:
    """Numbers as float64, not copied if they are that already."""
    if type(value) is np.ndarray and value.dtype is _FLOAT64:
        return value
    if isinstance(value, np.ma.MaskedArray):
        # What was masked out was not measured.
        value = np.ma.filled(value.astype(np.float64), np.nan)
    try:
        array = np.asarray(value)
    except (TypeError, ValueError):
        raise ObstacleError(name, f"is {show(value)}", expected="an array of numbers") from None
    if array.dtype is _FLOAT64:
        return array
    if array.dtype.kind not in "fiu":
        raise ObstacleError(name, f"is {show(value)}", expected="an array of numbers")
    return array.astype(np.float64)
