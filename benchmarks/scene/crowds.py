"""The scene of `bench_schedules.py`: an arm at work, and balls that mill about it in a hall.

Everything is a closed form of the tick's number, so that contestants which cannot be run at the
same instant are still shown the same states. Balls start at such a distance from the arm that even
the crudest bounds leave the arm time to stop: what is timed is a monitor that lets the arm work.
"""

from __future__ import annotations

import itertools
import math
from typing import NamedTuple

import numpy as np

from armguard.bounds import IsotropicMotion
from armguard.lab.simulation import JointTrajectory
from armguard.obstacles import Obstacles
from armguard.robot import Kinematics
from armguard.robot.stop_time import compute_stop_time

RATE = 1000.0  # of ticks, [Hz]
LATENCY, REACTION_TIME = 0.002, 0.02  # the monitor's defaults, [s]
RADIUS, ACCEL, SPEED = 0.1, 10.0, 2.0  # of each ball: [m], [m/s²], [m/s]
OUTER, HEIGHT = 12.0, 2.5  # of the hall, whose middle is the arm's base, [m]
NEARBY, NEAR_DEPTH = 0.01, 0.5  # share of the balls in the innermost ring, and its depth [m]
SWAY, PACE = (0.1, 0.3), (0.5, 2.0)  # amplitudes [m] and frequencies [rad/s] of their wandering
CLEARANCE = 0.1  # [m]: errors, and the sway of a ball across the radius

# From the arm's ready pose to places left and right of it and back, as if it moved parts about.
WAYPOINTS = (
    (0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785),
    (0.7, -0.35, 0.1, -2.2, 0.1, 1.9, 0.9),
    (0.7, 0.1, 0.1, -2.0, 0.1, 2.1, 0.9),
    (0.0, -0.5, 0.0, -2.2, 0.0, 1.7, 0.785),
    (-0.7, -0.35, -0.1, -2.2, -0.1, 1.9, 0.6),
    (-0.7, 0.1, -0.1, -2.0, -0.1, 2.1, 0.6),
)


class UnavailableError(Exception):
    """A contestant cannot take part; the message says why."""


class Answer(NamedTuple):
    """What a contestant found in its last step."""

    time: float
    """Earliest contact, in [s] from now; NaN where only GO or not was asked."""
    evaluations: float
    """Of pairs, exactly; NaN where it keeps that to itself."""
    go: bool
    """Whether the arm may go on."""


class Work:
    """What the arm does: its joint states by tick, and the time that it takes to stop.

    Attributes:
        robot: The arm, a Panda.
        q: Joint positions, in [rad]. Shape (ticks, 7).
        v: Joint velocities, in [rad]/[s]. Shape (ticks, 7).
        stop_time: Of each tick, in [s]. Shape (ticks,).
        extent: How far from the base's axis any part of the arm gets, in [m].
        top_speed: The fastest isotropic bound of its links, in [m]/[s].
    """

    def __init__(self, robot, ticks: int, speed: float) -> None:
        trajectory = JointTrajectory(
            robot, WAYPOINTS, speed_fraction=speed, acceleration_fraction=0.5, loop=True
        )
        states = [trajectory.sample(tick / RATE) for tick in range(ticks)]
        self.robot = robot
        self.q = np.array([state[0] for state in states])
        self.v = np.array([state[1] for state in states])
        self.stop_time = np.array([_compute_stop_time(robot, v) for v in self.v])
        kinematics = Kinematics(robot)
        self.extent = 0.0
        for moment in np.arange(0.0, trajectory.duration, 0.05):
            kinematics.compute(*trajectory.sample(moment))
            reach = np.hypot(*kinematics.centers.T[:2]) + kinematics.spheres.radius
            self.extent = max(self.extent, float(reach.max()))
        self.top_speed = float(IsotropicMotion(robot).surface_speed.max())
        fastest = max(
            _compute_stop_time(robot, trajectory.sample(moment)[1])
            for moment in np.arange(0.0, trajectory.duration, 0.02)
        )
        self.longest_stop_time = fastest

    def find_clearance(self, interval: float) -> float:
        """Distance from the base's axis beyond which even distance over speed bounds says GO.

        Args:
            interval: Longest age of a ball's state, in [s].
        """
        closing = (self.top_speed + SPEED) * self.longest_stop_time + SPEED * interval
        return self.extent + closing + RADIUS + CLEARANCE


def _compute_stop_time(robot, v) -> float:
    return compute_stop_time(
        v,
        robot.velocity_error,
        robot.velocity_limit,
        robot.acceleration_limit,
        robot.brakes.make_curves(),
        0.0,
        1.0 / RATE + LATENCY,
        REACTION_TIME,
        robot.acceleration_limit,
    )[0]


class Crowd:
    """Balls that sway about places of their own, and whose turn it is to be measured.

    Attributes:
        count: How many balls.
        nearest: No centre comes nearer to the base's axis than this, in [m].
        group_count: Each ball is measured once in so many ticks.
        names: Of the balls, in their order.
    """

    def __init__(self, count: int, nearest: float, update_rate: float, seed: int = 0) -> None:
        if not (0.0 < nearest < OUTER - NEAR_DEPTH):
            raise SystemExit(f"no room for a crowd between {nearest:.2f} m and {OUTER} m")
        self.count, self.nearest = count, nearest
        self.group_count = min(max(1, round(RATE / update_rate)), max(count, 1))
        self.names = [f"ball-{number}" for number in range(count)]
        random = np.random.default_rng(seed)
        self._amplitude = random.uniform(*SWAY, (count, 3))
        self._frequency = random.uniform(*PACE, (count, 3))
        self._phase = random.uniform(0.0, 2.0 * math.pi, (count, 3))
        inner = nearest + np.hypot(*self._amplitude.T[:2])
        outer = np.full(count, OUTER)
        near = random.permutation(count)[: max(1, round(NEARBY * count))]
        outer[near] = inner[near] + NEAR_DEPTH
        # Even over the floor.
        distance = np.sqrt(random.uniform(inner**2, outer**2))
        bearing = random.uniform(-math.pi, math.pi, count)
        height = random.uniform(0.0, HEIGHT, count)
        self._home = np.column_stack(
            [distance * np.cos(bearing), distance * np.sin(bearing), height]
        )
        ends = np.linspace(0, count, self.group_count + 1).round().astype(int).tolist()
        self._groups = [slice(*pair) for pair in itertools.pairwise(ends)]
        self._group_names = [self.names[group] for group in self._groups]

    def sample(self, rows: slice, time: float):
        """Positions in [m] and velocities in [m]/[s] of some balls. Shapes (n, 3)."""
        angle = self._frequency[rows] * time + self._phase[rows]
        position = self._home[rows] + self._amplitude[rows] * np.sin(angle)
        velocity = self._amplitude[rows] * self._frequency[rows] * np.cos(angle)
        return position, velocity

    def measure(self, tick: int):
        """What a tick measures: the rows, their names, positions and velocities."""
        if tick == 0:
            rows, names = slice(0, self.count), self.names
        else:
            rows = self._groups[tick % self.group_count]
            names = self._group_names[tick % self.group_count]
        return rows, names, *self.sample(rows, tick / RATE)


def publish(obstacles: Obstacles, names, stamp: float, position, velocity) -> None:
    """Hand one measurement to armguard's table."""
    obstacles.update(
        names, stamp, position, velocity, radius=RADIUS, accel=ACCEL, speed=SPEED, source="crowd"
    )
