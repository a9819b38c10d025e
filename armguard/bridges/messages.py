"""Reads messages of ROS 2: joint states, and bodies that perception has published.

Recordings (`armguard.recording`) and the running bridge (`armguard.bridges.ros2`) share this
module: a message is any object with the fields of its type. These messages have no errors of
velocities, so their velocities are not used: any velocity within the bounds is assumed. Bodies of
message types without sizes are balls of one radius. A shape that is not a hull of eight points is
replaced by one that contains it, or refused.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
import pinocchio
from numpy.typing import NDArray

from armguard.exceptions import ArmguardError
from armguard.messages.batch import ObstacleBatch
from armguard.obstacles.obstacles import WORLD, Obstacles

Array = NDArray[np.float64]

JOINTS = "sensor_msgs/msg/JointState"
POSES = "geometry_msgs/msg/PoseArray"
PEOPLE = "people_msgs/msg/People"
MARKERS = "visualization_msgs/msg/MarkerArray"
DETECTIONS = "vision_msgs/msg/Detection3DArray"

OBSTACLES = (POSES, PEOPLE, MARKERS, DETECTIONS)
"""Messages that show obstacles."""

WITHOUT_SIZES = (POSES, PEOPLE)
"""Those of them that say where something is, and not how large."""

_ENTRIES = {POSES: ("poses", ""), PEOPLE: ("people", "name"), DETECTIONS: ("detections", "id")}
"""The fields that list what is seen, and that name each of it."""

_CUBE, _SPHERE, _CYLINDER, _LINE_STRIP, _LINE_LIST, _CUBE_LIST, _SPHERE_LIST, _POINTS = range(1, 9)
_DELETE, _DELETE_ALL = 2, 3
_WITHOUT_BODY = {0: "arrows", 9: "texts"}
"""Markers that explain others."""

MOST_BODIES = 20_000
"""Bodies of markers that are remembered, at most, until they are deleted."""

_HISTORY = 256
"""Joint states that are kept for differences, at most."""


class Body(NamedTuple):
    """An obstacle as a message describes it, in its frame."""

    id: str
    points: Array
    """[m]. Shape (k, 3)."""
    radius: float
    """[m]."""


class Shown(NamedTuple):
    """What a message shows in one frame."""

    header: Any
    bodies: list[Body]


class ObstacleReader:
    """Reads the messages of one topic as bodies.

    Args:
        topic: Its name, for errors.
        kind: Type of its messages, one of `OBSTACLES`.
        radius: Of what comes without sizes, in [m].
        snapshot: Whether each message shows all that its source sees.

    Attributes:
        passed_over: Markers that have no body, by kind.

    Raises:
        ArmguardError: The type is no input, or its messages say nothing of sizes and there is no
            radius.
    """

    def __init__(
        self, topic: str, kind: str, radius: float | None = None, *, snapshot: bool = False
    ) -> None:
        self._offender = f"topic {topic!r}"
        if kind not in OBSTACLES:
            raise ArmguardError(
                self._offender, f"is of type {kind!r}", expected=f"one of {', '.join(OBSTACLES)}"
            )
        if radius is not None and not 0.0 <= radius < math.inf:
            raise ArmguardError("radius", f"is {radius}", expected="a number of metres, at least 0")
        if kind in WITHOUT_SIZES and radius is None:
            raise ArmguardError(
                self._offender, "has poses without sizes", remedy="give --radius in metres"
            )
        self.passed_over: dict[str, int] = {}
        self._kind, self._snapshot = kind, snapshot
        self._radius = 0.0 if radius is None else radius
        self._known: dict[tuple[str, int], set[str]] = {}

    def read(self, message: Any) -> tuple[list[str], list[Shown]]:
        """What has gone, by its ids, and after that what is there.

        Raises:
            ArmguardError: A marker's extent is not known, or it is there twice, a snapshot has
                several frames, or there are more than `MOST_BODIES` that were not deleted.
        """
        if self._kind == MARKERS:
            return self._read_markers(message)
        entries, label = _ENTRIES[self._kind]
        bodies = []
        for number, one in enumerate(getattr(message, entries)):
            name = getattr(one, label, "") or f"{number}"
            if self._kind == DETECTIONS:
                bodies.append(_make_box(name, one.bbox.center, one.bbox.size))
            else:
                bodies.append(Body(name, _read_vector(one.position)[None], self._radius))
        return [], [Shown(message.header, bodies)]

    def _read_markers(self, message: Any) -> tuple[list[str], list[Shown]]:
        """Markers come and go by themselves, each with a header of its own.

        What is refused leaves all that is known as it was.
        """
        known = dict(self._known)
        there: dict[tuple[str, int], Shown] = {}
        gone: set[str] = set()
        passed_over: list[str] = []
        for marker in message.markers:
            key = str(marker.ns), int(marker.id)
            if marker.action == _DELETE_ALL:
                gone.update(*known.values())
                known.clear()
                there.clear()
                continue
            if marker.action == _DELETE:
                gone |= known.pop(key, set())
                there.pop(key, None)
                continue
            kind = int(marker.type)
            if kind in _WITHOUT_BODY:
                passed_over.append(_WITHOUT_BODY[kind])
                continue
            name = f"{key[0]}/{key[1]}" if key[0] else f"{key[1]}"
            if key in there:
                raise ArmguardError(
                    self._offender,
                    f"has the marker {name!r} twice in one message",
                    expected="an id of its own for each of a namespace",
                )
            bodies = self._make_bodies(name, kind, marker)
            # A marker takes the place of the one before, which may have had other bodies.
            made = {body.id for body in bodies}
            gone |= known.get(key, set()) - made
            known[key] = made
            there[key] = Shown(marker.header, bodies)
        if self._snapshot:
            # What is not in it is gone without a word.
            known = {key: known[key] for key in there}
        count = sum(map(len, known.values()))
        if count > MOST_BODIES:
            raise ArmguardError(
                self._offender,
                f"has shown {count} bodies that were not deleted",
                expected=f"at most {MOST_BODIES}",
                remedy="delete markers that have gone, or use their ids again",
            )
        shown = self._group_markers(list(there.values()))
        self._known = known
        for words in passed_over:
            self.passed_over[words] = self.passed_over.get(words, 0) + 1
        return sorted(gone), shown

    def _group_markers(self, markers: list[Shown]) -> list[Shown]:
        """Those of one frame and stamp together, by stamp.

        A snapshot is one sight, whose markers all count as seen at the oldest of their stamps: a
        body that is taken for older than it is may be farther away, so that errs to the safe side.
        """
        markers = sorted(markers, key=lambda one: read_nanoseconds(one.header))
        groups: dict[tuple[str, int], Shown] = {}
        for header, bodies in markers:
            stamp = 0 if self._snapshot else read_nanoseconds(header)
            key = read_frame(header), stamp
            groups.setdefault(key, Shown(header, [])).bodies.extend(bodies)
        if self._snapshot and len(groups) > 1:
            raise ArmguardError(
                self._offender, "has several frames in one message", expected="one with snapshots"
            )
        return list(groups.values())

    def _make_bodies(self, name: str, kind: int, marker: Any) -> list[Body]:
        """The bodies of one marker; of several, each has the marker's name and a number.

        What follows the last slash of a marker's name is a number, so `#` is in no name there, and
        no part can be taken for another marker.
        """
        scale = _read_vector(marker.scale)
        rotation, origin = read_pose(marker.pose.position, marker.pose.orientation)
        if kind in (_CUBE, _CYLINDER, _SPHERE):
            names, places = [name], origin[None]
        else:
            points = np.array([_read_vector(point) for point in marker.points]).reshape(-1, 3)
            places = points @ rotation.T + origin
            names = [f"{name}#{k}" for k in range(len(places))]
        if kind in (_LINE_STRIP, _LINE_LIST):
            step = 1 if kind == _LINE_STRIP else 2
            pairs = [places[k : k + 2] for k in range(0, len(places) - 1, step)]
            return [Body(*one, 0.5 * scale[0]) for one in zip(names, pairs, strict=False)]
        if kind in (_CUBE, _CYLINDER, _CUBE_LIST):
            # A cylinder lies in the box around it.
            shape, radius = _corners(scale) @ rotation.T, 0.0
        elif kind in (_SPHERE, _SPHERE_LIST):
            shape, radius = np.zeros((1, 3)), 0.5 * float(scale.max())
        elif kind == _POINTS:
            # A point is drawn as a square, which the ball around it contains.
            shape, radius = np.zeros((1, 3)), 0.5 * float(np.hypot(*scale[:2]))
        else:
            raise ArmguardError(
                self._offender,
                f"has the marker {name!r} of type {kind}, whose extent is not known",
                expected="cubes, spheres, cylinders, lines, or lists of these",
            )
        return [Body(*one, radius) for one in zip(names, places[:, None] + shape, strict=True)]


def split_source(name: str) -> tuple[str, str]:
    """Source and topic of "source=/topic", or of "/topic", whose source has the topic's name."""
    source, equals, topic = name.rpartition("=")
    return source if equals else topic.strip("/"), topic


