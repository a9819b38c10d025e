"""An arm at its work, whose trajectory's time stops while it brakes.

`armguard.lab.simulation.SimulatedArm` goes on to the next waypoint after a stop. Here the arm
returns to where it left its path and goes on from there, so that the work that a stop has cost is
what its clock along the path has fallen behind.
"""

from __future__ import annotations

import copy

import numpy as np

from armguard.lab.simulation import JointTrajectory
from armguard.robot import Robot

ACCELERATION_SHARE = 0.25
"""No joint speeds up by more than this share of its acceleration limit."""

BENDING_STEP = 1e-4
"""Of the differences that say how a path bends, in [s]."""


class Braking:
    """What an arm's brakes guarantee, joint by joint.

    Args:
        robot: The arm.
        payload: In [kg]; None: the heaviest.

    Attributes:
        payload: As given.
    """

    def __init__(self, robot: Robot, payload: float | None = None) -> None:
        self.payload = payload
        curves = robot.brakes.make_curves(payload)
        self._speeds, self._decelerations = curves.speed, curves.deceleration

    def deceleration(self, v: np.ndarray) -> np.ndarray:
        """Of joints that begin to brake at given velocities, in [rad]/[s]². Shapes (nv,)."""
        steps = (np.abs(v)[:, None] > self._speeds).sum(axis=1)
        if (steps == self._speeds.shape[1]).any():
            raise ValueError(f"nothing is stated of brakes at {v} with {self.payload} kg")
        found: np.ndarray = np.take_along_axis(self._decelerations, steps[:, None], axis=1)[:, 0]
        return found

    def lasting(self, v: np.ndarray) -> np.ndarray:
        """How long each joint takes to rest, in [s]; `v` as for `deceleration`. Shape (nv,)."""
        return np.abs(v) / self.deceleration(v)


class Leg:
    """A way from rest: a trajectory from one of its times on, its rate rising from 0 to 1.

    Args:
        trajectory: Followed from `start` on.
        start: Time along it, in [s].
        slew: How fast the rate rises, in [1]/[s]; inf where the trajectory rests at the start.

    Attributes:
        rise: How long that takes, in [s].
        duration: In [s]; inf where it does not end.
    """

    def __init__(self, trajectory: JointTrajectory, start: float, slew: float) -> None:
        self.trajectory, self.start = trajectory, start
        self.rise = 1.0 / slew
        self.duration = np.inf
        if not trajectory.loop:
            self.duration = trajectory.duration - start + 0.5 * self.rise

    def place(self, time: float) -> float:
        """Time along the trajectory at a time of the leg, both in [s]."""
        if time < self.rise:
            return self.start + 0.5 * time * time / self.rise
        return self.start + time - 0.5 * self.rise

    def sample(self, time: float) -> tuple[np.ndarray, np.ndarray]:
        """Positions, and their derivatives by the time of the leg. Shapes (nv,)."""
        q, slope = self.trajectory.sample(self.place(time))
        return q, min(1.0, time / self.rise if self.rise > 0.0 else 1.0) * slope

    def next_rest(self, time: float) -> float:
        """A time of the leg, not before the one given, at which it rests, in [s]."""
        way = self.trajectory
        if not way.loop:
            return self.duration
        laps, within = divmod(self.place(time), way.duration)
        stop = way.stops[np.searchsorted(way.stops, within)]
        return float(laps * way.duration + stop - self.start + 0.5 * self.rise)


