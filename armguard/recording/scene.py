"""The cell as viewers of recordings draw it: Foxglove's `SceneUpdate`, ten times a second.

The arm is drawn as the spheres of its cover, obstacles as they were reported, whether or not the
table believed them, both in the colour of the last verdict's level. The writer process makes it
from the events that it writes; the loop takes no part.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import msgspec
import numpy as np
import pinocchio
from numpy.typing import NDArray

from armguard.messages.batch import read_batch
from armguard.messages.events import StaticObstacle
from armguard.messages.incoming import ObstaclesMessage, RemoveMessage
from armguard.recording.events import JointState, Time
from armguard.recording.inputs import restore_state
from armguard.robot.portable import RestoredRobot, read_numbers

INTERVAL = 0.1
"""Between two pictures, in [s]."""

MOST_DRAWN = 500
"""Obstacles that are drawn at most: those that were reported last."""


class Vector(msgspec.Struct, frozen=True):
    """A point or a size, in [m]."""

    x: float
    y: float
    z: float


class Quaternion(msgspec.Struct, frozen=True):
    """An orientation."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    w: float = 1.0


class Pose(msgspec.Struct, frozen=True):
    """Where something is."""

    position: Vector
    orientation: Quaternion = Quaternion()


class Color(msgspec.Struct, frozen=True):
    """Each from 0 to 1."""

    r: float
    g: float
    b: float
    a: float


class Sphere(msgspec.Struct, frozen=True):
    """A ball; its size is its diameter along each axis."""

    pose: Pose
    size: Vector
    color: Color


class Line(msgspec.Struct, frozen=True):
    """Points that are joined one after another."""

    type: int
    pose: Pose
    thickness: float
    scale_invariant: bool
    points: list[Vector]
    color: Color
    colors: list[Color] = []
    indices: list[int] = []


class Text(msgspec.Struct, frozen=True):
    """A label."""

    pose: Pose
    billboard: bool
    font_size: float
    scale_invariant: bool
    color: Color
    text: str


class Nothing(msgspec.Struct, frozen=True):
    """Primitives of kinds that are not drawn here."""


class Entity(msgspec.Struct, frozen=True):
    """What is drawn under one name; it takes the place of what was drawn under that before."""

    timestamp: Time
    frame_id: str
    id: str
    lifetime: Time
    frame_locked: bool
    spheres: list[Sphere] = []
    lines: list[Line] = []
    texts: list[Text] = []
    metadata: list[Nothing] = []
    arrows: list[Nothing] = []
    cubes: list[Nothing] = []
    cylinders: list[Nothing] = []
    triangles: list[Nothing] = []
    models: list[Nothing] = []


class SceneUpdate(msgspec.Struct, frozen=True):
    """The arm and the obstacles."""

    deletions: list[Nothing]
    entities: list[Entity]


SCENE_SCHEMA = "foxglove.SceneUpdate"

_ARM_COLORS = {
    "STOP": Color(0.9, 0.15, 0.15, 0.6),
    "SLOW": Color(0.95, 0.75, 0.1, 0.6),
    "AWARE": Color(0.1, 0.7, 0.8, 0.6),
    "CLEAR": Color(0.2, 0.7, 0.3, 0.6),
}
_UNKNOWN = Color(0.5, 0.5, 0.5, 0.6)
_OBSTACLE = Color(0.35, 0.4, 0.85, 0.7)
_STATIC = Color(0.5, 0.5, 0.5, 0.7)


