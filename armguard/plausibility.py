"""Is a new measured state inside what an older one allows?

A certificate made from an old state stays true for as long as the body keeps its bounds. These
tests say whether a newer (or late) measurement agrees with that: for obstacles between any two
records, for the arm against everything accepted before.

Rounding goes towards acceptance and is bounded: durations are widened by `SLACK` (eight ulp of 1)
times the stamps, lengths and speeds by `SLACK` times the magnitudes that enter the test. NaN never
passes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armguard.compilation import kernel
from armguard.exceptions import ArmguardError

Array = NDArray[np.float64]

SLACK = 8.0 * float(np.finfo(np.float64).eps)

ALLOWED = 0
POSITION_BY_ACCEL = 1
POSITION_BY_SPEED = 2
VELOCITY_BY_ACCEL = 3
VELOCITY_BY_SPEED = 4
SHAPE = 5
NOT_FINITE = 6
TIME_BACKWARDS = 7

MEANING = {
    POSITION_BY_ACCEL: "moved farther than its acceleration allows",
    POSITION_BY_SPEED: "moved farther than its speed allows",
    VELOCITY_BY_ACCEL: "changed its velocity by more than its acceleration allows",
    VELOCITY_BY_SPEED: "is faster than its speed bound",
    SHAPE: "changed its shape",
    NOT_FINITE: "is not finite",
    TIME_BACKWARDS: "has an older stamp than the state before",
}
"""What each code says of a body or a joint, to follow its name."""

ANCHOR_AGES = np.array([0.0, 0.01, 0.04, 0.16, 0.64])
"""Ages at which the states that the quadratic test looks back on are renewed, in [s].

