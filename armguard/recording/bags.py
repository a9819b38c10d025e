"""Recordings of others as input: rosbag2 folders and MCAP files, without ROS.

Joint states become steps, and what perception published becomes obstacles. A message of a kind that
says nothing of sizes (`PoseArray`) is made of balls of one radius. What has a shape that is no hull
of eight points is bounded by one that contains it, or refused.
"""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from armguard.exceptions import ArmguardError
from armguard.monitor.monitor import Monitor
from armguard.recording.replay import ReplayedTick

JOINTS = "sensor_msgs/msg/JointState"
POSES = "geometry_msgs/msg/PoseArray"
MARKERS = "visualization_msgs/msg/MarkerArray"
DETECTIONS = "vision_msgs/msg/Detection3DArray"

KINDS = (JOINTS, POSES, MARKERS, DETECTIONS)
"""Messages that can be input."""

FARTHEST_STAMP = 10.0
"""A stamp that is farther from when its message was recorded, in [s], is of another clock."""

_CUBE, _SPHERE, _CYLINDER, _LINE_STRIP, _LINE_LIST, _CUBE_LIST, _SPHERE_LIST, _POINTS = range(1, 9)
_DELETE, _DELETE_ALL = 2, 3
_WITHOUT_BODY = {0: "arrows", 9: "texts"}
"""Markers that explain others."""


class Body(NamedTuple):
    """An obstacle as a message describes it, in its frame."""

    id: str
    points: NDArray[np.float64]
    """[m]. Shape (k, 3)."""
    radius: float
    """[m]."""


