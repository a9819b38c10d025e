"""Tests whether a new joint state is within what all earlier states allow.

A state must agree with every earlier one: v - dv <= v_k + dv + A (s - s_k) and its mirror image, q
in the same way with the speed limit, and the quadratic test against the state before and a few
reference states. The first two need no memory of each state: what all of them allow together is one
interval for each joint's true position and one for its velocity, which widen with time and shrink
with each measurement. Motion within limits and errors never fails; a joint that reads faster than
its limit, but within its error, is taken to be that fast.

The codes and the rounding are those of `jit.numerics`: what rounding could be to blame for passes.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from armguard.exceptions import ArmguardError
from armguard.jit.arrays import FloatArray
from armguard.jit.kernels import kernel
from armguard.jit.numerics import (
    ACCEPTANCE_SLACK,
    POSITION_BY_ACCEL,
    POSITION_BY_SPEED,
    VELOCITY_BY_ACCEL,
    VELOCITY_BY_SPEED,
)

PASSED = 0
"""Code of a state that agrees with the history."""

REFERENCE_AGES = np.array([0.0, 0.01, 0.04, 0.16, 0.64])
"""Ages at which the states that the quadratic test looks back on are renewed, in [s].

The first is always the state before. The oldest reaches about as far as the quadratic bound of an
arm's joint stays tighter than its speed bound. Shape (reference states,).
"""


class JointHistory(NamedTuple):
    """All joint states believed so far, as far as they limit the next one."""

    limits: FloatArray
    """Velocity and acceleration limits, position and velocity errors. Shape (4, nv)."""
    reachable: FloatArray
    """Upper and lower ends of true positions, of true velocities. Shape (4, nv)."""
    stamps: FloatArray
    """Of the reference states, in [s]; the first is that of the last state. Shape (reference
    states,)."""
    positions: FloatArray
    """Of the reference states, in [rad] or [m]. Shape (reference states, nv)."""
    velocities: FloatArray
    """Of the reference states, in [rad]/[s] or [m]/[s]. Shape (reference states, nv)."""


def make_history(
    velocity_limit: ArrayLike,
    acceleration_limit: ArrayLike,
    position_error: ArrayLike,
    velocity_error: ArrayLike,
) -> JointHistory:
    """Room for a history, to be begun with the first state.

    Args:
        velocity_limit: In [rad]/[s] or [m]/[s]. Shape (nv,).
        acceleration_limit: In [rad]/[s]^2 or [m]/[s]^2. Shape (nv,).
        position_error: What q may be off by, in [rad] or [m]. Shape (nv,).
        velocity_error: What v may be off by, in [rad]/[s] or [m]/[s]. Shape (nv,).

    Raises:
        ArmguardError: A limit or an error is negative, infinite or no number.
    """
    given = (velocity_limit, acceleration_limit, position_error, velocity_error)
    limits = np.array([np.asarray(limit, dtype=np.float64) for limit in given])
    if not ((limits >= 0.0) & (limits < np.inf)).all():
        raise ArmguardError(
            "joint limits and errors",
            f"found {limits.tolist()}",
            expected="finite numbers, not negative",
        )
    reference_states, joints = len(REFERENCE_AGES), limits.shape[1]
    return JointHistory(
        limits,
        np.zeros((4, joints)),
        np.zeros(reference_states),
        np.zeros((reference_states, joints)),
        np.zeros((reference_states, joints)),
    )


@kernel
def _find_joint_failure(
    history: JointHistory, stamp: float, joint: int, q: float, v: float, numbers: FloatArray
) -> int:
    """Code of the first test that one joint fails, and its numbers as for `find_failure`."""
    limits, reachable = history.limits, history.reachable
    top_speed, accel = limits[0, joint], limits[1, joint]
    position_error, velocity_error = limits[2, joint], limits[3, joint]
    q0, v0 = history.positions[0, joint], history.velocities[0, joint]
    clock_slack = ACCEPTANCE_SLACK * (abs(stamp) + abs(history.stamps[0]))
    duration = stamp - history.stamps[0] + clock_slack
    numbers[2] = stamp - history.stamps[0]
    # A velocity within limit and error, and a state that is finite.
    numbers[0], numbers[1] = abs(v), top_speed + velocity_error
    if not (abs(v) <= numbers[1] * (1.0 + ACCEPTANCE_SLACK) and abs(v) + abs(q) < math.inf):
        return VELOCITY_BY_SPEED
    # What is told is seen from the last state; what it is held against comes from all of them.
    # Within the measurement's error a joint that reads faster than its limit is believed.
    moved = max(top_speed, max(abs(v), abs(v0))) * duration + position_error
    slack = ACCEPTANCE_SLACK * (abs(q) + position_error)
    highest, lowest = reachable[0, joint] + moved, reachable[1, joint] - moved
    numbers[0], numbers[1] = abs(q - q0), highest - q0 if q > q0 else q0 - lowest
    if not lowest - slack <= q <= highest + slack:
        return POSITION_BY_SPEED
    changed = accel * duration + velocity_error
    slack = ACCEPTANCE_SLACK * (abs(v) + velocity_error)
    highest, lowest = reachable[2, joint] + changed, reachable[3, joint] - changed
    numbers[0], numbers[1] = abs(v - v0), highest - v0 if v > v0 else v0 - lowest
    if not lowest - slack <= v <= highest + slack:
        return VELOCITY_BY_ACCEL
    # Near enough to where each reference state was headed.
    for k in range(history.stamps.shape[0]):
        q0, v0 = history.positions[k, joint], history.velocities[k, joint]
        since = stamp - history.stamps[k]
        numbers[0], numbers[2] = abs(q - q0 - v0 * since), since
        numbers[1] = 2.0 * position_error + (0.5 * accel * since + velocity_error) * since
        late = since + clock_slack
        bound = 2.0 * position_error + (0.5 * accel * late + velocity_error) * late
        bound += ACCEPTANCE_SLACK * (abs(q) + abs(q0) + abs(v0) * late + bound)
        if not numbers[0] <= bound + clock_slack * abs(v0):
            return POSITION_BY_ACCEL
    return PASSED


@kernel
def find_failure(
    history: JointHistory, stamp: float, q: FloatArray, v: FloatArray, numbers: FloatArray
) -> tuple[int, int]:
    """Code of the first test that a state fails, and the joint; PASSED and -1 where it fails none.

    Args:
        history: As `begin_history` or `extend_history` left it.
        stamp: Of the state, in [s].
        q: Its positions, in [rad] or [m]. Shape (nv,).
        v: Its velocities, in [rad]/[s] or [m]/[s]. Shape (nv,).
        numbers: Filled with what was found, the most that is allowed, errors included, and the time
            between the two states compared, in [s]. Shape (3,).
    """
    for joint in range(q.shape[0]):
        code = _find_joint_failure(history, stamp, joint, q[joint], v[joint], numbers)
        if code != PASSED:
            return code, joint
    return PASSED, -1


@kernel
def begin_history(history: JointHistory, stamp: float, q: FloatArray, v: FloatArray) -> None:
    """Forget what was, and begin with this state."""
    for joint in range(q.shape[0]):
        position_error, velocity_error = history.limits[2, joint], history.limits[3, joint]
        history.reachable[0, joint] = q[joint] + position_error
        history.reachable[1, joint] = q[joint] - position_error
        history.reachable[2, joint] = v[joint] + velocity_error
        history.reachable[3, joint] = v[joint] - velocity_error
    for k in range(history.stamps.shape[0]):
        history.stamps[k] = stamp
        for joint in range(q.shape[0]):
            history.positions[k, joint] = q[joint]
            history.velocities[k, joint] = v[joint]


@kernel
def extend_history(history: JointHistory, stamp: float, q: FloatArray, v: FloatArray) -> None:
    """Make a state that passed part of the history."""
    limits, reachable, stamps = history.limits, history.reachable, history.stamps
    # Rounded stamps add up exactly, so the slack for them belongs to the test alone.
    elapsed = stamp - stamps[0]
    for joint in range(q.shape[0]):
        top_speed, accel = limits[0, joint], limits[1, joint]
        position_error, velocity_error = limits[2, joint], limits[3, joint]
        speed = max(top_speed, abs(v[joint]), abs(history.velocities[0, joint]))
        moved = speed * elapsed + ACCEPTANCE_SLACK * (abs(q[joint]) + position_error)
        changed = accel * elapsed + ACCEPTANCE_SLACK * (abs(v[joint]) + velocity_error)
        reachable[0, joint] = min(reachable[0, joint] + moved, q[joint] + position_error)
        reachable[1, joint] = max(reachable[1, joint] - moved, q[joint] - position_error)
        reachable[2, joint] = min(reachable[2, joint] + changed, v[joint] + velocity_error)
        reachable[3, joint] = max(reachable[3, joint] - changed, v[joint] - velocity_error)
    for k in range(stamps.shape[0]):
        if k == 0 or stamp - stamps[k] >= REFERENCE_AGES[k]:
            stamps[k] = stamp
            for joint in range(q.shape[0]):
                history.positions[k, joint] = q[joint]
                history.velocities[k, joint] = v[joint]