class Scene:
    """Content of the cell, from the events so far.

    Args:
        robot: The arm, as `armguard.robot.portable.describe_robot` describes it.
        settings: As `armguard.monitor.portable.describe_settings` describes them.
    """

    def __init__(self, robot: Mapping[str, Any], settings: Mapping[str, Any]) -> None:
        self._robot = RestoredRobot(robot)
        base = settings["monitor"]["base_placement"]
        self._base = pinocchio.SE3(
            read_numbers(base["rotation"]), read_numbers(base["translation"])
        )
        self._frames = {
            name: (read_numbers(frame["rotation"]), read_numbers(frame["translation"]))
            for name, frame in settings["obstacles"]["frames"].items()
        }
        self._data = self._robot.model.createData()
        self._q: NDArray[np.float64] | None = None
        self._level = ""
        # By source and id; dictionaries remember what came last.
        self._obstacles: dict[tuple[str, str], tuple[NDArray[np.float64], float]] = {}

    def take_level(self, level: str) -> None:
        """Take the level of a verdict, by its name."""
        self._level = level

    def take_state(self, message: JointState) -> None:
        """Take a joint state, unless there is none to be drawn."""
        _, q, _, _ = restore_state(message)
        if len(q) == len(self._robot.joints) and np.isfinite(q).all():
            self._q = q

    def take_update(self, message: ObstaclesMessage) -> None:
        """Take a message about obstacles."""
        batch = read_batch(message)
        points = batch.position.reshape(len(batch.ids), -1, 3) if batch.ids else batch.position
        if batch.frame in self._frames:
            rotation, translation = self._frames[batch.frame]
            with np.errstate(all="ignore"):  # what is not finite is not drawn
                points = points @ rotation.T + translation
        radius = np.broadcast_to(np.array(batch.radius, float), len(batch.ids))
        if batch.snapshot:
            seen = set(batch.ids)
            for key in [key for key in self._obstacles if key[0] == batch.source]:
                if key[1] not in seen:
                    del self._obstacles[key]
        for name, place, size in zip(batch.ids, points, radius.tolist(), strict=True):
            self._put((batch.source, name), place, size)

    def take_static(self, place: StaticObstacle) -> None:
        """Take a static obstacle."""
        self._put(("", place.id), np.frombuffer(place.position).reshape(-1, 3), place.radius)

    def take_removal(self, message: RemoveMessage) -> None:
        """Take removed obstacles; without a source, those of all sources."""
        gone = set(message.ids)
        for key in [key for key in self._obstacles if key[1] in gone]:
            if message.source in ("", key[0]):
                del self._obstacles[key]

    def draw(self, nanoseconds: int) -> SceneUpdate:
        """The cell as it is now.

        Args:
            nanoseconds: Since 1970.
        """
        timestamp = Time(*divmod(nanoseconds, 1_000_000_000))

        def make(name: str, **parts: Any) -> Entity:
            return Entity(timestamp, "world", name, Time(0, 0), frame_locked=False, **parts)

        entities = [make("obstacles", **self._draw_obstacles())]
        if self._q is not None:
            entities.append(make("arm", spheres=self._draw_arm(self._q)))
        return SceneUpdate([], entities)

    def _put(self, key: tuple[str, str], points: NDArray[np.float64], radius: float) -> None:
        self._obstacles.pop(key, None)
        if np.isfinite(points).all() and math.isfinite(radius):
            self._obstacles[key] = points, radius
        if len(self._obstacles) > MOST_DRAWN:
            del self._obstacles[next(iter(self._obstacles))]

    def _draw_arm(self, q: NDArray[np.float64]) -> list[Sphere]:
        robot, color = self._robot, _ARM_COLORS.get(self._level, _UNKNOWN)
        pinocchio.forwardKinematics(robot.model, self._data, q)
        spheres = []
        for link in robot.links:
            tree = robot.cover.tree(link)
            pose = self._base * self._data.oMi[robot.joint_index(link)]
            leaves = tree.spheres[tree.child_count == 0]
            centers = leaves[:, :3] @ pose.rotation.T + pose.translation
            for center, radius in zip(centers.tolist(), leaves[:, 3].tolist(), strict=True):
                spheres.append(_make_sphere(center, radius, color))
        return spheres

    def _draw_obstacles(self) -> dict[str, Any]:
        spheres, lines, texts = [], [], []
        for (source, name), (points, radius) in self._obstacles.items():
            color = _OBSTACLE if source else _STATIC
            places = points.tolist()
            spheres += [_make_sphere(place, radius, color) for place in places]
            if len(places) > 1:
                pairs = [
                    Vector(*end)
                    for k, one in enumerate(places)
                    for other in places[:k]
                    for end in (one, other)
                ]
                lines.append(Line(2, Pose(Vector(0.0, 0.0, 0.0)), 2.0, True, pairs, color))
            x, y, z = places[0]
            above = Vector(x, y, z + radius)
            texts.append(Text(Pose(above), True, 12.0, True, color, name))
        return {"spheres": spheres, "lines": lines, "texts": texts}


def _make_sphere(center: list[float], radius: float, color: Color) -> Sphere:
    size = 2.0 * radius
    return Sphere(Pose(Vector(*center)), Vector(size, size, size), color)