The first is always the state before. The oldest reaches about as far as the quadratic bound of an
arm's joint stays tighter than its speed bound. Shape (anchors,).
"""


@kernel
def body_allows(
    points0: Array,
    velocities0: Array,
    count0: int,
    radius0: float,
    accel0: float,
    speed0: float,
    position_error0: float,
    velocity_error0: float,
    stamp0: float,
    points1: Array,
    velocities1: Array,
    count1: int,
    radius1: float,
    position_error1: float,
    velocity_error1: float,
    stamp1: float,
) -> int:
    """Whether record 1 of a body can be true if record 0 and its bounds are.

    With h = stamp1 - stamp0, for every point of the hull:
    |x1 - x0 - v0 h| + r1 <= r0 + A h^2 / 2 + dv0 |h| + dp0 + dp1, |x1 - x0| + r1 <= r0 + V |h|
    + dp0 + dp1, |v1 - v0| <= A |h| + dv0 + dv1 and |v1| <= V + dv1, with A and V of record 0.

    Args:
        points0: Points of the hull, in [m]; the first `count0` rows count. Shape (k, 3).
        velocities0: Theirs, in [m]/[s]. Shape (k, 3).
        count0: Number of points.
        radius0: Radius around the hull, in [m].
        accel0: Bound on acceleration, in [m]/[s]^2; inf for none.
        speed0: Bound on speed, in [m]/[s]; inf for none.
        position_error0: What positions may be off by, in [m].
        velocity_error0: What velocities may be off by, in [m]/[s].
        stamp0: Time of record 0, in [s].
        points1: The same of record 1, which may be the older one. Shape (k, 3).
        velocities1: The same of record 1. Shape (k, 3).
        count1: The same of record 1.
        radius1: The same of record 1.
        position_error1: The same of record 1.
        velocity_error1: The same of record 1.
        stamp1: The same of record 1.

    Returns:
        ALLOWED (0), or the code of the first bound that is broken.
    """
    if not (1 <= count1 == count0 <= points0.shape[0] and count1 <= points1.shape[0]):
        return SHAPE
    elapsed = stamp1 - stamp0
    clock_slack = SLACK * (abs(stamp0) + abs(stamp1))
    duration = abs(elapsed) + clock_slack
    # An infinite bound must not meet a duration of zero in a product: that would be NaN.
    by_speed = math.inf if speed0 == math.inf else speed0 * duration
    velocity_change = math.inf if accel0 == math.inf else accel0 * duration
    if accel0 == math.inf or velocity_error0 == math.inf:
        by_accel = math.inf
    else:
        by_accel = (0.5 * accel0 * duration + velocity_error0) * duration
    room = radius0 + position_error0 + position_error1
    velocity_change += velocity_error0 + velocity_error1
    top_speed = speed0 + velocity_error1
    for k in range(count0):
        stray2 = step2 = change2 = velocity2 = 0.0
        length = rate = 0.0
        for axis in range(3):
            x0, x1 = points0[k, axis], points1[k, axis]
            v0, v1 = velocities0[k, axis], velocities1[k, axis]
            step = x1 - x0
            stray = step - v0 * elapsed
            step2 += step * step
            stray2 += stray * stray
            change2 += (v1 - v0) * (v1 - v0)
            velocity2 += v1 * v1
            length += abs(x0) + abs(x1) + abs(v0) * duration
            rate += abs(v0) + abs(v1)
        stray = math.sqrt(stray2)
        bound = room + by_accel + SLACK * (length + room + radius1) + clock_slack * rate
        if not (stray < math.inf and stray + radius1 <= bound):
            return POSITION_BY_ACCEL
        step = math.sqrt(step2)
        bound = room + by_speed + SLACK * (length + room + radius1)
        if not (step < math.inf and step + radius1 <= bound):
            return POSITION_BY_SPEED
        change = math.sqrt(change2)
        if not (change < math.inf and change <= velocity_change + SLACK * rate):
            return VELOCITY_BY_ACCEL
        velocity = math.sqrt(velocity2)
        if not (velocity < math.inf and velocity <= top_speed + SLACK * (rate + top_speed)):
            return VELOCITY_BY_SPEED
    return ALLOWED


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
    top_speed, accel, position_error, velocity_error = limits[:, joint]
    if not (abs(q) < math.inf and abs(v) < math.inf):
        return NOT_FINITE
    slack = SLACK * (abs(q) + position_error)
    if not abs(v) <= (top_speed + velocity_error) * (1.0 + SLACK):
        return VELOCITY_BY_SPEED
    elapsed = stamp - anchor_stamps[0]
    clock_slack = SLACK * (abs(stamp) + abs(anchor_stamps[0]))
    # Within the measurement's error a joint that reads faster than its limit is believed.
    speed = max(top_speed, abs(v), abs(anchor_velocities[0, joint]))
    moved = speed * (elapsed + clock_slack) + position_error + slack
    highest, lowest = reachable[0, joint], reachable[1, joint]
    if not (lowest - moved <= q <= highest + moved):
        return POSITION_BY_SPEED
    changed = accel * (elapsed + clock_slack) + velocity_error + SLACK * (abs(v) + velocity_error)
    fastest, slowest = reachable[2, joint], reachable[3, joint]
    if not (slowest - changed <= v <= fastest + changed):
        return VELOCITY_BY_ACCEL
    for k in range(anchor_stamps.shape[0]):
        q0, v0 = anchor_positions[k, joint], anchor_velocities[k, joint]
        duration = stamp - anchor_stamps[k] + clock_slack
        stray = abs(q - q0 - v0 * (stamp - anchor_stamps[k]))
        bound = 2.0 * position_error + (0.5 * accel * duration + velocity_error) * duration
        bound += SLACK * (abs(q) + abs(q0) + abs(v0) * duration + bound) + clock_slack * abs(v0)
        if not stray <= bound:
            return POSITION_BY_ACCEL
    return ALLOWED


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
    # Rounded stamps add up exactly, so the slack for them belongs to the test alone.
    elapsed = stamp - anchor_stamps[0]
    for joint in range(joints):
        top_speed, accel, position_error, velocity_error = limits[:, joint]
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
