"""Which joint states the monitor believes, and why not the others, in words.

A state is believed when it is well formed, inside the robot's limits and errors, fresh, and
reachable from every state believed before. The first that is not latches a STOP: a robot that
reports the impossible is a robot about which nothing is known. `joint_acceptance` decides.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from armguard.jit.arrays import FloatArray
from armguard.jit.handle import machine_code, pack
from armguard.jit.numerics import (
    POSITION_BY_ACCEL,
    POSITION_BY_SPEED,
    VELOCITY_BY_ACCEL,
    VELOCITY_BY_SPEED,
)
from armguard.robot import joint_acceptance as acceptance
from armguard.robot.joint_acceptance import NOBODY, Guard, accept_at, find_runaway
from armguard.robot.joint_history import make_history
from armguard.robot.joints import is_prismatic
from armguard.robot.robot import Robot
from armguard.robot.stop_time import compute_stop_time
from armguard.robot.turns import find_continuous
from armguard.verdict import Reason, ReasonKind

FLOAT = np.dtype(np.float64)


class JointStates:
    """The joint states of one robot, checked one after the other.

    Args:
        robot: Whose limits and errors apply.
        joint_timeout: Longest age of a state, longest step between two, and how long one stamp may
            stand, in [s].
        horizon: Until the verdict after the present one is obeyed, in [s].
        reaction_time: From command to braking torque, in [s].
        period: Of ticks, in [s]; what passes in each where their time stands.
    """

    def __init__(
        self,
        robot: Robot,
        joint_timeout: float,
        horizon: float = 0.0,
        reaction_time: float = 0.0,
        period: float = 0.0,
    ) -> None:
        joints = len(robot.joints)
        self.q: FloatArray = np.zeros(joints)
        """Joint positions believed last, [rad] or [m]; of a continuous joint whole turns nearest to
        those before, whatever its driver says. Shape (nv,)."""
        self.v: FloatArray = np.zeros(joints)
        """Joint velocities believed last, [rad/s] or [m/s]. Shape (nv,)."""
        self._robot = robot
        slides = [is_prismatic(robot.model, 1 + joint) for joint in range(joints)]
        self._units = ["m" if sliding else "rad" for sliding in slides]
        self.guard = Guard(
            q=self.q,
            v=self.v,
            read_q=np.zeros(joints),
            read_v=np.zeros(joints),
            lower=robot.lower_position_limit - robot.position_error,
            upper=robot.upper_position_limit + robot.position_error,
            fastest=robot.velocity_limit + robot.velocity_error,
            continuous=find_continuous(robot.lower_position_limit, robot.upper_position_limit),
            velocity_limit=np.array(robot.velocity_limit),
            velocity_error=np.array(robot.velocity_error),
            acceleration_limit=np.array(robot.acceleration_limit),
            braking_deceleration=np.array(robot.braking_deceleration),
            heard=np.array([-math.inf]),
            standing=np.zeros(3),
            numbers=np.zeros(3),
            timeout=float(joint_timeout),
            period=float(period),
            horizon=float(horizon),
            reaction_time=float(reaction_time),
            delay=np.zeros(1),
            history=make_history(
                robot.velocity_limit,
                robot.acceleration_limit,
                robot.position_error,
                robot.velocity_error,
            ),
        )
        self._handle = pack(self.guard)
        strided = np.zeros((joints, 2))[:, 0]
        self._accept = machine_code(accept_at, self._handle, 0.0, strided, strided, 0.0)
        self._compile()

    def reset(self) -> None:
        """Forget all states; the next one starts a new history."""
        self.guard.heard[0] = -math.inf

    def delay_braking(self, delay: float) -> None:
        """Say how much later than at once the second stop time lets braking begin, in [s]."""
        self.guard.delay[0] = delay

    def is_plain(self, q: object, v: object) -> bool:
        """Whether these are arrays that compiled code can be handed as they are, of any length."""
        return (
            type(q) is np.ndarray
            and type(v) is np.ndarray
            and (q.dtype is FLOAT or q.dtype == FLOAT)
            and (v.dtype is FLOAT or v.dtype == FLOAT)
            and q.ndim == 1 == v.ndim
        )

    def read(self, q: ArrayLike, v: ArrayLike) -> tuple[FloatArray, FloatArray] | Reason:
        """Plain arrays of whatever was given for positions and velocities, or what is wrong."""
        read_q = self._read("q", q)
        if isinstance(read_q, Reason):
            return read_q
        read_v = self._read("v", v)
        return read_v if isinstance(read_v, Reason) else (read_q, read_v)

    def accept(
        self, stamp: float, q: FloatArray, v: FloatArray, now: float
    ) -> tuple[int, int, float, float]:
        """Take the state of a tick if there is nothing to be said against it.

        Args:
            stamp: When the state was measured, in [s]; finite.
            q: Joint positions, [rad] or [m]; plain. Shape (nv,).
            v: Joint velocities, [rad/s] or [m/s]; plain. Shape (nv,).
            now: Time of the tick, in [s]; finite.

        Returns:
            What was found, below 0 where the state is refused, the joint that it is refused for,
            and both stop times, in [s]: see `joint_acceptance.accept`.
        """
        found: tuple[int, int, float, float] = self._accept(self._handle, stamp, q, v, now)
        return found

    def describe(
        self, found: int, joint: int, stamp: float, q: FloatArray, v: FloatArray
    ) -> Reason:
        """Why the state handed over last was refused.

        Args:
            found: As it was found, below 0.
            joint: For which it was refused.
            stamp: Of the state, in [s].
            q: Its positions, [rad] or [m].
            v: Its velocities, [rad/s] or [m/s].
        """
        code, guard = -found, self.guard
        value, allowed, duration = guard.numbers.tolist()
        if code == acceptance.WRONG_LENGTH:
            name, array = ("q", q) if q.shape != self.q.shape else ("v", v)
            detail = f"shape {array.shape}, expected {self.q.shape}"
            return Reason(ReasonKind.JOINT_STATE_MALFORMED, name, detail)
        at_most = f"expected at most {guard.timeout:.3g} s"
        about_time = {
            acceptance.STAMP_BACKWARDS: (
                ReasonKind.TIME_BACKWARDS,
                f"{stamp!r} after {float(guard.heard[0])!r}",
            ),
            acceptance.TOO_OLD: (ReasonKind.JOINT_STATE_GAP, f"{value:.3g} s old, {at_most}"),
            acceptance.GAP: (
                ReasonKind.JOINT_STATE_GAP,
                f"{value:.3g} s between two, {at_most}",
            ),
            acceptance.STAMP_STANDS: (
                ReasonKind.JOINT_STATE_GAP,
                f"stamp {stamp!r} has not changed for {value:.3g} s, {at_most}",
            ),
        }
        if code in about_time:
            kind, detail = about_time[code]
            return Reason(kind, "joint states", detail)
        subject = self._robot.joints[joint]
        unit = self._units[joint]
        if code in (acceptance.POSITION_NOT_FINITE, acceptance.VELOCITY_NOT_FINITE):
            name = "q" if code == acceptance.POSITION_NOT_FINITE else "v"
            return Reason(ReasonKind.JOINT_STATE_MALFORMED, subject, f"{name} is {value}")
        if code in (acceptance.POSITION_BEYOND_LIMITS, acceptance.VELOCITY_BEYOND_LIMITS):
            name, lower, upper = "v", -allowed, allowed
            unit = f"{unit}/s"
            if code == acceptance.POSITION_BEYOND_LIMITS:
                name, lower, upper = "q", float(guard.lower[joint]), float(guard.upper[joint])
                unit = self._units[joint]
            found_text, lower_text, upper_text = _spell(value, lower, upper, digits=6)
            detail = f"{name} is {found_text} {unit}, limits with errors are "
            detail += f"{lower_text} to {upper_text} {unit}"
            return Reason(ReasonKind.JOINT_STATE_BEYOND_LIMITS, subject, detail)
        text, rate = {
            POSITION_BY_ACCEL: ("moved off its course by", ""),
            POSITION_BY_SPEED: ("moved by", ""),
            VELOCITY_BY_ACCEL: ("changed its velocity by", "/s"),
            VELOCITY_BY_SPEED: ("moved at", "/s"),
        }[code]
        found_text, limit_text = _spell(value, allowed, digits=3)
        detail = (
            f"{text} {found_text} {unit}{rate} in {_spell_time(duration)}, "
            f"limit {limit_text} {unit}{rate}"
        )
        return Reason(ReasonKind.JOINT_STATE_JUMPED, subject, detail)

    def stopping(self) -> Reason | None:
        """Why a joint cannot be kept from running into its stop; None if all can."""
        robot, guard = self._robot, self.guard
        joint = find_runaway(
            self.q, self.v, guard.lower, guard.upper, robot.velocity_error, robot.acceleration_limit
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

    def _read(self, name: str, values: ArrayLike) -> FloatArray | Reason:
        try:
            if isinstance(values, np.ma.MaskedArray):
                # What was masked out was not measured.
                values = np.ma.filled(values.astype(np.float64), np.nan)
            array = np.asarray(values)
            # NumPy would read strings of digits as numbers, and drop imaginary parts.
            if array.dtype.kind not in "fiu":
                detail = f"array of {array.dtype}, expected numbers"
                return Reason(ReasonKind.JOINT_STATE_MALFORMED, name, detail)
            if array.shape != self.q.shape:
                detail = f"shape {array.shape}, expected {self.q.shape}"
                return Reason(ReasonKind.JOINT_STATE_MALFORMED, name, detail)
            with np.errstate(all="ignore"):
                # What is too large for a float becomes infinite, and is refused as that.
                return np.array(array, dtype=np.float64)
        except Exception:
            # Whatever an object of somebody else's raises here, it is no array.
            return Reason(ReasonKind.JOINT_STATE_MALFORMED, name, "not an array of numbers")

    def _compile(self) -> None:
        """Run every kernel once, so that none is compiled in a tick."""
        self.stopping()
        # Explanations ask for it by itself.
        guard = self.guard
        limits = guard.velocity_error, guard.velocity_limit, guard.acceleration_limit
        compute_stop_time(self.v, *limits, guard.braking_deceleration, 0.0, 0.0, 0.0)


def _spell(value: float, *limits: float, digits: int) -> list[str]:
    """A value and its limits with at least so many digits, and as many as tell it from them."""
    while digits < 17:
        texts = [f"{number:.{digits}g}" for number in (value, *limits)]
        if texts[0] not in texts[1:]:
            break
        digits += 3
    return texts


def _spell_time(duration: float) -> str:
    """A duration in [s], in words."""
    return f"{1e3 * duration:.3g} ms" if duration < 1.0 else f"{duration:.3g} s"
