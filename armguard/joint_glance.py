"""A first look at a joint state, in compiled code: whether there is anything against it at all.

Nearly every state of an arm is as it should be, and then this is all that its tick does about it.
What calls for a closer look is left to `JointStates`, which has words for it.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from armguard.compilation import inlined_kernel, kernel
from armguard.joint_history import accept_joints
from armguard.plausibility import ALLOWED
from armguard.verdict import compute_stop_time

FloatArray = NDArray[np.float64]

NOBODY = -1
"""In place of a joint's index, where every joint is as it should be."""

BELIEVED, RUNAWAY, FAST, DOUBTFUL = 0, 1, 2, 4
"""What a glance at a state found, added up: a joint that runs into its stop, one that is faster
than its limit, but within its error, or anything that calls for a closer look."""


class Guard(NamedTuple):
    """What a first look at a state needs, for compiled code."""

    q: FloatArray
    """Last believed joint positions, [rad] or [m]; written. Shape (nv,)."""
    v: FloatArray
    """Last believed joint velocities, alike; written. Shape (nv,)."""
    read_q: FloatArray
    """Room for what is looked at, whatever its strides were. Shape (nv,)."""
    read_v: FloatArray
    """Likewise. Shape (nv,)."""
    lower: FloatArray
    """Least positions, errors included. Shape (nv,)."""
    upper: FloatArray
    """Greatest positions, errors included. Shape (nv,)."""
    fastest: FloatArray
    """Greatest speeds, errors included. Shape (nv,)."""
    velocity_limit: FloatArray
    velocity_error: FloatArray
    acceleration_limit: FloatArray
    braking_deceleration: FloatArray
    last_stamp: FloatArray
    """Stamp of the last state; written. Shape (1,)."""
    timeout: float
    """Longest age of a state and longest step between two, in [s]."""
    horizon: float
    """Until the verdict after the present one is obeyed, in [s]."""
    reaction_time: float
    """From command to braking torque, in [s]."""
    delay: FloatArray
    """How much later an arm brakes that was told to by the end of a speed scale, in [s]. (1,)."""
    history: tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]
    """What `accept_joints` works on."""


@inlined_kernel
def glance(
    guard: Guard, stamp: float, q_given: FloatArray, v_given: FloatArray, now: float
) -> tuple[int, float, float]:
    """Take a state if there is nothing to be said against it.

    Args:
        guard: What it is compared with; the state becomes part of it.
        stamp: When it was measured, in [s].
        q_given: Joint positions, [rad] or [m]; any strides, and of any length, since shape (nv,)
            is what is expected.
        v_given: Joint velocities, [rad/s] or [m/s]; likewise.
        now: Time of the tick, in [s].

    Returns:
        What was found, the time in which all joints surely rest, and the same for an arm that
        brakes later by the guard's delay, in [s]. Where that is DOUBTFUL, nothing was taken.
    """
    last = guard.last_stamp[0]
    since = stamp - last  # infinite before the first state
    if not (0.0 <= since < np.inf and since <= guard.timeout and abs(now - stamp) <= guard.timeout):
        return DOUBTFUL, np.inf, np.inf
    found = BELIEVED
    q, v = guard.read_q, guard.read_v
    if not (q_given.shape[0] == q.shape[0] == v_given.shape[0]):
        return DOUBTFUL, np.inf, np.inf
    for j in range(q.shape[0]):
        q[j], v[j] = q_given[j], v_given[j]
        if not (guard.lower[j] <= q[j] <= guard.upper[j] and abs(v[j]) <= guard.fastest[j]):
            return DOUBTFUL, np.inf, np.inf
        if not abs(q[j]) < np.inf:
            return DOUBTFUL, np.inf, np.inf
        if not abs(v[j]) <= guard.velocity_limit[j]:
            found |= FAST
    limits, reachable, stamps, positions, velocities = guard.history
    if accept_joints(limits, reachable, stamps, positions, velocities, stamp, q, v) != ALLOWED:
        return DOUBTFUL, np.inf, np.inf
    guard.last_stamp[0] = stamp
    guard.q[:] = q
    guard.v[:] = v
    runaway = find_runaway(
        q, v, guard.lower, guard.upper, guard.velocity_error, guard.acceleration_limit
    )
    if runaway != NOBODY:
        found |= RUNAWAY
    stop_time, late_stop_time = stop_times(guard, v, now - stamp)
    return found, stop_time, late_stop_time


@kernel
def stop_times(guard: Guard, v: FloatArray, age: float) -> tuple[float, float]:
    """Times in which all joints surely rest, in [s]: braking as soon as told, and after the delay.

    Args:
        guard: Limits and delays.
        v: Joint velocities, [rad/s] or [m/s]. Shape (nv,).
        age: Of these, in [s].
    """
    delay = guard.delay[0]
    soon = _stop_time(guard, v, age)
    return soon, _stop_time(guard, v, age + delay) + delay


@kernel
def _stop_time(guard: Guard, v: FloatArray, age: float) -> float:
    stop_time: float = compute_stop_time(
        v,
        guard.velocity_error,
        guard.velocity_limit,
        guard.acceleration_limit,
        guard.braking_deceleration,
        age,
        guard.horizon,
        guard.reaction_time,
    )
    return stop_time


@kernel
def stop_times_of(handle: Any, v: FloatArray, age: float) -> tuple[float, float]:
    """`stop_times` on the handle of a `Guard`."""
    soon, late = stop_times(handle.content, v, age)
    return soon, late


@kernel
def glance_at(
    handle: Any, stamp: float, q: FloatArray, v: FloatArray, now: float
) -> tuple[int, float, float]:
    """`glance` on the handle of a `Guard`."""
    found, stop_time, late_stop_time = glance(handle.content, stamp, q, v, now)
    return found, stop_time, late_stop_time


@kernel
def find_runaway(
    q: FloatArray,
    v: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    velocity_error: FloatArray,
    acceleration_limit: FloatArray,
) -> int:
    """First joint that no allowed deceleration stops short of its limit, errors included.

    (|v| + dv)^2 <= 2 a (distance + dq) towards either limit is what can be stopped.

    Args:
        q: Joint positions, [rad] or [m]. Shape (nv,).
        v: Joint velocities, [rad/s] or [m/s]. Shape (nv,).
        lower: Lower position limits less their errors, alike. Shape (nv,).
        upper: Upper position limits plus their errors, alike. Shape (nv,).
        velocity_error: What velocities may be off by, alike. Shape (nv,).
        acceleration_limit: [rad/s²] or [m/s²]. Shape (nv,).
    """
    for joint in range(q.shape[0]):
        up = max(v[joint] + velocity_error[joint], 0.0)
        down = max(velocity_error[joint] - v[joint], 0.0)
        reach = 2.0 * acceleration_limit[joint]
        if not (
            up * up <= reach * (upper[joint] - q[joint])
            and down * down <= reach * (q[joint] - lower[joint])
        ):
            return joint
    return NOBODY
