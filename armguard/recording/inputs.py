"""Arguments of steps and plans as messages, and back.

A monitor accepts any arguments. Arrays of numbers are recorded bit-identically. For other
arguments, the recording has the reason of the refusal, and the replay refuses with that reason.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from armguard.bounds.planned.plan import Plan, Refusal, read_plan
from armguard.messages.incoming import PlanMessage, Values, to_rows, to_values
from armguard.monitor.joint_reasons import read_joint_vectors
from armguard.recording.events import JointState, MalformedPlan, MalformedState
from armguard.settings.declarations import read_number
from armguard.verdict import Reason, ReasonKind

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
    if not type(stamp) is float is type(now):
        stamp, now = read_number(stamp), read_number(now)
    if not (
        type(q) is np.ndarray is type(v)
        and q.dtype == _FLOAT == v.dtype
        and q.ndim == 1 == v.ndim  # of a wrong length as well, which is refused later
    ):
        read = read_joint_vectors(q, v, len(joints))
        if isinstance(read, Reason):
            return MalformedState(stamp, read.subject, read.detail, now)
        q, v = read
    return JointState(stamp, joints, q.tobytes(), v.tobytes(), now=now)


def restore_state(message: JointState | MalformedState) -> tuple[float, Any, Any, float]:
    """Arguments of a step that have the same effect as those of `make_state` had."""
    if isinstance(message, MalformedState):
        reason = Reason(ReasonKind.JOINT_STATE_MALFORMED, message.subject, message.problem)
        return message.stamp, reason, None, message.now
    return message.stamp, _read_vector(message.q), _read_vector(message.v), message.now


def make_plan(joints: list[str], number: int, plan: object) -> PlanMessage | MalformedPlan:
    """The message of a plan, or of another object in its place.

    Args:
        joints: Names of the robot's joints.
        number: Of the plan.
        plan: As in `Monitor.commit`.
    """
    read = read_plan(plan, len(joints))
    if isinstance(read, Refusal):
        return MalformedPlan(*read)
    stamp, *arrays = read
    packed: list[Any] = [None if one is None else np.asarray(one).tobytes() for one in arrays]
    return PlanMessage("commit", number, stamp, joints, *packed)


def restore_plan(message: PlanMessage | MalformedPlan) -> Any:
    """An argument that a monitor answers like the argument of `make_plan`.

    Raises:
        MessageError: Fields of a plan do not fit each other.
    """
    if isinstance(message, MalformedPlan):
        return Refusal(message.subject, message.problem)
    joints, count = len(message.names), len(message.times) // 8
    further = message.velocity_tracking_error
    return Plan(
        message.stamp,
        to_values("times", message.times, count),
        to_rows("q", message.q, joints, count),
        to_rows("v", message.v, joints, count),
        _read_errors("tracking_error", message.tracking_error, joints),
        None if further is None else _read_errors("velocity_tracking_error", further, joints),
    )


def _read_vector(values: bytes | list[float]) -> NDArray[np.float64]:
    return np.frombuffer(values) if isinstance(values, bytes) else np.array(values, float)


def _read_errors(name: str, values: Values, joints: int) -> NDArray[np.float64]:
    if isinstance(values, float):  # that of the only joint
        values = [values]
    return to_values(name, values, joints)
