"""A monitor for a ROS 2 node: everything except sending and receiving messages.

It needs no ROS: messages are anything with the fields of their types. All times are of one clock,
the node's: system time, or that of a simulation with `use_sim_time`. They are counted from its
first reading, so that nanoseconds are kept. A reading of 0 is none: so it stands before `/clock`.

Frames that stand and frames that move come as transforms. A body that was seen from a moving frame
is taken to the world by the transform that is nearest in time to its stamp. By how far the frame
can have moved between the two, its position may be wrong, and by the errors of each transform on
the way. All of that is the error of the sample.
"""

from __future__ import annotations

import fnmatch
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from armguard.bridges.messages import (
    JointStateReader,
    ObstacleReader,
    Shown,
    make_batches,
    read_length,
    read_nanoseconds,
    read_pose,
    remove_known,
    split_source,
)
from armguard.exceptions import ArmguardError
from armguard.messages.batch import ObstacleBatch
from armguard.monitor.monitor import Monitor
from armguard.obstacles.obstacles import WORLD
from armguard.verdict import Level, Verdict

Array = NDArray[np.float64]

OLDEST_TRANSFORM = 0.5
"""From a stamp to the nearest transform of a moving frame at most, in [s]."""

LENGTH_TOLERANCE = 1e-3
"""How far the length of a transform's quaternion may be from 1."""

DIAGNOSTICS, SPEED = "diagnostic_msgs/msg/DiagnosticArray", "std_msgs/msg/Float64"
"""Types of what goes out."""

_KEPT = 1000
"""Transforms of a moving frame that are kept, at most."""

_LONGEST_CHAIN = 100


class FrameErrors(NamedTuple):
    """What a frame's pose in its parent may be off by, and how fast it moves there at most."""

    position: float = 0.0
    """[m]."""
    angle: float = 0.0
    """[rad]."""
    speed: float = 0.0
    """Of its origin, in [m/s]."""
    turn_rate: float = 0.0
    """[rad/s]; of the frame of a link, the velocity limit of its joint."""


class _Frame(NamedTuple):
    """What is known of a frame."""

    parent: str
    stands: bool
    """Whether its one pose holds at all times."""
    past: deque[tuple[float, Array, Array]]
    """Stamps in [s], rotations, and translations in [m]."""


class Transforms:
    """Poses of frames in their parents, standing and moving.

    Args:
        errors: Of frames by name, or by patterns as `"panda_link*"`; the first that fits counts. A
            standing frame that none fits has none; a moving one is refused.

    Raises:
        ArmguardError: An error is negative, or not a number.
    """

    def __init__(self, errors: Mapping[str, FrameErrors] | None = None) -> None:
        self._errors = dict(errors or {})
        for name, one in self._errors.items():
            for field, value in one._asdict().items():
                if not 0.0 <= value < np.inf:
                    raise ArmguardError(
                        f"frame {name!r}", f"has the {field} {value}", expected="at least 0"
                    )
        self._known: dict[str, _Frame] = {}

    def take(self, child: str, parent: str, pose: tuple[Array, Array], stamp: float | None) -> None:
        """Take a transform.

        Args:
            child: The frame whose pose it is.
            parent: The frame that it is given in.
            pose: Rotation and translation, the latter in [m].
            stamp: When it was so, in [s]; None: always.
        """
        known = self._known.get(child)
        if stamp is None or known is None or (known.parent, known.stands) != (parent, False):
            known = self._known[child] = _Frame(parent, stamp is None, deque(maxlen=_KEPT))
        known.past.append((stamp or 0.0, *pose))

    def take_message(
        self, message: Any, read_stamp: Callable[[Any], float] | None
    ) -> list[ArmguardError]:
        """Take a TFMessage; what was refused of it, and why.

        Of a transform whose quaternion is no rotation nothing is taken.

        Args:
            message: Of `/tf` or `/tf_static`.
            read_stamp: The time of a header, in [s]; None: these transforms always hold.
        """
        refused = []
        for one in message.transforms:
            child, parent = (name.strip("/") for name in (one.child_frame_id, one.header.frame_id))
            length = read_length(one.transform.rotation)
            try:
                if not abs(length - 1.0) <= LENGTH_TOLERANCE:
                    raise ArmguardError(
                        f"frame {child!r}",
                        f"has a quaternion of length {length:.6g}",
                        expected=f"1, within {LENGTH_TOLERANCE:g}",
                    )
                stamp = None if read_stamp is None else read_stamp(one.header)
            except ArmguardError as error:
                refused.append(error)
                continue
            pose = read_pose(one.transform.translation, one.transform.rotation)
            self.take(child, parent, pose, stamp)
        return refused

    def place(
        self, shown: Shown, source: str, stamp: float, goals: set[str], *, snapshot: bool
    ) -> Iterator[ObstacleBatch]:
        """What a message shows, in batches in a frame that is known otherwise.

        Args:
            shown: Of one frame.
            source: Who saw it.
            stamp: When, in [s].
            goals: Frames that are known otherwise.
            snapshot: Whether it is all that there is.

        Raises:
            ArmguardError: As `lead` does.
        """
        for batch in make_batches(shown, source, stamp, snapshot=snapshot):
            points, goal, error = self.lead(batch.position, batch.frame, stamp, goals)
            yield batch._replace(position=points, position_error=error, frame=goal)

    def lead(
        self, points: Array, frame: str, stamp: float, goals: set[str]
    ) -> tuple[Array, str, float]:
        """Points in the first frame on the way to the world that is one of the goals.

        A rotation that is wrong by an angle a moves a point at distance r from the frame's origin
        by at most a r; so one step on the way adds e + a (r + ε) to an error ε, where e is that of
        the frame's origin.

        Args:
            points: In [m]. Shape (..., 3).
            frame: That they are given in.
            stamp: When they were measured, in [s].
            goals: Frames that are known otherwise.

        Returns:
            The points, the goal, and how far a point may be off because of the frames, in [m].

        Raises:
            ArmguardError: No transforms lead there, or one is too old, or has no stated bounds.
        """
        begun, error = frame, 0.0
        for _ in range(_LONGEST_CHAIN):
            if frame in goals:
                return points, frame, error
            known = self._known.get(frame)
            if known is None:
                raise ArmguardError(
                    f"frame {begun!r}",
                    f"is not in a tree with the world: there is no transform of {frame!r}",
                    expected=f"transforms to one of {', '.join(sorted(goals))}",
                )
            errors = self._find_errors(frame, known)
            when, rotation, translation = min(known.past, key=lambda one: abs(one[0] - stamp))
            away = 0.0 if known.stands else abs(when - stamp)
            if not away <= OLDEST_TRANSFORM:
                raise ArmguardError(
                    f"frame {frame!r}",
                    f"has no transform within {away:.3g} s of a stamp",
                    expected=f"one within {OLDEST_TRANSFORM:g} s",
                )
            distance = float(np.linalg.norm(points, axis=-1).max(initial=0.0)) + error
            angle = errors.angle + errors.turn_rate * away
            error += errors.position + errors.speed * away + angle * distance
            points = points @ rotation.T + translation
            frame = known.parent
        raise ArmguardError(f"frame {begun!r}", "hangs on itself", expected="a tree of frames")

    def _find_errors(self, frame: str, known: _Frame) -> FrameErrors:
        for pattern, errors in self._errors.items():
            if fnmatch.fnmatchcase(frame, pattern):
                return errors
        if not known.stands:
            raise ArmguardError(
                f"frame {frame!r}",
                "moves, and nothing says how fast it can",
                expected="its speed and turn_rate, at most",
            )
        return FrameErrors()


