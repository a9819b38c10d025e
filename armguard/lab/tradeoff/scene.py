"""The scene of a trade-off: one arm's path and obstacle messages, the same for all settings.

Messages are recorded once, so settings that run one after the other get the same messages at the
same times. The arm ignores verdicts, so all settings judge the same states.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pinocchio
from numpy.typing import ArrayLike, NDArray

from armguard.lab.simulation import (
    JointTrajectory,
    ObstacleSource,
    ProceduralPerson,
    WanderingBalls,
)
from armguard.lab.simulation.person import DURATIONS
from armguard.lab.simulation.recordings import place_recording
from armguard.lab.simulation.trajectory import plan_work
from armguard.messages.batch import ObstacleBatch
from armguard.obstacles.obstacles import Obstacles
from armguard.robot.operating_limits import OperatingLimits
from armguard.robot.robot import Robot

Array = NDArray[np.float64]

SPEED_FRACTION = 0.2
"""Share of its velocity limits that the arm works at, at most."""

ACCELERATION_FRACTION = 0.225
"""Share of the accelerations that its joints and brakes can, at most."""

WITHIN = 0.9
"""Share of its operating limits, at most, of those stated and of those published: settings that
count with the ones or the others judge the same arm."""

LOWEST, NEAREST = 0.02, -0.13
"""The arm works above its table, and not far on the side that people come from (-y), in [m]."""

TARGET = (0.0, -0.25, 0.35)
"""Where a simulated person reaches, in the frame of the arm's base, in [m]: near enough to where
the arm works that all levels occur, of an arm that keeps to its published operating limits too."""

CYCLE = 30.0
"""Until the arm's motion repeats, at most, in [s]."""

CLEARANCE = 1.0
"""Distance that balls keep from the arm's axis, in [m]."""


class Site(NamedTuple):
    """Where a study is made, by what arm, and what it starts from."""

    robot: Robot
    make_obstacles: Callable[[], Obstacles]
    """An empty table, with what never moves."""
    settings: Mapping[str, Any]
    """Of the monitor, beside those that are varied."""
    sources: tuple[str, ...] = ()
    """Names of those that have to be heard; the first one tells all. None: as they are called."""
    keeps_cover: bool = False
    """Whether all levels of the arm's cover stand where settings are chosen."""

    @property
    def base(self) -> pinocchio.SE3:
        """Of the arm's base in the world: what moves about it is placed alike."""
        return self.settings.get("base_placement") or pinocchio.SE3.Identity()


class Scene:
    """One arm's path and the obstacle messages during it.

    Args:
        site: Where, and by what arm.
        sources: What moves about it; times of the scene are theirs less `begin`.
        seconds: How long.
        seed: Of the arm's way.
        begin: What passes before, in [s].

    Attributes:
        messages: In the order of their stamps, with points and velocities in the world, of shape
            (n, k, 3), and radii of shape (n,).
        seconds: As given.
        trajectory: Of the arm.
    """

    def __init__(
        self,
        site: Site,
        sources: Sequence[ObstacleSource],
        seconds: float,
        seed: int,
        begin: float = 0.0,
    ) -> None:
        self.seconds = seconds
        self.trajectory = _plan_work(site, seed, min(seconds, CYCLE))
        self.messages: list[ObstacleBatch] = []
        for source in sources:
            told_by = site.sources[0] if site.sources else source.name
            source.publish(Notebook(self.messages, begin, site.base, told_by), begin + seconds)
        for name in site.sources[1:]:
            notebook = Notebook(self.messages, 0.0, site.base, name)
            for tick in range(math.ceil(seconds / 0.05)):
                notebook.update([], 0.05 * tick, [])
        self.messages.sort(key=lambda message: message.stamp)

    def sample(self, time: float) -> tuple[Array, Array]:
        """Joint positions and velocities at a time in [s]. Shapes (nv,)."""
        return self.trajectory.sample(time)


