"""An arm at its work, whose trajectory's time stops while it brakes.

`armguard.simulation.SimulatedArm` goes on to the next waypoint after a stop. Here the arm returns
to where it left its path and goes on from there, so that the work that a stop has cost is what its
clock along the path has fallen behind.
"""

from __future__ import annotations

import copy

import numpy as np

from armguard.simulation import JointTrajectory

ACCELERATION_SHARE = 0.25
"""No joint speeds up by more than this share of its acceleration limit."""


class WorkingArm:
    """Follows a trajectory until it is to brake, and again once it may.

    Every joint brakes by itself at its guaranteed deceleration until it rests, and no brake is
    released before. Then the arm goes back, from rest to rest, to where it left the path, and on
    from there. At work, restarts included, no joint speeds up or slows down by more than
    `ACCELERATION_SHARE` of its acceleration limit, and none is faster than the trajectory's speed
    fraction of its velocity limit. What it plans to do next is what it does.

    Args:
        trajectory: What to follow, from its start at rest.
        deceleration: Of the brakes, in [rad]/[s]²; None: what the robot's guarantee at the
            heaviest payload. Shape (nv,).

    Attributes:
        q: Joint positions, in [rad] or [m]. Shape (nv,).
        v: Their derivatives, in [rad]/[s] or [m]/[s]. Shape (nv,).
        progress: Time along the trajectory, in [s].
        braking: Whether the brakes are on, as they are at first.
        deceleration: Of the brakes, in [rad]/[s]². Shape (nv,).
        leg: What it follows: the trajectory, or the way back to it.
        leg_time: Time along that, in [s].
        legs: How many legs it has begun.

    Raises:
        ValueError: The trajectory needs all the acceleration that there is for speeding up.
    """

    def __init__(self, trajectory: JointTrajectory, deceleration: np.ndarray | None = None) -> None:
        robot = trajectory.robot
        self._trajectory = trajectory
        self._robot = robot
        self.deceleration = robot.braking_deceleration if deceleration is None else deceleration
        along = trajectory.acceleration_fraction * np.minimum(
            robot.acceleration_limit, robot.braking_deceleration
        )
        self._top_speed = trajectory.speed_fraction * robot.velocity_limit
        # |q̈| = |q'' rate² + q' d(rate)/dt|, and the trajectory bounds |q''| and |q'|.
        spare = ACCELERATION_SHARE * robot.acceleration_limit - along
        self._slew = float(np.min(spare / self._top_speed))
        if not self._slew > 0.0:
            raise ValueError(
                f"the trajectory uses {ACCELERATION_SHARE:.0%} of the acceleration limits or more"
            )
        self.progress = 0.0
        self.braking = True
        self.legs = 0
        self.leg, self.leg_time = trajectory, 0.0
        self._rate = 0.0
        self.q, self.v = trajectory.sample(0.0)

    @property
    def rests(self) -> bool:
        """Whether no joint moves."""
        return not self.v.any()

    def step(self, dt: float, go: bool, speed_limit: np.ndarray | float = np.inf) -> None:
        """Advance by `dt` seconds, at work or braking.

        Args:
            dt: In [s].
            go: Whether it may go on; else it brakes.
            speed_limit: Of each joint at work, in [rad]/[s]: the rate along the path comes down to
                it as fast as the arm's accelerations allow. Shape (nv,).
        """
        if not go and not self.braking:
            self.braking, self._rate = True, 0.0
        if self.braking and go and self.rests:
            self._leave()
        if self.braking:
            self._brake(dt)
        else:
            self._follow(dt, speed_limit)

    def preview(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What it will do if it may go on, positions and velocities. Shapes (len(times), nv).

        Args:
            times: Rising from 0, in [s] from now.
        """
        arm = copy.copy(self)
        q, v = [self.q], [self.v]
        for dt in np.diff(times):
            arm.step(float(dt), True)
            q.append(arm.q)
            v.append(arm.v)
        return np.array(q), np.array(v)

    def _brake(self, dt: float) -> None:
        moving = np.minimum(dt, np.abs(self.v) / self.deceleration)
        pull = -np.sign(self.v) * self.deceleration
        self.q = self.q + moving * (self.v + 0.5 * pull * moving)
        self.v = np.where(moving < dt, 0.0, self.v + pull * moving)

    def _leave(self) -> None:
        """Set off, from rest, to where the path was left."""
        robot, path = self._robot, self._trajectory
        # Rounding may leave a joint an ulp beyond a waypoint that is at its limit.
        start = np.clip(self.q, robot.lower_position_limit, robot.upper_position_limit)
        self.leg = JointTrajectory(
            robot,
            np.stack([start, path.sample(self.progress)[0]]),
            speed_fraction=path.speed_fraction,
            acceleration_fraction=path.acceleration_fraction,
        )
        self.leg_time, self._rate = 0.0, 1.0
        self.legs += 1
        self.braking = False

    def _follow(self, dt: float, speed_limit: np.ndarray | float) -> None:
        while dt > 0.0 and self.leg is not self._trajectory:
            left = self.leg.duration - self.leg_time
            dt = self._advance(dt, speed_limit, left)
            if self.leg_time >= self.leg.duration:
                # It rests here, at the place on the path that it left at some speed.
                self.leg, self.leg_time, self._rate = self._trajectory, self.progress, 0.0
                self.legs += 1
        if dt > 0.0:
            self._advance(dt, speed_limit, np.inf)
        if self.leg is self._trajectory:
            self.progress = self.leg_time
        self.q, slope = self.leg.sample(self.leg_time)
        self.v = self._rate * slope

    def _advance(self, dt: float, speed_limit: np.ndarray | float, left: float) -> float:
        """Go on along the leg, by no more than what is left of it; the time that remains, [s]."""
        wanted = 1.0
        if np.min(speed_limit) < np.max(self._top_speed):
            # The faster of here and where this step leads, as far as that is known.
            slopes = [self.leg.sample(self.leg_time + ahead)[1] for ahead in (0.0, dt)]
            fastest = np.maximum(np.abs(slopes).max(axis=0), 1e-9)
            wanted = min(1.0, float(np.min(speed_limit / fastest)))
        change = float(np.clip(wanted - self._rate, -self._slew * dt, self._slew * dt))
        turning = abs(change) / self._slew
        rate = self._rate + change
        way = 0.5 * (self._rate + rate) * turning + rate * (dt - turning)
        used = dt
        if way >= left:
            # The leg rests at its end: whatever the rate, so does the arm.
            way, used = left, dt * left / way if way > 0.0 else 0.0
        self.leg_time += way
        self._rate = rate
        return dt - used
