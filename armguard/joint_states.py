"""Which joint states the monitor believes.

A state is believed when it is well formed, inside the robot's limits and errors, fresh, and
reachable from every state believed before. The first that is not latches a STOP: a robot that
reports the impossible is a robot about which nothing is known.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armguard.plausibility import ALLOWED, JointHistory
from armguard.robot import Robot
from armguard.verdict import Reason, ReasonKind


class JointStates:
    """The joint states of one robot, checked one after the other.

    Args:
        robot: Whose limits and errors apply.
        joint_timeout: Longest age of a state and longest step between two, in [s].
    """

    def __init__(self, robot: Robot, joint_timeout: float) -> None:
        self.q: NDArray[np.float64] = np.zeros(len(robot.joints))
        """Last well-formed joint positions, [rad] or [m]. Shape (nv,)."""
        self.v: NDArray[np.float64] = np.zeros(len(robot.joints))
        """Last well-formed joint velocities, [rad/s] or [m/s]. Shape (nv,)."""
        self.stamp = -math.inf
        self._robot = robot
        self._timeout = joint_timeout
        self._history = JointHistory(
            robot.velocity_limit,
            robot.acceleration_limit,
            robot.position_error,
            robot.velocity_error,
        )
        self._fresh = True

    def reset(self) -> None:
        """Forget all states; the next one starts a new history."""
        self.stamp = -math.inf
        self._fresh = True

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
        for sign, distance in (
            (1.0, robot.upper_position_limit - self.q),
            (-1.0, self.q - robot.lower_position_limit),
        ):
            speed = np.maximum(sign * self.v + robot.velocity_error, 0.0)
            room = 2.0 * robot.acceleration_limit * (distance + robot.position_error)
            if not np.all(speed * speed <= room):
                joint = int(np.argmin(room - speed * speed))
                return Reason(
                    ReasonKind.JOINT_STOP_AHEAD,
                    robot.joints[joint],
                    f"{self.v[joint]:.3g} towards a limit {distance[joint]:.3g} away",
                )
        return None

    def _copy(self, name: str, values: ArrayLike, into: NDArray[np.float64]) -> Reason | None:
        try:
            array = np.asarray(values, dtype=np.float64)
        except (TypeError, ValueError):
            return Reason(ReasonKind.JOINT_STATE_MALFORMED, name, "not an array of numbers")
        if array.shape != into.shape:
            detail = f"shape {array.shape}, expected {into.shape}"
            return Reason(ReasonKind.JOINT_STATE_MALFORMED, name, detail)
        if not np.isfinite(array).all():
            joint = int(np.argmin(np.isfinite(array)))
            return Reason(
                ReasonKind.JOINT_STATE_MALFORMED,
                self._robot.joints[joint],
                f"{name} is {array[joint]}",
            )
        into[:] = array
        return None

    def _check_limits(self) -> Reason | None:
        robot = self._robot
        low = robot.lower_position_limit - robot.position_error
        high = robot.upper_position_limit + robot.position_error
        fast = robot.velocity_limit + robot.velocity_error
        for name, value, lower, upper in (("q", self.q, low, high), ("v", self.v, -fast, fast)):
            inside = (lower <= value) & (value <= upper)
            if not inside.all():
                joint = int(np.argmin(inside))
                detail = (
                    f"{name} is {value[joint]:.6g}, limits with errors are "
                    f"{lower[joint]:.6g} to {upper[joint]:.6g}"
                )
                return Reason(ReasonKind.JOINT_STATE_BEYOND_LIMITS, robot.joints[joint], detail)
        return None

    def _check_time(self, stamp: float, now: float) -> Reason | None:
        last, self.stamp = self.stamp, stamp
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
