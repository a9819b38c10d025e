"""What a step and a plan were given, as events, and as arguments again.

A monitor takes whatever comes. Arrays of numbers are kept to the bit; of anything else so much is
kept as its refusal told: type and shape of an array that does not fit, and that there was none.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from msgspec import UNSET
from numpy.typing import NDArray

from armguard.bounds.planned.plan import Plan
from armguard.recording.events import (
    JointState,
    Numbers,
    OddArray,
    PlanAsked,
    PlanField,
)
from armguard.robot.portable import read_numbers, write_number, write_numbers
from armguard.settings.declarations import read_number

MOST_NUMBERS = 1 << 20
"""Longer arrays are refused by their shapes whatever stands in them, and so that alone is kept."""

_FLOAT = np.dtype(np.float64)


def tell_state(stamp: object, q: Any, v: Any, now: object, joints: int) -> JointState:
    """The arguments of a step.

    Args:
        stamp: As in `Monitor.step`.
        q: As in `Monitor.step`.
        v: As in `Monitor.step`.
        now: As in `Monitor.step`; the stamp where none was given.
        joints: How many there are.
    """
    told_q, odd_q = _tell_vector(q, joints)
    told_v, odd_v = _tell_vector(v, joints)
    return JointState(_tell_number(stamp), _tell_number(now), told_q, told_v, odd_q, odd_v)


def restore_state(event: JointState) -> tuple[float, Any, Any, float]:
    """Arguments of a step that have the same effect as those of `tell_state` had."""
    return (
        float(event.stamp),
        read_numbers(event.q) if event.odd_q is UNSET else restore_odd(event.odd_q),
        read_numbers(event.v) if event.odd_v is UNSET else restore_odd(event.odd_v),
        float(event.now),
    )


def tell_plan(plan: object) -> PlanAsked:
    """A plan, or whatever stood in its place."""
    if not isinstance(plan, Plan):
        return PlanAsked(type=type(plan).__name__)
    fields = [
        _tell_field(name, value)
        for name, value in zip(Plan._fields, plan, strict=True)
        if value is not None or name in Plan._fields[:5]
    ]
    return PlanAsked(fields=fields)


def restore_plan(event: PlanAsked) -> Any:
    """What a monitor answers alike; a `Plan` unless that was none."""
    if event.type != "Plan" or not event.fields:
        return type(event.type, (), {})()
    # Format 1 has the error of stops that no monitor judges any more.
    fields = [field for field in event.fields if field.name != "stop_tracking_error"]
    return Plan(**{field.name: _restore_field(field) for field in fields})


class OddValues(np.ndarray[Any, Any]):
    """Stands in for an array that was refused for its type or shape."""


class Unreadable:
    """Stands in for what was given as an array, and was none."""

    def __array__(self, dtype: object = None, copy: object = None) -> NDArray[Any]:
        raise TypeError("no array")


def restore_odd(odd: OddArray) -> Any:
    """What is refused as the array was that is described."""
    if not odd.kind:
        return Unreadable()
    # An array without memory, however long.
    return np.broadcast_to(np.zeros((), np.dtype(odd.kind)), tuple(odd.shape)).view(OddValues)


def _tell_number(value: object) -> float | str:
    if type(value) is float and -math.inf < value < math.inf:
        return value
    return write_number(read_number(value))


def _tell_vector(values: Any, joints: int) -> tuple[Any, Any]:
    """The numbers of a vector, or what stood in its place; the other one is UNSET."""
    if type(values) is np.ndarray and values.dtype == _FLOAT and values.ndim == 1:
        if len(values) <= MOST_NUMBERS:
            listed: Numbers = values.tolist()
            # Of finite numbers the sum may still overflow, which costs a second look.
            return (listed if math.isfinite(sum(listed)) else write_numbers(values)), UNSET  # type: ignore[arg-type]
        return UNSET, OddArray(_FLOAT.str, [len(values)])
    array = _read_array(values)
    if array is not None and array.dtype == _FLOAT and array.shape == (joints,):
        return write_numbers(array), UNSET
    return UNSET, _describe(array)


def _read_array(values: Any) -> NDArray[Any] | None:
    """An array of float64 where that can be made; else as it is, or None if it is none."""
    try:
        if isinstance(values, np.ma.MaskedArray):
            values = np.ma.filled(values.astype(np.float64), np.nan)
        array = np.asarray(values)
        if array.dtype.kind not in "fiu":
            return _of_its_kind(array)
        with np.errstate(all="ignore"):
            return np.array(array, dtype=np.float64)
    except Exception:
        # Whatever a foreign object raises here, it is no array.
        return None


def _of_its_kind(array: NDArray[Any]) -> NDArray[Any]:
    # Nothing but type and shape matters, and nothing else is held on to.
    return np.broadcast_to(np.zeros((), array.dtype), array.shape).view(OddValues)


def _describe(array: NDArray[Any] | None) -> OddArray:
    if array is None:
        return OddArray("", [])
    return OddArray(str(array.dtype), list(array.shape))


def _tell_field(name: str, value: Any) -> PlanField:
    array = _read_array(value)
    if array is None or array.dtype != _FLOAT or array.size > MOST_NUMBERS:
        odd = _describe(array)
        return PlanField(name, [], odd.shape, odd.kind)
    return PlanField(name, write_numbers(array.ravel()), list(array.shape), _FLOAT.str)


def _restore_field(field: PlanField) -> Any:
    if field.kind == _FLOAT.str and len(field.values) == math.prod(field.shape):
        return read_numbers(field.values).reshape(field.shape)
    return restore_odd(OddArray(field.kind, field.shape))
