"""Is a new joint state inside what all states before it allow?

The codes and the rounding are those of `plausibility`: what rounding could be to blame for passes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from armguard.compilation import kernel
from armguard.exceptions import ArmguardError
from armguard.plausibility import (
    ALLOWED,
    MEANING,
    NOT_FINITE,
    POSITION_BY_ACCEL,
    POSITION_BY_SPEED,
    SHAPE,
    SLACK,
    TIME_BACKWARDS,
    VELOCITY_BY_ACCEL,
    VELOCITY_BY_SPEED,
    Array,
)

ANCHOR_AGES = np.array([0.0, 0.01, 0.04, 0.16, 0.64])
"""Ages at which the states that the quadratic test looks back on are renewed, in [s].

The first is always the state before. The oldest reaches about as far as the quadratic bound of an
arm's joint stays tighter than its speed bound. Shape (anchors,).
"""


@kernel
def _is_no_faster(limits: Array, joint: int, q: float, v: float) -> bool:
    """Whether a state is finite, and its velocity within limit and error."""
    top_speed, velocity_error = limits[0, joint], limits[3, joint]
    fast = abs(v) <= (top_speed + velocity_error) * (1.0 + SLACK)
    return fast & (abs(q) < math.inf) & (abs(v) < math.inf)


@kernel
def _is_in_reach(
    limits: Array, reachable: Array, v0: float, joint: int, duration: float, q: float, v: float
) -> bool:
    """Whether a position is one that all states so far let the joint get to, by its speed limit."""
    top_speed, position_error = limits[0, joint], limits[2, joint]
    # Within the measurement's error a joint that reads faster than its limit is believed.
    speed = max(top_speed, max(abs(v), abs(v0)))
    moved = speed * duration + position_error + SLACK * (abs(q) + position_error)
    return (reachable[1, joint] - moved <= q) & (q <= reachable[0, joint] + moved)


@kernel
def _is_no_change_too_fast(
    limits: Array, reachable: Array, joint: int, duration: float, v: float
) -> bool:
    """Whether a velocity is one that all states so far let the joint get to."""
    accel, velocity_error = limits[1, joint], limits[3, joint]
    changed = accel * duration + velocity_error + SLACK * (abs(v) + velocity_error)
    return (reachable[3, joint] - changed <= v) & (v <= reachable[2, joint] + changed)


@kernel
def _is_near_course(
    limits: Array, q0: float, v0: float, joint: int, since: float, clock_slack: float, q: float
) -> bool:
    """Whether a position is near enough to where an earlier state was headed, `since` [s] ago."""
    accel, position_error, velocity_error = limits[1, joint], limits[2, joint], limits[3, joint]
    duration = since + clock_slack
    bound = 2.0 * position_error + (0.5 * accel * duration + velocity_error) * duration
    bound += SLACK * (abs(q) + abs(q0) + abs(v0) * duration + bound) + clock_slack * abs(v0)
    return abs(q - q0 - v0 * since) <= bound


@kernel
def _test_joint(
    limits: Array,
    reachable: Array,
    anchor_stamps: Array,
    anchor_positions: Array,
    anchor_velocities: Array,
    stamp: float,
    joint: int,
    q: float,
    v: float,
) -> int:
    """Code of the first test that one joint fails; rows of `limits`, `reachable` as below."""
    if not (abs(q) < math.inf and abs(v) < math.inf):
        return NOT_FINITE
    if not _is_no_faster(limits, joint, q, v):
        return VELOCITY_BY_SPEED
    clock_slack = SLACK * (abs(stamp) + abs(anchor_stamps[0]))
    duration = stamp - anchor_stamps[0] + clock_slack
    if not _is_in_reach(limits, reachable, anchor_velocities[0, joint], joint, duration, q, v):
        return POSITION_BY_SPEED
    if not _is_no_change_too_fast(limits, reachable, joint, duration, v):
        return VELOCITY_BY_ACCEL
    for k in range(anchor_stamps.shape[0]):
        q0, v0 = anchor_positions[k, joint], anchor_velocities[k, joint]
        if not _is_near_course(limits, q0, v0, joint, stamp - anchor_stamps[k], clock_slack, q):
            return POSITION_BY_ACCEL
    return ALLOWED


@kernel
def _all_pass(
    limits: Array,
    reachable: Array,
    anchor_stamps: Array,
    anchor_positions: Array,
    anchor_velocities: Array,
    stamp: float,
    q: Array,
    v: Array,
) -> bool:
    """Whether no joint fails any test: the same ones, but free of branches, several at a time."""
    clock_slack = SLACK * (abs(stamp) + abs(anchor_stamps[0]))
    duration = stamp - anchor_stamps[0] + clock_slack
    passed = True
    for joint in range(q.shape[0]):
        v0 = anchor_velocities[0, joint]
        passed &= _is_no_faster(limits, joint, q[joint], v[joint])
        passed &= _is_in_reach(limits, reachable, v0, joint, duration, q[joint], v[joint])
        passed &= _is_no_change_too_fast(limits, reachable, joint, duration, v[joint])
    for k in range(anchor_stamps.shape[0]):
        since = stamp - anchor_stamps[k]
        for joint in range(q.shape[0]):
            q0, v0 = anchor_positions[k, joint], anchor_velocities[k, joint]
            passed &= _is_near_course(limits, q0, v0, joint, since, clock_slack, q[joint])
    return passed


@kernel
def accept_joints(
    limits: Array,
    reachable: Array,
    anchor_stamps: Array,
    anchor_positions: Array,
    anchor_velocities: Array,
    stamp: float,
    q: Array,
    v: Array,
) -> int:
    """Code plus 16 times the joint of the first failure, or 0 and the state becomes history."""
    joints = q.shape[0]
    if not stamp >= anchor_stamps[0]:
        return TIME_BACKWARDS
    if not _all_pass(
        limits, reachable, anchor_stamps, anchor_positions, anchor_velocities, stamp, q, v
    ):
        for joint in range(joints):
            code = _test_joint(
                limits,
                reachable,
                anchor_stamps,
                anchor_positions,
                anchor_velocities,
                stamp,
                joint,
                q[joint],
                v[joint],
            )
            if code != ALLOWED:
                return code + 16 * joint
        # Both ways are the same arithmetic; should they ever differ, the state is not believed.
        return POSITION_BY_ACCEL
    # Rounded stamps add up exactly, so the slack for them belongs to the test alone.
    elapsed = stamp - anchor_stamps[0]
    for joint in range(joints):
        top_speed, accel = limits[0, joint], limits[1, joint]
        position_error, velocity_error = limits[2, joint], limits[3, joint]
        speed = max(top_speed, abs(v[joint]), abs(anchor_velocities[0, joint]))
        moved = speed * elapsed + SLACK * (abs(q[joint]) + position_error)
        changed = accel * elapsed + SLACK * (abs(v[joint]) + velocity_error)
        reachable[0, joint] = min(reachable[0, joint] + moved, q[joint] + position_error)
        reachable[1, joint] = max(reachable[1, joint] - moved, q[joint] - position_error)
        reachable[2, joint] = min(reachable[2, joint] + changed, v[joint] + velocity_error)
        reachable[3, joint] = max(reachable[3, joint] - changed, v[joint] - velocity_error)
    for k in range(anchor_stamps.shape[0]):
        if k == 0 or stamp - anchor_stamps[k] >= ANCHOR_AGES[k]:
            anchor_stamps[k] = stamp
            for joint in range(joints):
                anchor_positions[k, joint] = q[joint]
                anchor_velocities[k, joint] = v[joint]
    return ALLOWED


class JointHistory:
    """All joint states accepted so far, as far as they limit the next one.

    A state must agree with every earlier one: v - dv <= v_k + dv + A (s - s_k) and its mirror
    image, q with the speed limit alike, and the quadratic test against the state before and a few
    anchors. The first two need no memory of each state: what all of them allow together is one
    interval for each joint's true position and one for its velocity, which widen with time and
    shrink with each measurement. Motion within limits and errors never fails; a joint that reads
    faster than its limit, but within its error, is taken to be that fast.

    Attributes:
        joint: Index of the joint that failed in the last `accept`; -1 if none did.
        code: Why, one of the codes of this module; 0 if none did.
    """

    def __init__(
        self,
        velocity_limit: ArrayLike,
        acceleration_limit: ArrayLike,
        position_error: ArrayLike,
        velocity_error: ArrayLike,
    ) -> None:
        """Starts without a history: the first state need only keep the limits.

        Args:
            velocity_limit: In [rad]/[s] or [m]/[s]. Shape (nv,).
            acceleration_limit: In [rad]/[s]^2 or [m]/[s]^2. Shape (nv,).
            position_error: What q may be off by, in [rad] or [m]. Shape (nv,).
            velocity_error: What v may be off by, in [rad]/[s] or [m]/[s]. Shape (nv,).
        """
        limits = (velocity_limit, acceleration_limit, position_error, velocity_error)
        self._limits = np.array([np.asarray(limit, dtype=np.float64) for limit in limits])
        if not ((self._limits >= 0.0) & (self._limits < np.inf)).all():
            raise ArmguardError(
                "joint limits and errors",
                f"found {self._limits.tolist()}",
                expected="finite numbers, not negative",
            )
        self._joints = self._limits.shape[1]
        self._reachable = np.empty((4, self._joints))
        self._anchor_stamps = np.empty(len(ANCHOR_AGES))
        self._anchor_positions = np.empty((len(ANCHOR_AGES), self._joints))
        self._anchor_velocities = np.empty((len(ANCHOR_AGES), self._joints))
        self.joint = -1
        self.code = ALLOWED
        self.clear()
        self._run(0.0, np.zeros(self._joints), np.zeros(self._joints))  # compiles
        self.clear()

    @property
    def arrays(self) -> tuple[Array, Array, Array, Array, Array]:
        """What compiled code hands to `accept_joints`, once a state was accepted."""
        return (
            self._limits,
            self._reachable,
            self._anchor_stamps,
            self._anchor_positions,
            self._anchor_velocities,
        )

    def clear(self) -> None:
        """Forgets all states; the next one to be accepted starts the history."""
        self._reachable[0::2] = np.inf
        self._reachable[1::2] = -np.inf
        self._empty = True
        self.joint = -1
        self.code = ALLOWED

    def accept(self, stamp: float, q: Array, v: Array) -> int:
        """Tests a state and, if it agrees with the history, makes it part of it.

        Args:
            stamp: Time of the state, in [s].
            q: Joint positions, in [rad] or [m]. Shape (nv,), float64.
            v: Joint velocities, in [rad]/[s] or [m]/[s]. Shape (nv,), float64.

        Returns:
            0 if accepted, otherwise the code of the test that failed; `joint` says for which
            joint, `describe` says it in words. A refused state leaves the history as it was.
        """
        self.joint = -1
        if q.shape != (self._joints,) or v.shape != (self._joints,):
            self.code = SHAPE
        elif not math.isfinite(stamp):
            self.code = NOT_FINITE
        else:
            self._run(stamp, q, v)
        return self.code

    def restart(self, stamp: float, q: Array, v: Array) -> int:
        """Forgets the history and begins a new one with this state; returns as `accept` does."""
        self.clear()
        return self.accept(stamp, q, v)

    def describe(self, joints: Sequence[str]) -> tuple[str, str]:
        """Which joint the last `accept` found fault with, and what fault; empty if none.

        Args:
            joints: Names of the joints. Length nv.
        """
        subject = joints[self.joint] if self.joint >= 0 else "joint states"
        return subject, MEANING.get(self.code, "")

    def _run(self, stamp: float, q: Array, v: Array) -> None:
        if self._empty:
            self._anchor_stamps[:] = stamp
            self._anchor_positions[:] = q
            self._anchor_velocities[:] = v
        code = accept_joints(*self.arrays, stamp, q, v)
        self._empty = self._empty and code != ALLOWED
        self.code = code % 16
        if self.code not in (ALLOWED, TIME_BACKWARDS):
            self.joint = code // 16
