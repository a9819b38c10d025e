"""A simulated arm that obeys the monitor: it follows a trajectory at the permitted speed.

Real controllers do two things with a verdict: they scale their speed along the path, or they
brake. Both are here. Slowing keeps to the path. Braking does not: every joint decelerates by its
guaranteed deceleration until it rests, which is what `stop_time` and every bound on a braking arm
take for granted, and which no single deceleration along a path could promise for all joints.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armguard.exceptions import ArmguardError
from armguard.lab.simulation.trajectory import JointTrajectory
from armguard.robot.operating_limits import OperatingLimits

Array = NDArray[np.float64]


class SimulatedArm:
    """An arm on a trajectory, at a commanded speed scale.

    What is guaranteed, with b and q̈max the robot's guaranteed braking deceleration and its
    acceleration limit:

    - |q̈| <= q̈max in every mode; positions stay between the waypoints that the arm moves between.
    - Operating limits, where there are any, are kept: no joint is faster than the velocity, or
      speeds up harder than the acceleration; it slows down as hard as its acceleration limit.
    - A speed scale s > 0 keeps every joint within s times its operating velocity, which is the
      velocity limit where none is stated, once the rate along the path has come down, which it does
      at the greatest rate that leaves |q̈| <= q̈max: meanwhile it is faster.
    - Scale 0 brakes: every joint decelerates by exactly b from this step on, or by the least that
      keeps the times and distances that its brakes are stated with, where that is more; it rests
      before the waypoint ahead. A brake is not released before the arm rests. Then,
      once the scale is above 0, it goes on to that waypoint, and from there along the trajectory.

    Args:
        trajectory: What to follow; its fractions of the limits must leave room for slowing.
        operating: What it keeps to; None: the robot's limits.

    Attributes:
        q: Joint positions now, in [rad] or [m]. Shape (nv,).
        v: Their derivatives, in [rad]/[s] or [m]/[s]. Shape (nv,).
        braking: Whether the brake is on.

    Raises:
        ArmguardError: The trajectory needs all the acceleration there is, or more than the
            operating limits allow.
    """

    def __init__(
        self, trajectory: JointTrajectory, operating: OperatingLimits | None = None
    ) -> None:
        robot = trajectory.robot
        self._trajectory = trajectory
        self._rejoin: JointTrajectory | None = None
        self._rejoin_time = 0.0  # of the trajectory, at the waypoint that the rejoin leads to
        self._time = 0.0  # along the trajectory or the rejoin, in nominal seconds
        self._deceleration = self._least = robot.brakes.gentlest_stop(np.zeros(len(robot.joints)))
        along_path = trajectory.acceleration_fraction * np.minimum(
            robot.acceleration_limit, self._least
        )
        speed = trajectory.speed_fraction * robot.velocity_limit
        velocity, acceleration = robot.velocity_limit, robot.acceleration_limit
        if operating is not None:
            velocity, acceleration = operating.resolve(robot)
        self._whole = float(np.min(velocity / speed))  # rate at a speed scale of 1
        self._rate = min(1.0, self._whole)  # nominal seconds per second
        # |q̈| = |q'' rate² + q' d(rate)/dt|, and the trajectory bounds |q''| and |q'|. Where the
        # rate grows joints speed up, beside what they do along the path.
        self._slowing = float(np.min((robot.acceleration_limit - along_path) / speed))
        self._speeding = float(np.min((acceleration - along_path) / speed))
        if not (self._slowing > 0.0 and self._speeding > 0.0):
            raise ArmguardError(
                "trajectory",
                "uses the whole acceleration limit and cannot be slowed, or sped up again",
                expected="an acceleration_fraction below 1, and within the operating limits",
            )
        self.q, self.v = trajectory.sample(0.0)
        self.braking = False

    def step(self, dt: float, speed_scale: float = 1.0) -> tuple[Array, Array]:
        """Advance by one step.

        Args:
            dt: Length of the step, in [s].
            speed_scale: Share of the operating velocities that is allowed, as a verdict gives it;
                0, or anything that is not a number above 0, brakes.

        Returns:
            The new `q` and `v`. Shapes (nv,).
        """
        if not (0.0 < dt < math.inf):
            raise ArmguardError("dt", f"is {dt}", expected="a positive time in [s]")
        if not (speed_scale > 0.0 or self.braking):
            self.braking = True
            stop = self._trajectory.robot.brakes.gentlest_stop(self.v)
            self._deceleration = np.maximum(self._least, stop)
        if self.braking:
            self._brake(dt)
            if speed_scale > 0.0 and not self.v.any():
                self._release()
        else:
            self._follow(dt, speed_scale)
        return self.q.copy(), self.v.copy()

    def preview(self, times: ArrayLike) -> tuple[Array, Array]:
        """Where an arm that does not brake is if it goes on as fast as it may, from its place now.

        Slower, it is on the same way, and never further along.

        Args:
            times: Counted from now, in [s], at least 0. Shape (k,).

        Returns:
            Positions in [rad] or [m], and velocities. Shape (k, nv) each.
        """
        states = []
        for time in (self._time + np.asarray(times, dtype=np.float64)).tolist():
            if self._rejoin is None:
                states.append(self._trajectory.sample(time))
            elif time < self._rejoin.duration:
                states.append(self._rejoin.sample(time))
            else:
                beyond = time - self._rejoin.duration
                states.append(self._trajectory.sample(self._rejoin_time + beyond))
        return np.array([q for q, _ in states]), np.array([v for _, v in states])

    def _brake(self, dt: float) -> None:
        """Decelerate each joint by itself; exact, whatever the length of the step."""
        moving = np.minimum(dt, np.abs(self.v) / self._deceleration)
        pull = -np.sign(self.v) * self._deceleration
        self.q = self.q + moving * (self.v + 0.5 * pull * moving)
        self.v = np.where(moving < dt, 0.0, self.v + pull * moving)

    def _release(self) -> None:
        """Go on, from rest: first to the waypoint ahead."""
        if self._rejoin is None:
            self._rejoin_time, target = self._trajectory.next_stop(self._time)
        else:
            target = self._rejoin.waypoints[-1]
        robot = self._trajectory.robot
        # Rounding may leave a joint an ulp beyond a waypoint that is at its limit.
        self.q = np.clip(self.q, robot.lower_position_limit, robot.upper_position_limit)
        self._rejoin = JointTrajectory(
            robot,
            np.stack([self.q, target]),
            speed_fraction=self._trajectory.speed_fraction,
            acceleration_fraction=self._trajectory.acceleration_fraction,
        )
        self._time = 0.0
        self._rate = 0.0
        self.braking = False

    def _follow(self, dt: float, speed_scale: float) -> None:
        wanted = min(1.0, speed_scale * self._whole)
        change = float(np.clip(wanted - self._rate, -self._slowing * dt, self._speeding * dt))
        self._time += (self._rate + 0.5 * change) * dt
        self._rate += change
        if self._rejoin is not None and self._time >= self._rejoin.duration:
            # The path rests here, so that the two meet smoothly at any rate.
            self._time += self._rejoin_time - self._rejoin.duration
            self._rejoin = None
        path = self._rejoin or self._trajectory
        self.q, slope = path.sample(self._time)
        self.v = self._rate * slope