def read_frame(header: Any) -> str:
    """The frame that a header names; the world where it names none."""
    return str(header.frame_id).strip("/") or WORLD


def make_batches(shown: Shown, source: str, stamp: float, *, snapshot: bool) -> list[ObstacleBatch]:
    """Bodies in batches of as many points each; one batch, if only an empty one, where it is whole.

    Args:
        shown: In one frame.
        source: Who saw them.
        stamp: When, in [s].
        snapshot: Whether they are all that there is: then they go in one batch, and the last point
            of those with fewer is repeated, which changes no hull.
    """
    bodies, frame = shown.bodies, read_frame(shown.header)
    counts = sorted({len(body.points) for body in bodies}) or [1]
    if snapshot and len(counts) > 1:
        most = counts[-1]
        places = np.arange(most)
        bodies = [
            body._replace(points=body.points[np.minimum(places, len(body.points) - 1)])
            for body in bodies
        ]
        counts = [most]
    batches = []
    for count in counts:
        chosen = [body for body in bodies if len(body.points) == count]
        position = np.array([body.points for body in chosen]).reshape(-1, count, 3)
        radius = np.array([body.radius for body in chosen], dtype=np.float64)
        ids = [body.id for body in chosen]
        told = position, None, radius, None, None, 0.0, 0.0
        batches.append(ObstacleBatch(ids, stamp, *told, source, frame, snapshot))
    return batches