class Ros2Cell:
    """Takes messages as they come, and answers with verdicts; nothing in a message makes it raise.

    Unusable messages are counted, and reported to the monitor if obstacles may be missing because
    of them.

    Args:
        monitor: Is stepped; its table is written.
        joints: Topic of the joint states.
        obstacles: Types of the other topics, by "/topic" or "source=/topic"; a source that is not
            named has the name of its topic.
        radius: Of what comes without sizes, in [m].
        snapshot: Whether each message shows all that its source sees.
        errors: Of frames that come as transforms; see `Transforms`.

    Attributes:
        refused: Messages that could not be used.
        last_refusal: The last of them, in words.

    Raises:
        ArmguardError: A type is no input, or lacks a radius, or an error is negative.
    """

    def __init__(
        self,
        monitor: Monitor,
        joints: str = "/joint_states",
        obstacles: Mapping[str, str] | None = None,
        *,
        radius: float | None = None,
        snapshot: bool = False,
        errors: Mapping[str, FrameErrors] | None = None,
    ) -> None:
        self.refused = 0
        self.last_refusal = ""
        self._monitor = monitor
        self._snapshot = snapshot
        self._joints = JointStateReader(joints, monitor.robot)
        self._readers: dict[str, tuple[str, ObstacleReader]] = {}
        for name, kind in (obstacles or {}).items():
            source, topic = split_source(name)
            reader = ObstacleReader(topic, kind, radius, snapshot=snapshot)
            self._readers[topic] = source, reader
        self._transforms = Transforms(errors)
        self._goals = {WORLD, *monitor.obstacles.settings.frames}
        self._start: int | None = None
        self._now = 0.0
        self._state: tuple[float, Array, Array] | None = None

    @property
    def topics(self) -> list[str]:
        """Of obstacles."""
        return list(self._readers)

    def take_joints(self, message: Any) -> None:
        """Take a JointState."""
        try:
            stamp = self._read_stamp(message.header)
            state = self._joints.read(message, stamp)
        except ArmguardError as error:
            self._refuse(error)
            return
        if state is not None:
            self._state = (stamp, *state)

    def take_transforms(self, message: Any, *, is_static: bool) -> None:
        """Take a TFMessage, of `/tf` or `/tf_static`."""
        read_stamp = None if is_static else self._read_stamp
        for error in self._transforms.take_message(message, read_stamp):
            self._refuse(error)

    def take_obstacles(self, topic: str, message: Any) -> None:
        """Take a message of one of the topics of obstacles."""
        source, reader = self._readers[topic]
        table = self._monitor.obstacles
        try:
            gone, shown = reader.read(message)
            remove_known(table, gone, source)
            for one in shown:
                self._update(source, one)
        except ArmguardError as error:
            self._refuse(error)
            table.leave_malformed(source, error.offender, error.problem, self._now)

    def step(self, now: int) -> Verdict | None:
        """One tick; None before the first joint state, which means STOP.

        Args:
            now: The present, in [ns] of the node's clock; 0, before `/clock` has come, is no time.
        """
        if now == 0:
            return None
        self._now = self._to_seconds(now)
        if self._state is None:
            return None
        return self._monitor.step(*self._state, self._now)

    def _update(self, source: str, shown: Shown) -> None:
        stamp = self._read_stamp(shown.header)
        for batch in self._transforms.place(
            shown, source, stamp, self._goals, snapshot=self._snapshot
        ):
            self._monitor.obstacles.update(*batch)

    def _read_stamp(self, header: Any) -> float:
        return self._to_seconds(read_stamp(header))

    def _to_seconds(self, nanoseconds: int) -> float:
        if self._start is None:
            self._start = nanoseconds
        return (nanoseconds - self._start) * 1e-9

    def _refuse(self, error: ArmguardError) -> None:
        self.refused += 1
        self.last_refusal = str(error)


