"""Decides in compiled code whether a joint state is believed.

One function decides about every state of every tick. It returns a code and a joint; `monitor`
converts them to words if the state is refused. Only scratch memory is written before a state is
believed, so other code always reads the last believed state.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from armguard.jit.arrays import FloatArray
from armguard.jit.kernels import kernel, separate_kernel
from armguard.robot.brakes import BrakeCurves
from armguard.robot.joint_history import (
    PASSED,
    JointHistory,
    begin_history,
    extend_history,
    find_failure,
)
from armguard.robot.stop_time import ALL_COVERED, compute_stop_time
from armguard.robot.wrap_angle import nearest_turn

NO_JOINT = -1
"""In place of a joint's index, where every joint is as it should be."""

BELIEVED, RUNAWAY, FAST = 0, 1, 2
"""What was found of a state that is believed, added up: a joint that runs into its stop, one that
is faster than the limit in force, but within its error."""
UNBRAKED = 8
"""Added where a joint may be faster when its brakes bite than they are stated for."""

(
    WRONG_LENGTH,
    POSITION_NOT_FINITE,
    VELOCITY_NOT_FINITE,
    POSITION_BEYOND_LIMITS,
    VELOCITY_BEYOND_LIMITS,
    STAMP_BACKWARDS,
    TOO_OLD,
    GAP,
    STAMP_STANDS,
) = range(16, 25)
"""Why a state is refused, beside the codes of `joint_history`, which are less."""

VALUE, ALLOWED, DURATION = range(3)
"""Places in `Guard.numbers`."""

FIRST_NOW, LAST_NOW, TICKS = range(3)
"""Places in `Guard.standing`."""


class Guard(NamedTuple):
    """What a state is compared with, for compiled code."""

    q: FloatArray
    """Last believed joint positions, [rad] or [m]; written. Shape (nv,)."""
    v: FloatArray
    """Last believed joint velocities, [rad/s] or [m/s]; written. Shape (nv,)."""
    read_q: FloatArray
    """Scratch: the positions at hand, whole turns nearest to the last. Shape (nv,)."""
    read_v: FloatArray
    """Scratch: the velocities at hand. Shape (nv,)."""
    lower: FloatArray
    """Least positions, errors included. Shape (nv,)."""
    upper: FloatArray
    """Greatest positions, errors included. Shape (nv,)."""
    fastest: FloatArray
    """Greatest speeds, errors included. Shape (nv,)."""
    continuous: NDArray[np.bool_]
    """Which joints have no position limits. Shape (nv,)."""
    operating_velocity: FloatArray
    """Operating velocities in force; shared. Shape (nv,)."""
    operating_acceleration: FloatArray
    """Operating accelerations in force; shared. Shape (nv,)."""
    velocity_error: FloatArray
    acceleration_limit: FloatArray
    brakes: BrakeCurves
    """How joints stop under the payload in force; each of shape (nv, steps)."""
    heard: FloatArray
    """Stamp from which the next one is counted, in [s], -inf before the first: that of the last
    state believed, or of a newer one that was refused for its gap alone. Shape (1,)."""
    standing: FloatArray
    """Time of the tick that brought the last stamp first, of the last tick, and ticks since then in
    which neither stamp nor time went on; written. Shape (3,)."""
    numbers: FloatArray
    """Scratch: of a state that is refused, the value found, the greatest allowed, and the time
    between the two states compared, in [s]. Shape (3,)."""
    timeout: float
    """Longest age of a state, longest step between two and longest stand of a stamp, in [s]."""
    period: float
    """Of ticks, in [s]: what counts as their distance where time stands."""
    horizon: float
    """Until the verdict after the present one is obeyed, in [s]."""
    reaction_time: float
    """From command to braking torque, in [s]."""
    delay: FloatArray
    """How much later an arm brakes that was told to by the end of a speed scale, in [s]. (1,)."""
    history: JointHistory
    """What all states believed so far allow."""


