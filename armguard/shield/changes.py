"""Changes of motions: jerk-limited phases within the limits of joints, made by Ruckig [Ruckig]_.

Each change continues for a while, and then stops as hard as the limits allow, so that every motion
made of it contains its own stop.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armguard.exceptions import ArmguardError
from armguard.jit.arrays import FloatArray
from armguard.shield.motion import AlongPath, JointByJoint, Phase, Samples
from armguard.shield.path import MotionLimits, TimedPath

try:
    from ruckig import (
        ControlInterface,
        InputParameter,
        Result,
        Ruckig,
        RuckigError,
        Synchronization,
        Trajectory,
    )
except ModuleNotFoundError:
    raise ArmguardError(
        "armguard.shield",
        "needs the package ruckig, which is not installed",
        remedy="pip install 'armguard[shield]'",
    ) from None


class MotionError(ArmguardError):
    """There is no motion within limits from the given state of an arm."""


Values = Sequence[float] | FloatArray
"""Of each joint one."""

SLOWEST = 1e-9
"""Speed below which there is no motion, in the units of joints or of a path's pace."""

FULL_PACE = 1.0 + 1e-6
"""Greatest pace of a path: a pace above 1 would break limits; this allows for rounding of 1."""

FASTEST = 1e4
"""Changes of a pace where no joint moves, in [1]/[s²] and [1]/[s³]: none limits them there."""

PRACTICE = 0.97
"""Fraction of each limit that is used, since motions between samples differ slightly."""

PLACES = 48
"""Places ahead at which it is looked up how fast a path's pace may change."""

MOST_LOOKS = 6
"""At longer and longer ways ahead, until the stop is on the way that was looked at."""


class PaceChanges:
    """Changes of the pace along paths.

    Args:
        limits: Limits of the joints.
    """

    def __init__(self, limits: MotionLimits) -> None:
        self._limits = limits
        self._generator = Ruckig(1)
        self._given = InputParameter(1)
        self._given.control_interface = ControlInterface.Velocity
        self._given.target_acceleration = [0.0]

    def go_and_stop(
        self,
        path: TimedPath,
        place: tuple[float, float, float],
        begin: float,
        lasting: float,
        pace: float,
    ) -> AlongPath | None:
        """A motion that changes its pace for a while, and then stops on the path.

        Args:
            path: To go along.
            place: Where on it, at which pace, and how fast that changes, as `AlongPath.find_place`
                says.
            begin: When, in [s].
            lasting: Until the stop begins, in [s].
            pace: To be approached until then, 0 to 1.

        Returns:
            None where the joints' limits leave no change of pace, or one that leads back first, or
            that gets faster than the path's clock.
        """
        at, now, change = place
        fastest = max(now, pace)
        way = fastest * (lasting + 0.1)
        for _ in range(MOST_LOOKS):
            speeding, braking, jerk = self._find_limits(path, at, way, fastest)
            if not min(speeding, braking, jerk) > SLOWEST:
                return None
            grows = pace > now + 0.5 * change * abs(change) / jerk  # once its change has ended
            going = self._reach(place, pace, speeding if grows else braking, jerk)
            left = tuple(values[0] for values in going.at_time(lasting))
            if _turns_back(place, jerk) or _turns_back(left, jerk):
                return None
            peak = max(_find_peak(place, jerk), _find_peak(left, jerk))
            if peak > FULL_PACE:
                return None
            stopping = self._reach(left, 0.0, braking, jerk)
            passed = stopping.at_time(stopping.duration)[0][0] - at
            if passed <= way and peak <= fastest + SLOWEST:
                return AlongPath(path, [Phase(begin, going), Phase(begin + lasting, stopping)])
            way, fastest = max(way, 1.5 * passed), max(fastest, min(1.1 * peak, FULL_PACE))
        return None

    def _find_limits(
        self, path: TimedPath, at: float, way: float, fastest: float
    ) -> tuple[float, float, float]:
        """How fast the pace may grow and fall on a way ahead, and how fast that may change.

        In [1]/[s²], and [1]/[s³]. With q̈ = q'' w² + q' ẇ and q⃛ = q''' w³ + 3 q'' w ẇ + q' ẅ, what
        bends take at the fastest pace is left out of the limits; of the jerk that is left, changes
        on bends take one half, and changes of the change the other.
        """
        limits = self._limits
        _, slope, bend, turn = map(np.abs, path.evaluate(np.linspace(at, at + way, PLACES)))
        moving = np.maximum(slope, SLOWEST)
        bent = bend * fastest**2
        spare = PRACTICE * limits.jerk - turn * fastest**3
        on_bends = float((0.5 * spare / np.maximum(3.0 * bend * fastest, SLOWEST)).min())
        braking = float(((PRACTICE * limits.braking - bent) / moving).min())
        speeding = float(((PRACTICE * limits.acceleration - bent) / moving).min())
        jerk = float((0.5 * spare / moving).min())
        braking = min(braking, on_bends, FASTEST)
        return min(speeding, braking), braking, min(jerk, FASTEST)

    def _reach(
        self, state: tuple[float, ...], pace: float, change: float, jerk: float
    ) -> Trajectory:
        """From a place, pace and change to a pace."""
        given = self._given
        given.current_position = [state[0]]
        given.current_velocity = [state[1]]
        given.current_acceleration = [state[2]]
        given.target_velocity = [pace]
        given.max_acceleration, given.max_jerk = [change], [jerk]
        return _make_trajectory(self._generator, given)


