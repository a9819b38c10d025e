"""Which joint states the monitor believes.

A state is believed when it is well formed, inside the robot's limits and errors, fresh, and
reachable from every state believed before. The first that is not latches a STOP: a robot that
reports the impossible is a robot about which nothing is known.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armguard.compilation import kernel
from armguard.handle import pack
from armguard.plausibility import ALLOWED, JointHistory, accept_joints
from armguard.robot import Robot
from armguard.verdict import Reason, ReasonKind, compute_stop_time

FloatArray = NDArray[np.float64]
FLOAT = np.dtype(np.float64)

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
    history: tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]
    """What `accept_joints` works on."""


class JointStates:
    """The joint states of one robot, checked one after the other.

    Args:
        robot: Whose limits and errors apply.
        joint_timeout: Longest age of a state and longest step between two, in [s].
        horizon: Until the verdict after the present one is obeyed, in [s].
        reaction_time: From command to braking torque, in [s].
    """

    def __init__(
        self, robot: Robot, joint_timeout: float, horizon: float = 0.0, reaction_time: float = 0.0
    ) -> None:
        self.q: FloatArray = np.zeros(len(robot.joints))
        """Last well-formed joint positions, [rad] or [m]. Shape (nv,)."""
        self.v: FloatArray = np.zeros(len(robot.joints))
        """Last well-formed joint velocities, [rad/s] or [m/s]. Shape (nv,)."""
        self._last_stamp = np.array([-math.inf])
        self._robot = robot
        self._delays = float(horizon), float(reaction_time)
        self._timeout = joint_timeout
        self._read: FloatArray = np.zeros(len(robot.joints))
        self._read_v: FloatArray = np.zeros(len(robot.joints))
        self._lower = robot.lower_position_limit - robot.position_error
        self._upper = robot.upper_position_limit + robot.position_error
        self._fastest = robot.velocity_limit + robot.velocity_error
        self._slowest = -self._fastest
        self._history = JointHistory(
            robot.velocity_limit,
            robot.acceleration_limit,
            robot.position_error,
            robot.velocity_error,
        )
        self._fresh = True
        self._shape = self.q.shape
        self._guard = pack(
            Guard(
                self.q,
                self.v,
                self._lower,
                self._upper,
                self._fastest,
                np.array(robot.velocity_limit),
                np.array(robot.velocity_error),
                np.array(robot.acceleration_limit),
                np.array(robot.braking_deceleration),
                self._last_stamp,
                float(joint_timeout),
                *self._delays,
                self._history.arrays,
            )
        )
        self._compile()

    def reset(self) -> None:
        """Forget all states; the next one starts a new history."""
        self._last_stamp[0] = -math.inf
        self._fresh = True

    def stop_time(self, age: float) -> float:
        """Time in which all joints surely rest, for a state that is `age` old, both in [s]."""
        robot = self._robot
        stop_time: float = compute_stop_time(
            self.v,
            robot.velocity_error,
            robot.velocity_limit,
            robot.acceleration_limit,
            robot.braking_deceleration,
            age,
            *self._delays,
        )
        return stop_time

    def glance(self, stamp: float, q: ArrayLike, v: ArrayLike, now: float) -> tuple[int, float]:
        """Take the state of a tick if there is nothing to be said against it, in one compiled call.

        Args:
            stamp: When the state was measured, in [s].
            q: Joint positions, [rad] or [m]. Shape (nv,).
            v: Joint velocities, [rad/s] or [m/s]. Shape (nv,).
            now: Time of the tick, in [s].

        Returns:
            What was found, and the time in which all joints surely rest, in [s]. Where that is
            DOUBTFUL, nothing was taken: `receive` says what there is against it.
        """
        usual = (
            type(q) is np.ndarray
            and type(v) is np.ndarray
            and q.dtype is FLOAT
            and v.dtype is FLOAT
            and q.shape == v.shape == self._shape
        )
        if self._fresh or not usual:
            return DOUBTFUL, math.inf
        # Whatever their strides are: compiled code is made for one kind of array.
        self._read[:] = q
        self._read_v[:] = v
        found: tuple[int, float] = _glance(self._guard, stamp, self._read, self._read_v, now)
        return found

    def receive(self, stamp: float, q: ArrayLike, v: ArrayLike, now: float) -> Reason | None:
        """Take the state of a tick; None if it is believed, otherwise why not.

        Args:
            stamp: When the state was measured, in [s]; finite.
            q: Joint positions, [rad] or [m]. Shape (nv,).
            v: Joint velocities, [rad/s] or [m/s]. Shape (nv,).
            now: Time of the tick, in [s]; finite.
        """
        malformed = self._copy("q", q, self.q) or self._copy("v", v, self.v)
        if malformed:
            return malformed
        return self._check_limits() or self._check_time(stamp, now) or self._check_history(stamp)

    def stopping(self) -> Reason | None:
        """Why a joint cannot be kept from running into its stop; None if all can."""
        robot = self._robot
        joint = _find_runaway(
            self.q, self.v, self._lower, self._upper, robot.velocity_error, robot.acceleration_limit
        )
        if joint == NOBODY:
            return None
        limits = robot.lower_position_limit[joint], robot.upper_position_limit[joint]
        return Reason(
            ReasonKind.JOINT_STOP_AHEAD,
            robot.joints[joint],
            f"at {self.q[joint]:.6g} with velocity {self.v[joint]:.3g}, "
            f"between stops at {limits[0]:.6g} and {limits[1]:.6g}",
        )

    def _copy(self, name: str, values: ArrayLike, into: FloatArray) -> Reason | None:
        try:
            if isinstance(values, np.ma.MaskedArray):
                # What was masked out was not measured.
                values = np.ma.filled(values.astype(np.float64), np.nan)
            array = np.asarray(values)
        except Exception:
            # Whatever an object of somebody else's raises here, it is no array.
            return Reason(ReasonKind.JOINT_STATE_MALFORMED, name, "not an array of numbers")
        # NumPy would read strings of digits as numbers, and drop imaginary parts.
        if array.dtype.kind not in "fiu":
            detail = f"array of {array.dtype}, expected numbers"
            return Reason(ReasonKind.JOINT_STATE_MALFORMED, name, detail)
        if array.shape != into.shape:
            detail = f"shape {array.shape}, expected {into.shape}"
            return Reason(ReasonKind.JOINT_STATE_MALFORMED, name, detail)
        self._read[:] = array
        joint = _take_finite(self._read, into)
        if joint == NOBODY:
            return None
        detail = f"{name} is {self._read[joint]}"
        return Reason(ReasonKind.JOINT_STATE_MALFORMED, self._robot.joints[joint], detail)

    def _check_limits(self) -> Reason | None:
        for name, value, lower, upper in (
            ("q", self.q, self._lower, self._upper),
            ("v", self.v, self._slowest, self._fastest),
        ):
            joint = _find_outside(value, lower, upper)
            if joint != NOBODY:
                detail = (
                    f"{name} is {value[joint]:.6g}, limits with errors are "
                    f"{lower[joint]:.6g} to {upper[joint]:.6g}"
                )
                return Reason(
                    ReasonKind.JOINT_STATE_BEYOND_LIMITS, self._robot.joints[joint], detail
                )
        return None

    def _check_time(self, stamp: float, now: float) -> Reason | None:
        last, self._last_stamp[0] = float(self._last_stamp[0]), stamp
        if stamp < last:
            return Reason(ReasonKind.TIME_BACKWARDS, "joint states", f"{stamp!r} after {last!r}")
        if not stamp - last <= self._timeout and not self._fresh:
            detail = f"{stamp - last:.3g} s between two, expected at most {self._timeout:.3g} s"
            return Reason(ReasonKind.JOINT_STATE_GAP, "joint states", detail)
        if not abs(now - stamp) <= self._timeout:
            detail = f"{now - stamp:.3g} s old, expected at most {self._timeout:.3g} s"
            return Reason(ReasonKind.JOINT_STATE_GAP, "joint states", detail)
        return None

    def _check_history(self, stamp: float) -> Reason | None:
        history = self._history
        receive = history.restart if self._fresh else history.accept
        if receive(stamp, self.q, self.v) == ALLOWED:
            self._fresh = False
            return None
        return Reason(ReasonKind.JOINT_STATE_JUMPED, *history.describe(self._robot.joints))

    def _compile(self) -> None:
        """Run every kernel once, so that none is compiled in a tick."""
        _take_finite(self._read, self.q)
        self._check_limits()
        self.stopping()
        _glance(self._guard, math.nan, self._read, self._read_v, 0.0)
        self.stop_time(0.0)


@kernel
def _glance(
    handle: Any,
    stamp: float,
    q: FloatArray,
    v: FloatArray,
    now: float,
) -> tuple[int, float]:
    """`JointStates.glance`."""
    guard = handle.content
    last = guard.last_stamp[0]
    if not (0.0 <= stamp - last <= guard.timeout and abs(now - stamp) <= guard.timeout):
        return DOUBTFUL, np.inf
    found = BELIEVED
    for j in range(q.shape[0]):
        if not (guard.lower[j] <= q[j] <= guard.upper[j] and abs(v[j]) <= guard.fastest[j]):
            return DOUBTFUL, np.inf
        if not abs(q[j]) < np.inf:
            return DOUBTFUL, np.inf
        if not abs(v[j]) <= guard.velocity_limit[j]:
            found |= FAST
    limits, reachable, stamps, positions, velocities = guard.history
    if accept_joints(limits, reachable, stamps, positions, velocities, stamp, q, v) != ALLOWED:
        return DOUBTFUL, np.inf
    guard.last_stamp[0] = stamp
    guard.q[:] = q
    guard.v[:] = v
    runaway = _find_runaway(
        guard.q, guard.v, guard.lower, guard.upper, guard.velocity_error, guard.acceleration_limit
    )
    if runaway != NOBODY:
        found |= RUNAWAY
    stop_time = compute_stop_time(
        guard.v,
        guard.velocity_error,
        guard.velocity_limit,
        guard.acceleration_limit,
        guard.braking_deceleration,
        now - stamp,
        guard.horizon,
        guard.reaction_time,
    )
    return found, stop_time


@kernel
def _take_finite(values: FloatArray, into: FloatArray) -> int:
    """Copy the values if all are finite; otherwise the joint of the first that is not."""
    for joint in range(values.shape[0]):
        if not abs(values[joint]) < np.inf:
            return joint
    into[:] = values
    return NOBODY


@kernel
def _find_outside(values: FloatArray, lower: FloatArray, upper: FloatArray) -> int:
    """First joint whose value is not between its limits."""
    for joint in range(values.shape[0]):
        if not lower[joint] <= values[joint] <= upper[joint]:
            return joint
    return NOBODY


@kernel
def _find_runaway(
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