def remove_known(obstacles: Obstacles, gone: list[str], source: str) -> None:
    """Remove from a table what a source showed before and has deleted."""
    known = [id for id in gone if obstacles.row(id, source) >= 0]
    if known:
        obstacles.remove(known, source=source)


class WatchedJoints(Protocol):
    """What a reader has to know of joints; a `Robot` has it. Shape (nv,) each."""

    @property
    def joints(self) -> Sequence[str]:
        """Names, in the order of the rest."""
        ...

    @property
    def acceleration_limit(self) -> Array:
        """In [rad/s²] or [m/s²]."""
        ...

    @property
    def position_error(self) -> Array:
        """In [rad] or [m]."""
        ...

    @property
    def velocity_error(self) -> Array:
        """In [rad/s] or [m/s]."""
        ...

    @property
    def upper_position_limit(self) -> Array:
        """In [rad] or [m]; inf where a joint turns without end."""
        ...


class JointStateReader:
    """Reads joint states in the order of the watched joints, and differentiates if need be.

    A driver may leave velocities empty. The mean velocity of a joint over the last h seconds is off
    its present one by at most q̈max h/2, and errors δq of both positions make it wrong by 2 δq/h
    more. Where that is within the joints' velocity error, differences over such an h are taken;
    else they are refused, with the error that would have to be stated. The least that any h gives
    is 2 √(q̈max δq). Stamps are taken to be those of the measurements.

    Args:
        topic: Its name, for errors.
        robot: Whose joints they are.
    """

    def __init__(self, topic: str, robot: WatchedJoints) -> None:
        self._offender = f"topic {topic!r}"
        self._robot = robot
        accel, error = robot.acceleration_limit, robot.position_error
        self._span = float(np.max(2.0 * np.sqrt(error / accel)))
        self._least_error = 2.0 * np.sqrt(accel * error)
        self._is_continuous = ~np.isfinite(robot.upper_position_limit)
        self._past: deque[tuple[float, Array]] = deque(maxlen=_HISTORY)

    def read(self, message: Any, stamp: float) -> tuple[Array, Array] | None:
        """Positions and velocities, shapes (nv,); None without watched joints, or none known yet.

        Args:
            message: A JointState.
            stamp: When it was measured, in [s].

        Raises:
            ArmguardError: It has some watched joints and lacks others, or has one twice, or fields
                of other lengths, or no velocities, and differences would be off by more than the
                joints' error.
        """
        joints = self._robot.joints
        places = {name: place for place, name in enumerate(message.name)}
        if not places.keys() & set(joints):
            return None
        twins = [joint for joint in joints if list(message.name).count(joint) > 1]
        if twins:
            raise ArmguardError(self._offender, f"has {twins[0]} twice", expected="each joint once")
        missing = [joint for joint in joints if joint not in places]
        if missing:
            raise ArmguardError(self._offender, f"lacks {', '.join(missing)} beside the others")
        order = [places[joint] for joint in joints]
        q = self._read_field(message, "position")[order]
        if len(message.velocity):
            return q, self._read_field(message, "velocity")[order]
        v = self._differentiate(q, stamp, len(message.name))
        return None if v is None else (q, v)

    def _read_field(self, message: Any, field: str) -> Array:
        values = np.array(getattr(message, field), dtype=np.float64)
        if len(values) != len(message.name):
            raise ArmguardError(
                self._offender,
                f"has {len(values)} values of {field} for {len(message.name)} joints",
                expected="one for each",
            )
        return values

    def _differentiate(self, q: Array, stamp: float, count: int) -> Array | None:
        self._check_error(self._least_error, count)
        if self._past and not stamp >= self._past[-1][0]:
            # A clock that began anew: what was before it has no time in common with what comes.
            self._past.clear()
        past = [one for one in self._past if one[0] < stamp]
        self._past.append((stamp, q))
        if not past:
            return None
        # The span that errs least, as nearly as states have come.
        before, start = min(past, key=lambda one: abs(stamp - one[0] - self._span))
        span = stamp - before
        robot = self._robot
        error = 0.5 * robot.acceleration_limit * span + 2.0 * robot.position_error / span
        if span < self._span and not (error <= robot.velocity_error).all():
            return None  # it takes a few more states
        self._check_error(error, count)
        change = q - start
        turns = np.where(self._is_continuous, np.round(change / (2.0 * np.pi)), 0.0)
        return (change - 2.0 * np.pi * turns) / span

    def _check_error(self, error: Array, count: int) -> None:
        robot = self._robot
        excess = error / robot.velocity_error
        worst = int(np.argmax(excess))
        if not excess[worst] <= 1.0:
            raise ArmguardError(
                self._offender,
                f"has 0 values of velocity for {count} joints, and differences of positions are "
                f"off by up to {error[worst]:.3g} for {robot.joints[worst]}",
                expected=f"velocities, or at most its velocity_error, "
                f"{robot.velocity_error[worst]:.3g}",
                remedy="state position_error and velocity_error in robot.toml as they are",
            )


