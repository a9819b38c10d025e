"""What a step and a plan were given, as messages, and as arguments again.

A monitor takes whatever comes. Where that is what a message can hold, it is one, to the bit. Of
anything else so much is kept as its refusal depends on: type and shape of an array that does not
fit, and that there was none.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armguard.bounds.planned.plan import Plan
from armguard.messages.incoming import PlanMessage, Values, to_rows, to_values
from armguard.monitor.settings import read_number
from armguard.recording.events import Argument, JointState, MalformedPlan, MalformedState

MOST_NUMBERS = 1 << 20
"""Longer arrays are refused by their shapes whatever stands in them, and so that alone is kept."""

_FLOAT = np.dtype(np.float64)


def make_state(
    joints: list[str], stamp: object, q: Any, v: Any, now: object
) -> JointState | MalformedState:
    """The message of the arguments of a step.

    Args:
        joints: Names of the robot's joints.
        stamp: As in `Monitor.step`.
        q: As in `Monitor.step`.
        v: As in `Monitor.step`.
        now: As in `Monitor.step`; the stamp where none was given.
    """
    shape = (len(joints),)
    if not (
        type(stamp) is float is type(now)
        and type(q) is np.ndarray is type(v)
        # NumPy has one object for the type of almost all arrays of float64.
        and q.dtype is _FLOAT is v.dtype
        and q.shape == shape == v.shape
    ):
        stamp, q, v, now = read_number(stamp), _read_array(q), _read_array(v), read_number(now)
        if not (_fits(q, shape) and _fits(v, shape)):
            return MalformedState(stamp, _describe("q", q), _describe("v", v), now)
    return JointState(stamp, joints, q.tobytes(), v.tobytes(), now=now)


def restore_state(message: JointState | MalformedState) -> tuple[float, Any, Any, float]:
    """Arguments of a step that have the same effect as those of `make_state` had.

    Raises:
        ValueError: It is no message of a step.
    """
    if isinstance(message, JointState):
        count = len(message.names)
        q, v = to_values("q", message.q, count), to_values("v", message.v, count)
        return message.stamp, q, v, message.now
    return message.stamp, _restore(message.q), _restore(message.v), message.now


def make_plan(joints: list[str], number: int, plan: object) -> PlanMessage | MalformedPlan:
    """The message of a plan, or of whatever stood in its place.

    Args:
        joints: Names of the robot's joints.
        number: Of the plan.
        plan: As in `Monitor.commit`.
    """
    if not isinstance(plan, Plan):
        return MalformedPlan([], type(plan).__name__)
    given = {
        name: _read_array(value)
        for name, value in plan._asdict().items()
        if value is not None or name != "velocity_tracking_error"
    }
    times, width = given["times"], len(joints)
    rows = (len(times), width) if times is not None and times.ndim == 1 else ()
    shapes: dict[str, tuple[Any, ...]] = {"stamp": ((),), "times": (rows[:1],)}
    shapes |= {"q": (rows,), "v": (rows,)}
    if not all(_fits(value, *shapes.get(name, ((), (width,)))) for name, value in given.items()):
        return MalformedPlan([_describe(name, value) for name, value in given.items()])
    stamp, *packed = (
        value.tobytes() if value is not None and value.ndim else float(value)  # type: ignore[arg-type]
        for value in given.values()
    )
    return PlanMessage("commit", number, stamp, joints, *packed)  # type: ignore[arg-type]


def restore_plan(message: PlanMessage | MalformedPlan) -> Any:
    """What a monitor answers like what `make_plan` was given; a `Plan` unless that was none.

    Raises:
        MessageError: Its fields do not fit each other.
    """
    if isinstance(message, MalformedPlan):
        if message.given != "Plan":
            return type(message.given, (), {})()
        return Plan(**{one.name: _restore(one) for one in message.arguments})
    width, count = len(message.names), len(message.times) // 8

    def read(name: str, values: Values) -> Any:
        return values if isinstance(values, float) else to_values(name, values, width)

    further = message.velocity_tracking_error
    return Plan(
        message.stamp,
        to_values("times", message.times, count),
        to_rows("q", message.q, count, width),
        to_rows("v", message.v, count, width),
        read("tracking_error", message.tracking_error),
        None if further is None else read("velocity_tracking_error", further),
    )


class OddValues(np.ndarray[Any, Any]):
    """Stands in for an array that was refused for its type or shape."""


class Unreadable:
    """Stands in for what was given as an array, and was none."""

    def __array__(self, dtype: object = None, copy: object = None) -> NDArray[Any]:
        raise TypeError("no array")


def _fits(array: NDArray[Any] | None, *shapes: tuple[int, ...]) -> bool:
    """Whether it is an array of float64 of one of these shapes, and not too long."""
    return (
        array is not None
        and array.dtype == _FLOAT
        and array.shape in shapes
        and array.size <= MOST_NUMBERS
    )


def _read_array(values: Any) -> NDArray[Any] | None:
    """An array of float64 where that can be made; else as it is, or None if it is none."""
    try:
        if isinstance(values, np.ma.MaskedArray):
            values = np.ma.filled(values.astype(np.float64), np.nan)
        array = np.asarray(values)
        if array.dtype.kind not in "fiu":
            # Nothing but type and shape matters, and nothing else is held on to.
            return _make_odd(array.dtype, array.shape)
        with np.errstate(all="ignore"):
            return np.array(array, dtype=np.float64)
    except Exception:
        # Whatever a foreign object raises here, it is no array.
        return None


def _make_odd(kind: Any, shape: tuple[int, ...]) -> NDArray[Any]:
    """An array without memory, however long."""
    return np.broadcast_to(np.zeros((), np.dtype(kind)), shape).view(OddValues)


def _describe(name: str, value: Any) -> Argument:
    if value is None:
        return Argument(name, [], "")
    array = np.asanyarray(value)
    is_kept = array.dtype == _FLOAT and array.size <= MOST_NUMBERS
    values = array.tobytes() if is_kept else b""
    return Argument(name, list(array.shape), array.dtype.str, values)


def _restore(argument: Argument) -> Any:
    if not argument.kind:
        return Unreadable()
    if argument.kind == _FLOAT.str and len(argument.values) == 8 * math.prod(argument.shape):
        return np.frombuffer(argument.values).reshape(argument.shape)
    return _make_odd(argument.kind, tuple(argument.shape))