@separate_kernel
def accept(
    guard: Guard, stamp: float, q_given: FloatArray, v_given: FloatArray, now: float
) -> tuple[int, int, float, float]:
    """Accept a state if no test fails.

    Positions of continuous joints are taken whole turns nearest to the last believed ones, so that
    a driver that wraps is believed; see `turns` for why that is sound. The first state after a
    reset is taken as it is.

    A refused state leaves nothing behind, its stamp included: one that lies far ahead would
    otherwise make all later ones run backwards. The exception is a stamp refused for its gap alone:
    the next is counted from there. One gap is one fault, and latched; counted from the last state
    believed, each state after it would be a gap as well, and the arm unknown until a reset.

    Args:
        guard: What it is compared with; the state becomes part of it.
        stamp: When it was measured, in [s]; finite.
        q_given: Joint positions, [rad] or [m]; any strides, and of any length, since shape (nv,)
            is what is expected.
        v_given: Joint velocities, [rad/s] or [m/s]; of any strides and any length.
        now: Time of the tick, in [s]; finite.

    Returns:
        What was found, or minus the code of what the state is refused for; the joint that it is
        refused for, NO_JOINT if none; the time in which all joints surely rest, and the same for an
        arm that brakes later by the guard's delay, in [s], inf where the state is refused.
    """
    # Read: a copy in contiguous memory, continuous joints whole turns nearest to the last.
    q, v = guard.read_q, guard.read_v
    if not (q_given.shape[0] == q.shape[0] == v_given.shape[0]):
        return -WRONG_LENGTH, NO_JOINT, np.inf, np.inf
    is_first = guard.heard[0] == -np.inf
    for j in range(q.shape[0]):
        q[j], v[j] = q_given[j], v_given[j]
        if guard.continuous[j] and not is_first:
            q[j] = nearest_turn(q[j], guard.q[j])
    ticks = 0.0
    if stamp == guard.heard[0] and not now > guard.standing[LAST_NOW]:
        ticks = guard.standing[TICKS] + 1.0
    code, joint = _find_fault(guard, stamp, now, is_first, ticks)
    if code != PASSED:
        if code == GAP:
            guard.heard[0] = stamp
            guard.standing[FIRST_NOW], guard.standing[LAST_NOW] = now, now
            guard.standing[TICKS] = 0.0
        return -code, joint, np.inf, np.inf
    # Take: from here on the state is believed.
    if is_first:
        begin_history(guard.history, stamp, q, v)
    else:
        extend_history(guard.history, stamp, q, v)
    if stamp != guard.heard[0]:
        guard.standing[FIRST_NOW] = now
    guard.standing[LAST_NOW] = now
    guard.standing[TICKS] = ticks
    guard.heard[0] = stamp
    # What to say of it beside.
    found = BELIEVED
    for j in range(q.shape[0]):
        guard.q[j], guard.v[j] = q[j], v[j]
        if not abs(v[j]) <= guard.operating_velocity[j]:
            found |= FAST
    if find_runaway(guard, q, v) != NO_JOINT:
        found |= RUNAWAY
    stop_time, late_stop_time, unbraked = stop_times(guard, v, now - stamp)
    if unbraked != ALL_COVERED:
        found |= UNBRAKED
    return found, NO_JOINT, stop_time, late_stop_time


@kernel
def _stands_for(guard: Guard, stamp: float, now: float, ticks: float) -> float:
    """How long a stamp has been the same, in [s].

    By the clock that the ticks are on. One that stands as well, as where it is the stamp itself,
    is replaced by the count of ticks: neither of the two may stand for ever.
    """
    duration = 0.0
    if stamp == guard.heard[0]:
        duration = max(now - guard.standing[FIRST_NOW], ticks * guard.period)
    return duration