def read_pose(position: Any, orientation: Any) -> tuple[Array, Array]:
    """Rotation and position; a quaternion of zeros, which many leave it at, turns nothing.

    One whose length is no number above 0 gives a rotation of NaN, which no table takes.
    """
    turn, length = _read_quaternion(orientation), read_length(orientation)
    if not turn.any():
        rotation = np.eye(3)
    elif 0.0 < length < math.inf:
        rotation = pinocchio.Quaternion(turn / length).toRotationMatrix()
    else:
        rotation = np.full((3, 3), np.nan)
    return rotation, _read_vector(position)


def read_length(orientation: Any) -> float:
    """Length of a quaternion; inf or 0 also where its squares are too large or too small."""
    return math.sqrt(sum(value * value for value in _read_quaternion(orientation).tolist()))


def read_nanoseconds(header: Any) -> int:
    """The stamp of a header, in [ns]."""
    return int(header.stamp.sec) * 1_000_000_000 + int(header.stamp.nanosec)


def _read_quaternion(turn: Any) -> Array:
    return np.array([turn.x, turn.y, turn.z, turn.w], dtype=np.float64)


def _read_vector(vector: Any) -> Array:
    return np.array([vector.x, vector.y, vector.z], dtype=np.float64)


def _corners(size: Array) -> Array:
    """Corners of a box about the origin. Shape (8, 3)."""
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    return 0.5 * signs * size


def _make_box(name: str, pose: Any, size: Any) -> Body:
    rotation, position = read_pose(pose.position, pose.orientation)
    return Body(name, position + _corners(_read_vector(size)) @ rotation.T, 0.0)
