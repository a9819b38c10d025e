"""Which joint states the monitor believes.

A state is believed when it is well formed, inside the robot's limits and errors, fresh, and
reachable from every state believed before. The first that is not latches a STOP: a robot that
reports the impossible is a robot about which nothing is known.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armguard.compilation import kernel
from armguard.handle import machine_code, pack
from armguard.joint_glance import (
    DOUBTFUL,
    NOBODY,
    Guard,
    find_runaway,
    glance_at,
    stop_times_of,
)
from armguard.joint_history import JointHistory
from armguard.plausibility import ALLOWED
from armguard.robot import Robot
from armguard.verdict import Reason, ReasonKind, compute_stop_time

FloatArray = NDArray[np.float64]
FLOAT = np.dtype(np.float64)


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
        self._timeout = joint_timeout
        self._read: FloatArray = np.zeros(len(robot.joints))
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
        self.guard = Guard(
            self.q,
            self.v,
            self._read,
            np.zeros(len(robot.joints)),
            self._lower,
            self._upper,
            self._fastest,
            np.array(robot.velocity_limit),
            np.array(robot.velocity_error),
            np.array(robot.acceleration_limit),
            np.array(robot.braking_deceleration),
            self._last_stamp,
            float(joint_timeout),
            float(horizon),
            float(reaction_time),
            np.zeros(1),
            self._history.arrays,
        )
        self._handle = pack(self.guard)
        strided = np.zeros((len(robot.joints), 2))[:, 0]
        self._glance = machine_code(glance_at, self._handle, 0.0, strided, strided, 0.0)
        self._stop_times = machine_code(stop_times_of, self._handle, self.v, 0.0)
        self._compile()

    def reset(self) -> None:
        """Forget all states; the next one starts a new history."""
        self._last_stamp[0] = -math.inf
        self._fresh = True

    def delay_braking(self, delay: float) -> None:
        """Say how much later than at once the second stop time lets braking begin, in [s]."""
        self.guard.delay[0] = delay

    def stop_times(self, age: float) -> tuple[float, float]:
        """Times in which all joints surely rest, for a state that is `age` old, all in [s].

        The first is of an arm that is told to brake now, the second after the delay.
        """
        times: tuple[float, float] = self._stop_times(self._handle, self.v, age)
        return times

    def is_plain(self, q: object, v: object) -> bool:
        """Whether these are arrays that compiled code can be handed as they are, of any length."""
        return (
            type(q) is np.ndarray
            and type(v) is np.ndarray
            and (q.dtype is FLOAT or q.dtype == FLOAT)
            and (v.dtype is FLOAT or v.dtype == FLOAT)
            and q.ndim == 1 == v.ndim
        )

    def glance(
        self, stamp: float, q: ArrayLike, v: ArrayLike, now: float
    ) -> tuple[int, float, float]:
        """Take the state of a tick if there is nothing to be said against it, in one compiled call.

        Args:
            stamp: When the state was measured, in [s].
            q: Joint positions, [rad] or [m]. Shape (nv,).
            v: Joint velocities, [rad/s] or [m/s]. Shape (nv,).
            now: Time of the tick, in [s].

        Returns:
            What was found, and both stop times, in [s]. Where that is DOUBTFUL, nothing was taken:
            `receive` says what there is against it.
        """
        if not self.is_plain(q, v):
            return DOUBTFUL, math.inf, math.inf
        found: tuple[int, float, float] = self._glance(self._handle, stamp, q, v, now)
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
        joint = find_runaway(
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
        # Explanations ask for it by itself.
        guard = self.guard
        limits = guard.velocity_error, guard.velocity_limit, guard.acceleration_limit
        compute_stop_time(self.v, *limits, guard.braking_deceleration, 0.0, 0.0, 0.0)


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