def make_scene(
    site: Site, person: str | None, balls: int, seconds: float, seed: int, part: float = 0.5
) -> tuple[Scene, str]:
    """A part of a person's visit, or a crowd of balls; and what that is called.

    Args:
        site: Where, and by what arm.
        person: A Vicon CSV recording; None: a simulated one, unless there are balls.
        balls: How many wander about the arm.
        seconds: How long; of a recording, no longer than it is.
        seed: Of all motions.
        part: Of the visit: 0 is its beginning, 0.5 its middle.

    Raises:
        ArmguardError: The recording cannot be read, or the arm cannot work here.
    """
    sources: list[ObstacleSource] = []
    told = []
    begin = 0.0
    if person is not None:
        recording = place_recording(person)
        sources.append(recording)
        seconds = min(seconds, recording.duration)
        begin = part * (recording.duration - seconds)
        told.append(f"the recorded person {recording.name}")
    elif not balls:
        shortest, longest = DURATIONS
        visit = min(max(seconds, shortest), longest)
        begin = part * max(visit - seconds, 0.0)
        sources.append(ProceduralPerson(seed, visit, target=TARGET))
        told.append("a simulated person")
    if balls:
        sources.append(WanderingBalls(balls, seed, clearance=CLEARANCE))
        told.append(f"{balls:,} balls from {CLEARANCE:g} m on")
    return Scene(site, sources, seconds, seed, begin), " and ".join(told)


class Notebook:
    """Records the messages of a source, as an `ObstacleSink`.

    Args:
        messages: Are added to.
        begin: Of the scene: what is said before is left out, and stamps are counted from it, in
            [s].
        base: Of the arm's base in the world; places are said in its frame.
        source: Under which name it is told.
    """

    def __init__(
        self, messages: list[ObstacleBatch], begin: float, base: pinocchio.SE3, source: str
    ) -> None:
        self._messages, self._begin, self._base = messages, begin, base
        self._source = source

    def update(
        self,
        ids: Sequence[str],
        stamp: float,
        position: ArrayLike,
        velocity: ArrayLike | None = None,
        **fields: ArrayLike | None,
    ) -> None:
        """Record one call, whose fields are those of `armguard.Obstacles.update`."""
        if stamp < self._begin - 1e-9:
            return
        shape, base = (len(ids), -1 if ids else 1, 3), self._base
        points = np.reshape(np.asarray(position, dtype=np.float64), shape)
        paces = np.zeros(points.shape) if velocity is None else np.reshape(velocity, shape)

        def read(field: str) -> Array:
            values = np.asarray(fields.get(field, 0.0), dtype=np.float64)
            return np.broadcast_to(values, len(ids)).copy()

        self._messages.append(
            ObstacleBatch(
                list(ids),
                stamp - self._begin,
                points @ base.rotation.T + base.translation,
                paces @ base.rotation.T,
                read("radius"),
                None if fields.get("accel") is None else read("accel"),
                None if fields.get("speed") is None else read("speed"),
                read("position_error"),
                read("velocity_error"),
                self._source,
                "world",
                False,
            )
        )


def find_published(robot: Robot) -> OperatingLimits | None:
    """The operating limits that are published of an arm; None where none are."""
    if robot.published_operating_limits is None:
        return None
    return OperatingLimits.published(robot)


def _plan_work(site: Site, seed: int, duration: float) -> JointTrajectory:
    """A path above the table, away from the side that people come from, if the arm has one."""
    robot = site.robot
    speed, acceleration = SPEED_FRACTION, ACCELERATION_FRACTION
    gentlest = robot.brakes.gentlest_stop(np.zeros(len(robot.joints)))
    able = np.minimum(robot.acceleration_limit, gentlest)
    kept = [site.settings.get("operating"), find_published(robot)]
    for operating in kept:
        if operating is None:
            continue
        velocities, accelerations = operating.resolve(robot)
        speed = min(speed, WITHIN * float((velocities / robot.velocity_limit).min()))
        acceleration = min(acceleration, WITHIN * float((accelerations / able).min()))
    anywhere = (math.inf,) * 3
    boxes = [((-math.inf, side, LOWEST), anywhere) for side in (NEAREST, -math.inf)]
    return plan_work(
        robot, seed, duration, boxes, speed_fraction=speed, acceleration_fraction=acceleration
    )
