"""An arm at its work, whose trajectory's time stops while it brakes.

`armguard.simulation.SimulatedArm` goes on to the next waypoint after a stop. Here the arm returns
to where it left its path and goes on from there, so that the time a stop has cost is what its clock
along the path has fallen behind.
"""

from __future__ import annotations

import copy

import numpy as np

from armguard.simulation import JointTrajectory


class WorkingArm:
    """Follows a trajectory until it is to brake, and again once it may.

    Every joint brakes by itself at its guaranteed deceleration until it rests, and no brake is
    released before. Then the arm goes back, from rest to rest, to where it left the path, and on
    from there, as fast as its acceleration limits allow. What it plans to do next is what it does.

    Args:
        trajectory: What to follow, from its start at rest.

    Attributes:
        q: Joint positions, in [rad] or [m]. Shape (nv,).
        v: Their derivatives, in [rad]/[s] or [m]/[s]. Shape (nv,).
        progress: Time along the trajectory, in [s].
        braking: Whether the brakes are on, as they are at first.
    """

    def __init__(self, trajectory: JointTrajectory) -> None:
        robot = trajectory.robot
        self._trajectory = trajectory
        self._robot = robot
        along = trajectory.acceleration_fraction * np.minimum(
            robot.acceleration_limit, robot.braking_deceleration
        )
        speed = trajectory.speed_fraction * robot.velocity_limit
        # |q̈| = |q'' rate² + q' d(rate)/dt|, and the trajectory bounds |q''| and |q'|. Half of the
        # limit, so that a plan of a few samples keeps within it.
        self._slew = float(np.min((0.5 * robot.acceleration_limit - along) / speed))
        if not self._slew > 0.0:
            raise ValueError("the trajectory uses more than half of the acceleration limits")
        self.progress = 0.0
        self.braking = True
        self._rate = 0.0
        self._return: JointTrajectory | None = None
        self._returned = 0.0
        self.q, self.v = trajectory.sample(0.0)

    @property
    def rests(self) -> bool:
        """Whether no joint moves."""
        return not self.v.any()

    def step(self, dt: float, go: bool) -> None:
        """Advance by `dt` seconds, at work or braking."""
        if not go and not self.braking:
            self.braking, self._rate, self._return = True, 0.0, None
        if self.braking and go and self.rests:
            self._leave()
        if self.braking:
            self._brake(dt)
        else:
            self._follow(dt)

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
        deceleration = self._robot.braking_deceleration
        moving = np.minimum(dt, np.abs(self.v) / deceleration)
        pull = -np.sign(self.v) * deceleration
        self.q = self.q + moving * (self.v + 0.5 * pull * moving)
        self.v = np.where(moving < dt, 0.0, self.v + pull * moving)

    def _leave(self) -> None:
        """Set off, from rest, to where the path was left."""
        robot, path = self._robot, self._trajectory
        # Rounding may leave a joint an ulp beyond a waypoint that is at its limit.
        start = np.clip(self.q, robot.lower_position_limit, robot.upper_position_limit)
        self._return = JointTrajectory(
            robot,
            np.stack([start, path.sample(self.progress)[0]]),
            speed_fraction=path.speed_fraction,
            acceleration_fraction=path.acceleration_fraction,
        )
        self._returned = 0.0
        self.braking = False

    def _follow(self, dt: float) -> None:
        if self._return is not None:
            self._returned += dt
            if self._returned < self._return.duration:
                self.q, self.v = self._return.sample(self._returned)
                return
            dt = self._returned - self._return.duration
            self._return = None
        rate = min(1.0, self._rate + self._slew * dt)
        # The mean rate while it rises, and then the full one.
        rising = (rate - self._rate) / self._slew
        self.progress += 0.5 * (self._rate + rate) * rising + rate * (dt - rising)
        self._rate = rate
        self.q, slope = self._trajectory.sample(self.progress)
        self.v = rate * slope