class WorkingArm:
    """Follows a trajectory until it is to brake, and again once it may.

    Every joint brakes by itself at its guaranteed deceleration until it rests, and no brake is
    released before. Then the arm goes back, from rest to rest, to where it left the path, and on
    from there. At work, restarts included, no joint speeds up or slows down by more than
    `ACCELERATION_SHARE` of its acceleration limit, and none is faster than the trajectory's speed
    fraction of its velocity limit. What it plans to do next is what it does.

    Args:
        trajectory: What to follow, from its start at rest.
        brakes: What they guarantee, as `Braking`; None: at the heaviest payload.

    Attributes:
        q: Joint positions, in [rad] or [m]. Shape (nv,).
        v: Their derivatives, in [rad]/[s] or [m]/[s]. Shape (nv,).
        deviation: How far positions and velocities really are from q and v; 0 unless a simulation
            says otherwise. Shape (2, nv).
        progress: Time along the trajectory, in [s].
        braking: Whether the brakes are on, as they are at first.
        brakes: Of joints that brake from given speeds, what they guarantee, in [rad]/[s]².
        leg: What it follows, or will once it rests and may: the trajectory, or the way back to it.
        leg_time: How far it has come on that, in [s].
        legs: How many legs it has taken up.

    Raises:
        ValueError: The trajectory needs all the acceleration that there is for speeding up.
    """

    def __init__(self, trajectory: JointTrajectory, brakes: Braking | None = None) -> None:
        robot = trajectory.robot
        self._trajectory = trajectory
        self.brakes = Braking(robot) if brakes is None else brakes
        self._deceleration = robot.braking_deceleration
        along = trajectory.acceleration_fraction * np.minimum(
            robot.acceleration_limit, robot.braking_deceleration
        )
        self._top_speed = trajectory.speed_fraction * robot.velocity_limit
        # With a leg's rate r and the pace p of the arm's clock along it, and a dash for the
        # derivative by the trajectory's own time, |q̈| = |q'' (r p)² + q' (dr/dt p² + r dp/dt)|.
        spare = ACCELERATION_SHARE * robot.acceleration_limit - along
        self._slew = float(np.min(spare / self._top_speed))
        if not self._slew > 0.0:
            raise ValueError(
                f"the trajectory uses {ACCELERATION_SHARE:.0%} of the acceleration limits or more"
            )
        self.progress = 0.0
        self.braking = True
        self.legs = 0
        self._pace = 1.0
        self.q, self.v = trajectory.sample(0.0)
        self.deviation = np.zeros((2, len(self.q)))
        self._take_up(Leg(trajectory, 0.0, self._slew))

    @property
    def measured(self) -> tuple[np.ndarray, np.ndarray]:
        """Where the arm really is, and its velocities. Shapes (nv,)."""
        return self.q + self.deviation[0], self.v + self.deviation[1]

    @property
    def rests(self) -> bool:
        """Whether no joint moves."""
        return not self.v.any()

    def step(
        self,
        dt: float,
        go: bool,
        speed_limit: np.ndarray | float = np.inf,
    ) -> None:
        """Advance by `dt` seconds, at work or braking.

        Args:
            dt: In [s].
            go: Whether it may go on; else it brakes.
            speed_limit: Of each joint at work, in [rad]/[s]: the arm's clock comes down to it as
                fast as accelerations allow. Shape (nv,).
        """
        if not go and not self.braking:
            self.braking = True
            self._deceleration = self.brakes.deceleration(self.v)
        if self.braking and go and self.rests:
            self.braking = False
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
        was_at_rest = self.rests
        moving = np.minimum(dt, np.abs(self.v) / self._deceleration)
        pull = -np.sign(self.v) * self._deceleration
        self.q = self.q + moving * (self.v + 0.5 * pull * moving)
        self.v = np.where(moving < dt, 0.0, self.v + pull * moving)
        if self.rests and not was_at_rest:
            self._turn_back()

    def _slowing(self) -> float:
        """How fast the pace can fall by what the brakes guarantee, in [1]/[s]; 0 or less: not."""
        (_, slope), (_, ahead) = (
            self.leg.sample(self.leg_time + later) for later in (0.0, BENDING_STEP)
        )
        spare = self._deceleration - np.abs(ahead - slope) / BENDING_STEP
        return float(np.min(spare / np.maximum(np.abs(slope), 1e-9)))

    def _turn_back(self) -> None:
        """Take up the way, from rest to rest, to where the path was left."""
        path = self._trajectory
        robot = path.robot
        # Rounding may leave a joint an ulp beyond a waypoint that is at its limit.
        start = np.clip(self.q, robot.lower_position_limit, robot.upper_position_limit)
        back = JointTrajectory(
            robot,
            np.stack([start, path.sample(self.progress)[0]]),
            speed_fraction=path.speed_fraction,
            acceleration_fraction=path.acceleration_fraction,
        )
        self._take_up(Leg(back, 0.0, np.inf))

    def _take_up(self, leg: Leg) -> None:
        self.leg, self.leg_time, self._pace = leg, 0.0, 1.0
        self.legs += 1

    def _follow(self, dt: float, speed_limit: np.ndarray | float) -> None:
        wanted = 1.0
        if np.min(speed_limit) < np.max(self._top_speed):
            # The faster of here and where this step leads, as far as that is known.
            slopes = [self.leg.sample(self.leg_time + ahead)[1] for ahead in (0.0, dt)]
            fastest = np.maximum(np.abs(slopes).max(axis=0), 1e-9)
            wanted = min(wanted, float(np.min(speed_limit / fastest)))
        # While the rate rises, no more than what that leaves; to slow down is the other way.
        rising = self._slew * (1.0 - self._pace**2 if self.leg_time < self.leg.rise else 1.0)
        if wanted < self._pace:
            self._deceleration = self.brakes.deceleration(self.v)
            rate = max(self._slowing(), self._slew)
            self._advance(dt, max(wanted, self._pace - rate * dt), rate)
        else:
            self._advance(dt, min(wanted, self._pace + rising * dt), max(rising, 1e-9))

    def _advance(self, dt: float, pace: float, rate: float) -> None:
        """Go along the leg for a time, first coming to a pace of its clock at a rate [1/s]."""
        turning = min(dt, abs(pace - self._pace) / rate)
        way = 0.5 * (self._pace + pace) * turning + pace * (dt - turning)
        self._pace = pace
        # At its end a leg rests, and so does the arm for what is left of the step.
        self.leg_time = min(self.leg_time + way, self.leg.duration)
        self.q, slope = self.leg.sample(self.leg_time)
        self.v = pace * slope
        if self.leg_time >= self.leg.duration:
            self.v = np.zeros_like(slope)
            self._take_up(Leg(self._trajectory, self.progress, self._slew))
        elif self.leg.trajectory is self._trajectory:
            self.progress = self.leg.place(self.leg_time)