def read_stamp(header: Any) -> int:
    """When it was measured, in [ns] of the clock of the graph.

    Raises:
        ArmguardError: The stamp is 0.
    """
    nanoseconds = read_nanoseconds(header)
    if nanoseconds == 0:
        raise ArmguardError("stamp", "is 0, which is no time", expected="that of the sample")
    return nanoseconds


class Diagnostic(NamedTuple):
    """What a `diagnostic_msgs/DiagnosticStatus` says of a verdict."""

    level: int
    """0: OK, 1: WARN, 2: ERROR."""
    message: str
    values: dict[str, str]


def describe_verdict(
    verdict: Verdict | None, problem: str = "no joint state has arrived yet"
) -> Diagnostic:
    """A verdict as a diagnostic: CLEAR and AWARE are OK, SLOW is WARN, STOP is ERROR.

    Args:
        verdict: None: there is none, which is a STOP.
        problem: Why there is none.
    """
    if verdict is None:
        return Diagnostic(2, f"STOP: {problem}", {"speed_scale": "0"})
    level = {Level.STOP: 2, Level.SLOW: 1}.get(verdict.level, 0)
    why = f": {verdict.reasons[0]}" if verdict.reasons else ""
    values = {
        "contact_time": f"{verdict.contact_time:.6g}",
        "harm_time": f"{verdict.harm_time:.6g}",
        "stop_time": f"{verdict.stop_time:.6g}",
        "speed_scale": f"{read_speed_override(verdict):.6g}",
        "link": verdict.link or "",
        "obstacle": verdict.obstacle or "",
        "complete": str(verdict.complete).lower(),
        "reasons": "; ".join(str(reason) for reason in verdict.reasons),
        "run": verdict.run,
    }
    if verdict.contact_speed is not None:
        values["contact_speed"] = f"{verdict.contact_speed:.6g}"
    if verdict.proved_until is not None:
        values["proved_until"] = f"{verdict.proved_until:.6f}"
    return Diagnostic(level, f"{verdict.level.name}{why}", values)


def read_speed_override(verdict: Verdict | None) -> float:
    """How fast the arm may go on, from 0 to 1; 0 on STOP, and where there is no verdict."""
    if verdict is None or verdict.level is Level.STOP:
        return 0.0
    scale = float(verdict.speed_scale)
    return scale if 0.0 <= scale <= 1.0 else 0.0


class AnswerMaker:
    """Makes the messages that go out, of whichever library's types.

    Args:
        find_type: The class of messages of a type; it takes the fields as keywords.
        to_byte: What makes a `byte` of a number.
        robot: Name of the robot.
    """

    def __init__(
        self, find_type: Callable[[str], Any], to_byte: Callable[[int], Any], robot: str
    ) -> None:
        self.diagnostics = find_type(DIAGNOSTICS)
        self.speed = find_type(SPEED)
        self._status = find_type("diagnostic_msgs/msg/DiagnosticStatus")
        self._value = find_type("diagnostic_msgs/msg/KeyValue")
        self._header = find_type("std_msgs/msg/Header")
        self._to_byte = to_byte
        self._robot = robot

    def make_diagnostics(self, stamp: Any, diagnostic: Diagnostic) -> Any:
        """What `describe_verdict` says, as a DiagnosticArray of a `builtin_interfaces/Time`."""
        level, message, values = diagnostic
        status = self._status(
            level=self._to_byte(level),
            name="armguard",
            message=message,
            hardware_id=self._robot,
            values=[self._value(key=key, value=value) for key, value in values.items()],
        )
        return self.diagnostics(header=self._header(stamp=stamp, frame_id=""), status=[status])

    def make_speed(self, scale: float) -> Any:
        """How fast the arm may go on, from 0 to 1, as a Float64."""
        return self.speed(data=scale)