@kernel
def _find_fault(
    guard: Guard, stamp: float, now: float, is_first: bool, ticks: float
) -> tuple[int, int]:
    """What is wrong with the state at hand: code and joint; its numbers are written as well.

    PASSED where nothing is.
    """
    q, v, numbers = guard.read_q, guard.read_v, guard.numbers
    numbers[:] = 0.0
    for j in range(q.shape[0]):
        numbers[VALUE] = q[j]
        if not abs(q[j]) < np.inf:
            return POSITION_NOT_FINITE, j
    for j in range(q.shape[0]):
        numbers[VALUE] = v[j]
        if not abs(v[j]) < np.inf:
            return VELOCITY_NOT_FINITE, j
    for j in range(q.shape[0]):
        numbers[VALUE] = q[j]
        if not guard.lower[j] <= q[j] <= guard.upper[j]:
            return POSITION_BEYOND_LIMITS, j
    for j in range(q.shape[0]):
        numbers[VALUE], numbers[ALLOWED] = v[j], guard.fastest[j]
        if not abs(v[j]) <= guard.fastest[j]:
            return VELOCITY_BEYOND_LIMITS, j
    since = 0.0 if is_first else stamp - guard.heard[0]
    numbers[ALLOWED], numbers[DURATION] = guard.timeout, since
    if not since >= 0.0:
        return STAMP_BACKWARDS, NO_JOINT
    numbers[VALUE] = now - stamp
    if not abs(now - stamp) <= guard.timeout:
        return TOO_OLD, NO_JOINT
    numbers[VALUE] = since
    if not since <= guard.timeout:
        return GAP, NO_JOINT
    numbers[VALUE] = _stands_for(guard, stamp, now, ticks)
    numbers[DURATION] = ticks
    if not numbers[VALUE] <= guard.timeout:
        return STAMP_STANDS, NO_JOINT
    if is_first:
        return PASSED, NO_JOINT
    code, joint = find_failure(guard.history, stamp, q, v, numbers)
    return code, joint


@kernel
def stop_times(guard: Guard, v: FloatArray, age: float) -> tuple[float, float, int]:
    """Stop times of all joints, in [s]: if they brake at once, and if they brake after the delay.

    Args:
        guard: Limits and delays.
        v: Joint velocities, [rad/s] or [m/s]. Shape (nv,).
        age: Of these, in [s].

    Returns:
        Both times, and the first joint that may be too fast for its brakes when they bite as soon
        as told; `ALL_COVERED` if none may.
    """
    soon, uncovered = _stop_time(guard, v, age, guard.horizon)
    late, _ = _stop_time(guard, v, age, guard.horizon + guard.delay[0])
    return soon, late, uncovered


@kernel
def _stop_time(guard: Guard, v: FloatArray, age: float, horizon: float) -> tuple[float, int]:
    time, uncovered = compute_stop_time(
        v,
        guard.velocity_error,
        guard.operating_velocity,
        guard.acceleration_limit,
        guard.brakes,
        age,
        horizon,
        guard.reaction_time,
        guard.operating_acceleration,
    )
    return time, uncovered


@kernel
def accept_at(
    handle: Any, stamp: float, q: FloatArray, v: FloatArray, now: float
) -> tuple[int, int, float, float]:
    """`accept` on the handle of a `Guard`."""
    found, joint, stop_time, late_stop_time = accept(handle.content, stamp, q, v, now)
    return found, joint, stop_time, late_stop_time


@kernel
def find_runaway(guard: Guard, q: FloatArray, v: FloatArray) -> int:
    """First joint that no allowed deceleration stops short of its limit, errors included.

    (|v| + dv)^2 <= 2 a (distance + dq) towards either limit is what can be stopped.

    Args:
        guard: Its limits and errors count.
        q: Joint positions, [rad] or [m]. Shape (nv,).
        v: Joint velocities, [rad/s] or [m/s]. Shape (nv,).
    """
    for joint in range(q.shape[0]):
        up = max(v[joint] + guard.velocity_error[joint], 0.0)
        down = max(guard.velocity_error[joint] - v[joint], 0.0)
        reach = 2.0 * guard.acceleration_limit[joint]
        if not (
            up * up <= reach * (guard.upper[joint] - q[joint])
            and down * down <= reach * (q[joint] - guard.lower[joint])
        ):
            return joint
    return NO_JOINT
