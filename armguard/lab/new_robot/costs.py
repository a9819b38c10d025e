"""What each choice costs in STOP: a person walks up to the working arm, with one thing changed.

All figures come from the monitor itself, with its own defaults: the arm is in the middle of its
ranges, every joint at a fifth of what its controller keeps to, and a person at walking speed comes
straight at the point of the arm that is farthest from the axis of its base.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import pinocchio

from armguard.jit.arrays import FloatArray
from armguard.monitor.monitor import Monitor
from armguard.obstacles.obstacles import Obstacles
from armguard.robot.brakes import BrakeEntry, Brakes
from armguard.robot.operating_limits import OperatingLimits
from armguard.robot.robot import Robot
from armguard.robot.ros_parameters import PlanningLimits
from armguard.verdict import Level

WALKING_SPEED = 1.6
"""Of a person, in [m/s], as ISO 13855 has it."""

PERSON_RADIUS = 0.1
"""Of the ball that a person is here, in [m]."""

WORKING_SHARE = 0.2
"""Of the operating velocities, at which every joint moves."""

FARTHEST = 20.0
"""A person farther away than this is far enough for no STOP, in [m]; if not, none is."""

RESOLUTION = 0.005
"""Of distances, in [m]."""


class StopFigures(NamedTuple):
    """What a monitor says of one description of an arm."""

    stop_time: float
    """Until the working arm rests, in [s]; inf where its brakes are not stated for what it does."""
    distance: float
    """From which on a person who comes nearer is a STOP, in [m]; inf: STOP at any distance."""


class Case(NamedTuple):
    """One description of the arm."""

    name: str
    robot: Robot
    operating: OperatingLimits | None


def list_cases(robot: Robot, planning: PlanningLimits | None = None) -> Iterator[Case]:
    """The arm as it is described, and with one choice at a time changed.

    Args:
        robot: As it is described, with published operating limits.
        planning: MoveIt's limits, whose default scaling factors make a case where they are not 1.
    """
    operating = OperatingLimits.published(robot)
    velocity, acceleration = operating.resolve(robot)
    yield Case("as written", robot, operating)
    if planning is not None and min(planning.velocity_scaling, planning.acceleration_scaling) < 1.0:
        scaled = OperatingLimits(
            planning.velocity_scaling * velocity, planning.acceleration_scaling * acceleration
        )
        yield Case("MoveIt's default scaling factors", robot, scaled)
    yield Case("operating velocities halved", robot, OperatingLimits(0.5 * velocity, acceleration))
    yield Case(
        "operating accelerations halved", robot, OperatingLimits(velocity, 0.5 * acceleration)
    )
    yield Case("without operating limits", robot, None)
    harder = copy.copy(robot)
    harder.brakes = _harden(robot)
    yield Case("brakes twice as hard", harder, operating)
    exact = copy.copy(robot)
    exact.position_error = 0.5 * robot.position_error
    exact.velocity_error = 0.5 * robot.velocity_error
    yield Case("measurement errors halved", exact, operating)


def measure(case: Case) -> StopFigures:
    """What the monitor says of one description."""
    q, v = choose_state(case.robot, case.operating)
    nobody = Monitor(case.robot, Obstacles(sources=[]), operating=case.operating, rise_delay=0.0)
    return StopFigures(nobody.step(0.0, q, v).stop_time, _find_distance(case, q, v))


def choose_state(robot: Robot, operating: OperatingLimits | None) -> tuple[FloatArray, FloatArray]:
    """Positions in the middle of the ranges, and velocities of work. Shape (nv,) each."""
    bounded = np.isfinite(robot.lower_position_limit) & np.isfinite(robot.upper_position_limit)
    middle = np.zeros(len(robot.joints))
    middle[bounded] = 0.5 * (robot.lower_position_limit + robot.upper_position_limit)[bounded]
    published = robot.published_operating_limits
    # Without operating limits the arm works at the same speed; its bounds alone are wider.
    top = robot.velocity_limit if published is None else published.velocity
    if operating is not None:
        top = np.minimum(top, operating.resolve(robot)[0])
    return middle, WORKING_SHARE * top


def choose_approach(robot: Robot, q: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Where the arm itself ends farthest from the base's axis, and the level way out. (3,) each.

    Of the arm, not of its spheres: a sphere may end where a larger one says that no link is.
    """
    data = robot.model.createData()
    pinocchio.forwardKinematics(robot.model, data, q)
    farthest, end, way = 0.0, np.zeros(3), np.array([1.0, 0.0, 0.0])
    for link in robot.links:
        placement = data.oMi[robot.joint_index(link)]
        corners = robot.triangles(link).reshape(-1, 3) @ placement.rotation.T
        corners += placement.translation
        away = np.hypot(corners[:, 0], corners[:, 1])
        most = int(away.argmax())
        if away[most] > farthest:
            farthest, end = float(away[most]), corners[most]
            way = np.array([end[0], end[1], 0.0]) / farthest
    return end, way


def _find_distance(case: Case, q: FloatArray, v: FloatArray) -> float:
    """The least distance without STOP, to `RESOLUTION`, not below; inf where there is none."""
    start, direction = choose_approach(case.robot, q)
    near, far = 0.0, FARTHEST
    if _stops(case, q, v, start + far * direction, direction):
        return math.inf
    while far - near > RESOLUTION:
        middle = 0.5 * (near + far)
        if _stops(case, q, v, start + middle * direction, direction):
            near = middle
        else:
            far = middle
    return far


def _stops(
    case: Case, q: FloatArray, v: FloatArray, front: FloatArray, direction: FloatArray
) -> bool:
    """Whether a person whose front is there, on the way to the arm, is a STOP."""
    obstacles = Obstacles(sources=["camera"])
    monitor = Monitor(case.robot, obstacles, operating=case.operating, rise_delay=0.0)
    position = (front + PERSON_RADIUS * direction)[None]
    velocity = (-WALKING_SPEED * direction)[None]
    obstacles.update(["person"], 0.0, position, velocity, PERSON_RADIUS, source="camera")
    return monitor.step(0.0, q, v).level is Level.STOP


def _harden(robot: Robot) -> Brakes:
    """Brakes that stop twice as hard, as far as acceleration limits allow."""

    def harden(entry: BrakeEntry, limit: float) -> BrakeEntry:
        return entry._replace(
            deceleration=min(2.0 * entry.deceleration, limit),
            stopping_time=max(0.5 * entry.stopping_time, entry.speed / limit),
            stopping_distance=max(0.5 * entry.stopping_distance, 0.5 * entry.speed**2 / limit),
        )

    return Brakes(
        robot.joints,
        {
            joint: [harden(entry, float(limit)) for entry in robot.brakes.entries[joint]]
            for joint, limit in zip(robot.joints, robot.acceleration_limit, strict=True)
        },
    )