class BagRun:
    """Leads a monitor through a recording of others.

    Each joint state is a step, at the time at which it was recorded.

    Args:
        path: A rosbag2 folder, or one of its files, or an MCAP file of ROS 2 messages.
        monitor: Is stepped; its table is written.
        topics: Those that are input, each as "/topic" or "source=/topic": one of joint states,
            and any number of obstacles. A source that is not named has the name of its topic.
        radius: Of what comes as poses alone, in [m]; None: such topics are refused.
        snapshot: Whether each message shows all that its source sees, so that what is absent is
            removed.
        stamps: Whether states were measured when their headers say, or when they were recorded.

    Attributes:
        passed_over: Markers that have no body, by kind.

    Raises:
        ArmguardError: The recording cannot be read, lacks a topic, or has it in a type that is no
            input, or the package for it is missing.
    """

    def __init__(
        self,
        path: str | Path,
        monitor: Monitor,
        topics: Sequence[str],
        *,
        radius: float | None = None,
        snapshot: bool = False,
        stamps: Literal["header", "recorded"] = "header",
    ) -> None:
        if importlib.util.find_spec("rosbags") is None:
            raise ArmguardError(
                "recordings of others",
                "need the package rosbags, which is not installed",
                remedy="pip install 'armguard[record]'",
            )
        if radius is not None and not 0.0 <= radius < math.inf:
            raise ArmguardError("radius", f"is {radius}", expected="a number of metres, at least 0")
        self.passed_over: dict[str, int] = {}
        self._path, self._monitor = Path(path), monitor
        self._radius, self._snapshot, self._stamps = radius, snapshot, stamps
        self._sources = {}
        for topic in topics:
            source, equals, name = topic.rpartition("=")
            self._sources[name] = source if equals else name.strip("/")
        self._start = 0
        self._frames = {"world", *monitor.obstacles.settings.frames}
        self._known: dict[str, set[str]] = {}
        with self._open() as reader:
            self._check_topics({name: info.msgtype or "" for name, info in reader.topics.items()})

    def ticks(self) -> Iterator[ReplayedTick]:
        """Lead the monitor through the recording, joint state by joint state.

        Raises:
            ArmguardError: A message cannot be used.
        """
        robot, found = self._monitor.robot, 0
        with self._open() as reader:
            self._start = reader.start_time
            chosen = [one for one in reader.connections if one.topic in self._sources]
            for connection, nanoseconds, data in self._read(reader, chosen):
                message = self._decode(reader, data, connection.msgtype)
                now = self._to_seconds(nanoseconds)
                if connection.msgtype != JOINTS:
                    self._take_obstacles(connection, message, now)
                    continue
                state = self._read_joints(connection.topic, message, robot.joints)
                if state is None:
                    continue
                found += 1
                stamp = self._read_stamp(connection.topic, message.header, now)
                verdict = self._monitor.step(stamp, *state, now)
                yield ReplayedTick(
                    nanoseconds, now, verdict, verdict, is_compared=False, is_identical=True
                )
        if not found:
            raise self._refuse(
                "joint states", "have none of the joints", expected=", ".join(robot.joints)
            )

    def _open(self) -> Any:
        # Here, since most of armguard works without recordings.
        from rosbags.highlevel import AnyReader, AnyReaderError
        from rosbags.typesys import Stores, get_typestore

        try:
            reader = AnyReader([self._path], default_typestore=get_typestore(Stores.ROS2_HUMBLE))
            reader.open()
        except FileNotFoundError:
            raise ArmguardError(
                str(self._path), "is not there, or a folder without metadata.yaml"
            ) from None
        except (AnyReaderError, OSError, ValueError, LookupError, AssertionError) as error:
            line = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise ArmguardError(
                str(self._path),
                f"cannot be read ({line})",
                expected="a rosbag2 folder or an MCAP file of ROS 2 messages",
            ) from None
        return _Closing(reader)

    def _check_topics(self, types: dict[str, str]) -> None:
        there = ", ".join(f"{name} ({kind})" for name, kind in sorted(types.items())) or "none"
        for topic in self._sources:
            if topic not in types:
                raise self._refuse(f"topic {topic!r}", "is not there", expected=f"one of: {there}")
        for topic in self._sources:
            if types[topic] not in KINDS:
                raise self._refuse(
                    f"topic {topic!r}",
                    f"is of type {types[topic]!r}",
                    expected=f"one of {', '.join(KINDS)}",
                )
            if types[topic] == POSES and self._radius is None:
                raise self._refuse(
                    f"topic {topic!r}", "has poses without sizes", remedy="give --radius in metres"
                )
        joints = [topic for topic in self._sources if types[topic] == JOINTS]
        if len(joints) != 1:
            raise self._refuse(
                "topics",
                f"name {len(joints)} of joint states",
                expected=f"one of type {JOINTS}; there are: {there}",
            )

    def _read(self, reader: Any, chosen: list[Any]) -> Iterator[tuple[Any, int, bytes]]:
        """Messages in the order in which they were recorded."""
        try:
            yield from reader.messages(chosen)
        except ArmguardError:
            raise
        except Exception as error:
            # A damaged file can make the reader stumble anywhere.
            line = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise ArmguardError(str(self._path), f"is damaged ({line})") from None

    def _decode(self, reader: Any, data: bytes, kind: str) -> Any:
        try:
            return reader.deserialize(data, kind)
        except Exception as error:
            raise ArmguardError(
                str(self._path), f"has a {kind} that cannot be read ({error})"
            ) from None

    def _to_seconds(self, nanoseconds: int) -> float:
        # From the first message on, so that nanoseconds are kept.
        return (nanoseconds - self._start) * 1e-9

    def _read_stamp(self, topic: str, header: Any, now: float) -> float:
        if self._stamps == "recorded":
            return now
        nanoseconds = int(header.stamp.sec) * 1_000_000_000 + int(header.stamp.nanosec)
        stamp = self._to_seconds(nanoseconds)
        if not abs(stamp - now) <= FARTHEST_STAMP:
            raise self._refuse(
                f"topic {topic!r}",
                f"has a stamp {stamp - now:.6g} s from when it was recorded",
                expected=f"at most {FARTHEST_STAMP:g} s",
                remedy="with --stamps recorded the time of recording stands for it",
            )
        return stamp

    def _read_joints(
        self, topic: str, message: Any, joints: Sequence[str]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
        """Positions and velocities of the watched joints; None if none of them is there."""
        places = {name: place for place, name in enumerate(message.name)}
        if not places.keys() & set(joints):
            return None
        missing = [joint for joint in joints if joint not in places]
        if missing:
            raise self._refuse(f"topic {topic!r}", f"lacks {', '.join(missing)} beside the others")
        order = [places[joint] for joint in joints]
        vectors = []
        for field in ("position", "velocity"):
            values = np.array(getattr(message, field), dtype=np.float64)
            if len(values) != len(message.name):
                raise self._refuse(
                    f"topic {topic!r}",
                    f"has {len(values)} values of {field} for {len(message.name)} joints",
                    expected="one for each",
                )
            vectors.append(values[order])
        return vectors[0], vectors[1]

    def _take_obstacles(self, connection: Any, message: Any, now: float) -> None:
        topic, source = connection.topic, self._sources[connection.topic]
        if connection.msgtype == MARKERS:
            self._take_markers(topic, source, message, now)
            return
        if connection.msgtype == POSES:
            assert self._radius is not None
            bodies = [
                Body(f"{number}", _read_vector(pose.position)[None], self._radius)
                for number, pose in enumerate(message.poses)
            ]
        else:
            bodies = [
                _make_box(one.id or f"{number}", one.bbox.center, one.bbox.size)
                for number, one in enumerate(message.detections)
            ]
        self._update(topic, source, message.header, bodies, now, snapshot=self._snapshot)

    def _take_markers(self, topic: str, source: str, message: Any, now: float) -> None:
        """Markers come and go by themselves, each with a header of its own."""
        bodies: dict[str, list[Body]] = {}
        headers: dict[str, Any] = {}
        known = self._known.setdefault(source, set())
        for marker in message.markers:
            name = f"{marker.ns}/{marker.id}" if marker.ns else f"{marker.id}"
            if marker.action in (_DELETE, _DELETE_ALL):
                everything = marker.action == _DELETE_ALL
                gone = [id for id in known if everything or id == name or id.startswith(f"{name}/")]
                for kept in bodies.values():
                    kept[:] = [body for body in kept if body.id not in gone]
                self._remove(source, gone, set())
                continue
            kind = int(marker.type)
            if kind in _WITHOUT_BODY:
                words = _WITHOUT_BODY[kind]
                self.passed_over[words] = self.passed_over.get(words, 0) + 1
                continue
            made = self._make_bodies(topic, name, kind, marker)
            # A marker takes the place of the one before, which may have had more bodies.
            ids = {body.id for body in made}
            self._remove(source, [id for id in known if id.startswith(f"{name}/")], ids)
            headers[marker.header.frame_id] = marker.header
            bodies.setdefault(marker.header.frame_id, []).extend(made)
            known.update(body.id for body in made)
        if len(bodies) > 1 and self._snapshot:
            raise self._refuse(
                f"topic {topic!r}",
                "has several frames in one message",
                expected="one with snapshots",
            )
        for frame, made in bodies.items():
            self._update(topic, source, headers[frame], made, now, snapshot=self._snapshot)

    def _remove(self, source: str, ids: list[str], kept: set[str]) -> None:
        """Remove obstacles of a source that were told of, except for some."""
        gone = sorted(set(ids) - kept)
        self._known[source].difference_update(gone)
        told = [id for id in gone if self._monitor.obstacles.row(id, source) >= 0]
        if told:
            self._monitor.obstacles.remove(told, source=source)

    def _make_bodies(self, topic: str, name: str, kind: int, marker: Any) -> list[Body]:
        """The bodies of one marker; of several, each has the marker's name and a number."""
        scale = _read_vector(marker.scale)
        if kind == _SPHERE:
            return [Body(name, _read_vector(marker.pose.position)[None], 0.5 * float(scale.max()))]
        if kind in (_CUBE, _CYLINDER):
            # A cylinder lies in the box around it.
            return [_make_box(name, marker.pose, marker.scale)]
        points = np.array([_read_vector(point) for point in marker.points]).reshape(-1, 3)
        rotation, origin = _read_pose(marker.pose)
        places = points @ rotation.T + origin
        if kind in (_LINE_STRIP, _LINE_LIST):
            step = 1 if kind == _LINE_STRIP else 2
            ends = range(0, len(places) - 1, step)
            pairs = [places[k : k + 2] for k in ends]
            return [Body(f"{name}/{k}", pair, 0.5 * scale[0]) for k, pair in enumerate(pairs)]
        if kind == _CUBE_LIST:
            corners = _corners(scale) @ rotation.T
            return [Body(f"{name}/{k}", place + corners, 0.0) for k, place in enumerate(places)]
        if kind in (_SPHERE_LIST, _POINTS):
            # A point is drawn as a square, which the ball around it contains.
            radius = 0.5 * float(scale.max() if kind == _SPHERE_LIST else np.hypot(*scale[:2]))
            return [Body(f"{name}/{k}", place[None], radius) for k, place in enumerate(places)]
        raise self._refuse(
            f"topic {topic!r}",
            f"has the marker {name!r} of type {kind}, whose extent is not known",
            expected="cubes, spheres, cylinders, lines, or lists of these",
        )

    def _update(
        self,
        topic: str,
        source: str,
        header: Any,
        bodies: list[Body],
        now: float,
        *,
        snapshot: bool,
    ) -> None:
        frame = str(header.frame_id).strip("/") or "world"
        if frame not in self._frames:
            raise self._refuse(
                f"topic {topic!r}",
                f"is in the frame {frame!r}",
                expected=f"one of {', '.join(sorted(self._frames))}",
                remedy="name it in [frames] of the cell file",
            )
        stamp = self._read_stamp(topic, header, now)
        update: Callable[..., None] = self._monitor.obstacles.update
        counts = sorted({len(body.points) for body in bodies}) or [1]
        if snapshot and len(counts) > 1:
            # One call shows the whole cell, so all have as many points: the last one repeated.
            most = counts[-1]
            bodies = [
                body._replace(points=body.points[np.minimum(np.arange(most), len(body.points) - 1)])
                for body in bodies
            ]
            counts = [most]
        for count in counts:
            chosen = [body for body in bodies if len(body.points) == count]
            position = np.array([body.points for body in chosen]).reshape(-1, count, 3)
            radius = np.array([body.radius for body in chosen], dtype=np.float64)
            try:
                update(
                    [body.id for body in chosen],
                    stamp,
                    position,
                    radius=radius,
                    source=source,
                    frame=frame,
                    snapshot=snapshot,
                )
            except ArmguardError as error:
                raise self._refuse(f"topic {topic!r}", str(error)) from None

    def _refuse(self, offender: str, problem: str, **more: str) -> ArmguardError:
        return ArmguardError(f"{self._path}: {offender}", problem, **more)


class _Closing:
    """Closes a reader that was opened."""

    def __init__(self, reader: Any) -> None:
        self._reader = reader

    def __enter__(self) -> Any:
        return self._reader

    def __exit__(self, *_: object) -> None:
        self._reader.close()


def _read_vector(vector: Any) -> NDArray[np.float64]:
    return np.array([vector.x, vector.y, vector.z], dtype=np.float64)


def _read_pose(pose: Any) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Rotation and position; a quaternion of zeros, which many leave it at, turns nothing."""
    turn = pose.orientation
    w, x, y, z = (float(value) for value in (turn.w, turn.x, turn.y, turn.z))
    norm = math.sqrt(w * w + x * x + y * y + z * z)
    if norm == 0.0:
        return np.eye(3), _read_vector(pose.position)
    w, x, y, z = w / norm, x / norm, y / norm, z / norm
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    return rotation, _read_vector(pose.position)


def _corners(size: NDArray[np.float64]) -> NDArray[np.float64]:
    """Corners of a box about the origin. Shape (8, 3)."""
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    return 0.5 * signs * size


def _make_box(name: str, pose: Any, size: Any) -> Body:
    rotation, position = _read_pose(pose)
    return Body(name, position + _corners(_read_vector(size)) @ rotation.T, 0.0)
