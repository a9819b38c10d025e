"""The cell of the campaign: an arm that sweeps to and fro, and two people who walk into its way.

Everything that moves is known in closed form, so that what is true at a time does not depend on
what was sent, heard or lost. The two motions keep step: each visit finds an arm that obeys nothing
at its full pace in the place where the people go.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from armguard.lab.simulation.trajectory import JointTrajectory
from armguard.robot.robot import Robot

Array = NDArray[np.float64]

ROBOT = "panda"

WAYPOINTS = (
    (-0.7, 0.5, 0.0, -1.6, 0.0, 2.1, 0.8),
    (0.7, 0.5, 0.0, -1.6, 0.0, 2.1, 0.8),
)
"""Between these the stretched arm turns about its base, in [rad]."""

SPEED_FRACTION = 0.3
"""Share of its velocity limits that the arm works at."""

PEOPLE = ("left", "right")
"""Their ids."""

RADIUS = 0.15
"""Of each person, an upright capsule, in [m]."""

HEIGHTS = (0.1, 0.9)
"""Of the ends of its axis above the arm's base, in [m]."""

DIRECTIONS = (math.radians(25.0), math.radians(-25.0))
"""In which the people stand, seen from the base, about z from x, in [rad]."""

NEAREST, FARTHEST = 0.35, 2.55
"""Between these distances from the base they go to and fro, in [m]: at up to 1.8 m/s and 2.7 m/s²,
within the bounds of the cell."""

PILLAR = (-1.0, -1.4)
"""Where a thing stands that is a static of the cell, and that drifts in one of the faults, in
[m]."""

DRIFT = 0.15
"""How fast it drifts then, towards the arm, in [m/s]."""

LATENCY = 0.05
"""What the cell states as latency of verdicts, in [s]. A desktop machine holds up any process for a
while; the arm counts as moving until such a late verdict must have come."""

JOINT_TIMEOUT = 0.3
"""Longest gap between joint states that the cell takes, in [s]."""

SOURCE_TIMEOUT = 0.3
"""Longest silence of its camera that the cell takes, in [s]."""

CELL = f"""\
[robot]
name = "{ROBOT}"
operating = "published" # the simulated controller keeps to these

[sources.camera]
timeout = {SOURCE_TIMEOUT}

[frames.shelf] # where nothing is measured; a fault is told in it
parent = "world"
xyz = [0.0, 0.9, 0.0]

[statics.pillar]
frame = "world"
points = [[{PILLAR[0]}, {PILLAR[1]}, {HEIGHTS[0]}], [{PILLAR[0]}, {PILLAR[1]}, {HEIGHTS[1]}]]
radius = {RADIUS}

[thresholds]
latency = {LATENCY}
joint_timeout = {JOINT_TIMEOUT}
"""


def make_trajectory(robot: Robot) -> JointTrajectory:
    """What the arm does while it is let: it sweeps to and fro."""
    return JointTrajectory(robot, WAYPOINTS, speed_fraction=SPEED_FRACTION, loop=True)


def visit_period(trajectory: JointTrajectory) -> float:
    """Between two visits of the people, in [s]: one sweep of the arm."""
    return 0.5 * trajectory.duration


def sample_people(time: float, period: float) -> tuple[Array, Array]:
    """Where the people are.

    Args:
        time: In [s] from the start of the campaign, at which they are farthest.
        period: Between two visits, in [s].

    Returns:
        Ends of their axes in [m], and velocities of these in [m]/[s]. Shapes (2, 2, 3).
    """
    angle = math.tau * time / period
    middle, swing = 0.5 * (FARTHEST + NEAREST), 0.5 * (FARTHEST - NEAREST)
    distance = middle + swing * math.cos(angle)
    speed = -swing * math.tau / period * math.sin(angle)
    position, velocity = np.zeros((2, 2, 3)), np.zeros((2, 2, 3))
    for person, direction in enumerate(DIRECTIONS):
        outward = np.array([math.cos(direction), math.sin(direction)])
        position[person, :, :2] = distance * outward
        velocity[person, :, :2] = speed * outward
        position[person, :, 2] = HEIGHTS
    return position, velocity


def sample_pillar(time: float) -> tuple[Array, Array]:
    """Where the thing is that drifts under the name of a static, `time` [s] after it began.

    Returns:
        Ends of its axis in [m], and velocities of these in [m]/[s]. Shapes (1, 2, 3).
    """
    home = np.array(PILLAR)
    inward = -home / np.linalg.norm(home)
    position, velocity = np.zeros((1, 2, 3)), np.zeros((1, 2, 3))
    position[0, :, :2] = home + DRIFT * max(time, 0.0) * inward
    position[0, :, 2] = HEIGHTS
    velocity[0, :, :2] = DRIFT * inward
    return position, velocity
