"""Decides which joint states are believed.

A state is believed if it is well formed, within the robot's limits and errors, fresh, and reachable
from every state believed before. The first state that is not latches a STOP: if a robot reports an
impossible state, nothing is known about it. `joint_acceptance` decides, and answers with a code, a
joint and numbers; `armguard.monitor.joint_reasons` makes words of them.
"""

from __future__ import annotations

import math

import numpy as np

from armguard.jit.arrays import FloatArray
from armguard.jit.handle import machine_code, pack
from armguard.robot.joint_acceptance import (
    Guard,
    accept_at,
    find_runaway,
    stop_times,
)
from armguard.robot.joint_history import make_history
from armguard.robot.operating_limits import LimitsInForce, put_in_force
from armguard.robot.robot import Robot
from armguard.robot.stop_time import compute_stop_time
from armguard.robot.wrap_angle import find_continuous

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
        in_force: The limits and brakes in force, shared; None: the robot's limits, and its brakes
            under the heaviest payload.
    """

    def __init__(
        self,
        robot: Robot,
        joint_timeout: float,
        horizon: float = 0.0,
        reaction_time: float = 0.0,
        period: float = 0.0,
        in_force: LimitsInForce | None = None,
    ) -> None:
        in_force = put_in_force(robot, in_force)
        joints = len(robot.joints)
        self.q: FloatArray = np.zeros(joints)
        """Joint positions believed last, [rad] or [m]; of a continuous joint whole turns nearest to
        those before, whatever its driver says. Shape (nv,)."""
        self.v: FloatArray = np.zeros(joints)
        """Joint velocities believed last, [rad/s] or [m/s]. Shape (nv,)."""
        self.robot = robot
        """Whose states these are."""
        self.guard = Guard(
            q=self.q,
            v=self.v,
            read_q=np.zeros(joints),
            read_v=np.zeros(joints),
            # Of one type, or all that reads them is compiled anew for limits of less precision.
            lower=np.subtract(robot.lower_position_limit, robot.position_error, dtype=FLOAT),
            upper=np.add(robot.upper_position_limit, robot.position_error, dtype=FLOAT),
            fastest=np.add(robot.velocity_limit, robot.velocity_error, dtype=FLOAT),
            continuous=find_continuous(robot.lower_position_limit, robot.upper_position_limit),
            operating_velocity=in_force.velocity,
            operating_acceleration=in_force.acceleration,
            velocity_error=np.array(robot.velocity_error, dtype=FLOAT),
            acceleration_limit=np.array(robot.acceleration_limit, dtype=FLOAT),
            brakes=in_force.brakes,
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
        strided = np.zeros((2, 2))[:, 0]  # a single joint's would be of another type
        self._accept = machine_code(accept_at, self._handle, 0.0, strided, strided, 0.0)
        self._compile()

    def reset(self) -> None:
        """Forget all states; the next one starts a new history."""
        self.guard.heard[0] = -math.inf

    def delay_braking(self, delay: float) -> None:
        """Say how much later than at once the second stop time lets braking begin, in [s]."""
        self.guard.delay[0] = delay

    def stop_times(self, age: float) -> tuple[float, float]:
        """Both stop times of the state believed last, in [s]; see `joint_acceptance.stop_times`.

        Args:
            age: Of that state, in [s].
        """
        soon, late, _ = stop_times(self._handle, self.v, age)
        return soon, late

    def find_unbraked(self, age: float) -> int:
        """First joint that may be faster at the bite than its brakes are stated for, or -1.

        Args:
            age: Of the state believed last, in [s].
        """
        joint: int = stop_times(self._handle, self.v, age)[2]
        return joint

    def is_plain(self, q: object, v: object) -> bool:
        """Whether these are arrays that compiled code can be handed as they are, of any length."""
        return (
            type(q) is np.ndarray
            and type(v) is np.ndarray
            and (q.dtype is FLOAT or q.dtype == FLOAT)
            and (v.dtype is FLOAT or v.dtype == FLOAT)
            and q.ndim == 1 == v.ndim
        )

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

    def find_runaway(self) -> int:
        """First joint that cannot be kept from running into its stop; NO_JOINT if all can."""
        joint: int = find_runaway(self._handle, self.q, self.v)
        return joint

    def _compile(self) -> None:
        """Run every kernel once, so that none is compiled in a tick."""
        self.find_runaway()
        # Explanations ask for it by itself.
        guard = self.guard
        limits = guard.velocity_error, guard.operating_velocity, guard.acceleration_limit
        times, operating = (0.0, 0.0, 0.0), guard.operating_acceleration
        compute_stop_time(self.v, *limits, guard.brakes, *times, operating)
        # Limits may change after a state was accepted.
        self.stop_times(0.0)