def _turns_back(state: tuple[float, ...], jerk: float) -> bool:
    """Whether a pace that falls gets below 0, however soon the jerk ends its fall."""
    _, pace, change = state
    return pace - 0.5 * min(change, 0.0) ** 2 / jerk < -SLOWEST


def _find_peak(state: tuple[float, ...], jerk: float) -> float:
    """The fastest that a pace gets which still grows, however soon the jerk ends its growth."""
    _, pace, change = state
    return pace + 0.5 * max(change, 0.0) ** 2 / jerk


class JointChanges:
    """Changes of the joints' velocities.

    Args:
        limits: Limits of the joints.
    """

    def __init__(self, limits: MotionLimits) -> None:
        joints = len(limits.velocity)
        self._generator = Ruckig(joints)
        self._given = given = InputParameter(joints)
        given.max_velocity = PRACTICE * limits.velocity
        given.max_jerk = PRACTICE * limits.jerk
        given.target_acceleration = self._rest = np.zeros(joints)
        self.top_speed = PRACTICE * limits.velocity
        self._going = PRACTICE * np.minimum(limits.acceleration, limits.braking)
        self._braking = PRACTICE * limits.braking

    def go_and_stop(
        self, state: Samples, begin: float, lasting: float, velocity: FloatArray
    ) -> JointByJoint:
        """A motion that approaches a velocity for a while, and then stops.

        Args:
            state: At its beginning, one sample.
            begin: When, in [s].
            lasting: Until the stop begins, in [s].
            velocity: Of all joints, in [rad]/[s] or [m]/[s]. Shape (nv,).
        """
        going = self._reach(state.q[0], state.v[0], state.a[0], velocity, self._going)
        return self.stop_after([Phase(begin, going)], begin + lasting)

    def track(
        self, state: Samples, begin: float, lasting: float, q: FloatArray, velocity: FloatArray
    ) -> Phase:
        """A phase towards a place that is to be passed at a velocity, not before its time.

        Args:
            state: At its beginning, one sample.
            begin: When, in [s].
            lasting: Until the place is to be passed, in [s].
            q: The place, in [rad] or [m]. Shape (nv,).
            velocity: There, in [rad]/[s] or [m]/[s]. Shape (nv,).
        """
        given = self._given
        given.control_interface = ControlInterface.Position
        given.synchronization = Synchronization.Time
        given.target_position = q
        given.minimum_duration = lasting
        trajectory = self._calculate(state.q[0], state.v[0], state.a[0], velocity, self._going)
        given.minimum_duration = None
        return Phase(begin, trajectory)

    def stop_after(self, phases: list[Phase], time: float) -> JointByJoint:
        """A motion that leaves some phases at a time, in [s], and stops as hard as it may."""
        kept = [phase for phase in phases if phase.begin < time]
        begin, trajectory = kept[-1]
        q, v, a = trajectory.at_time(time - begin)
        stopping = self._reach(q, v, a, self._rest, self._braking)
        return JointByJoint([*kept, Phase(time, stopping)])

    def _reach(
        self, q: Values, v: Values, a: Values, velocity: Values, change: FloatArray
    ) -> Trajectory:
        """From a state to a velocity, each joint in its own time."""
        self._given.control_interface = ControlInterface.Velocity
        self._given.synchronization = Synchronization.No
        return self._calculate(q, v, a, velocity, change)

    def _calculate(
        self, q: Values, v: Values, a: Values, velocity: Values, change: FloatArray
    ) -> Trajectory:
        given = self._given
        given.current_position, given.current_velocity, given.current_acceleration = q, v, a
        given.target_velocity = velocity
        given.max_acceleration = change
        return _make_trajectory(self._generator, given)


def _make_trajectory(generator: Ruckig, given: InputParameter) -> Trajectory:
    trajectory = Trajectory(given.degrees_of_freedom)
    try:
        result = generator.calculate(given, trajectory)
    except (RuckigError, ValueError):  # the latter for results that have no name
        result = Result.Error
    if result not in (Result.Working, Result.Finished):
        raise MotionError("motion", f"is refused by Ruckig: {result.name}")
    return trajectory
