"""Recordings of other programs as input: rosbag2 folders and MCAP files, without ROS.

Joint states become steps, and what perception published becomes obstacles, as
`armguard.bridges.messages` reads them.
"""

from __future__ import annotations

import contextlib
import importlib.util
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple

from armguard.bridges.messages import (
    JOINTS,
    JointStateReader,
    ObstacleReader,
    Shown,
    make_batches,
    read_frame,
    read_nanoseconds,
    remove_known,
    split_source,
)
from armguard.exceptions import ArmguardError
from armguard.monitor.monitor import Monitor
from armguard.recording.replay import ReplayedTick

FARTHEST_STAMP = 10.0
"""Greatest difference of a stamp and the time of recording, in [s]; beyond it the clock is another
one."""


class BagInputs(NamedTuple):
    """Which topics of another program's recording are input, and how they are read."""

    topics: Sequence[str]
    """Each as "/topic" or "source=/topic": one of joint states, and any number of obstacles. A
    source that is not named has the name of its topic."""
    radius: float | None = None
    """Radius of bodies that have only poses, in [m]; None: such topics are refused."""
    snapshot: bool = False
    """Whether each message shows all bodies that its source sees, so absent ones are removed."""
    stamps: Literal["header", "recorded"] = "header"
    """Whether states were measured when their headers say, or when they were recorded."""


class BagRun:
    """Steps a monitor through a recording of another program.

    Each joint state is a step, at the time at which it was recorded.

    Args:
        path: A rosbag2 folder, or one of its files, or an MCAP file of ROS 2 messages.
        monitor: The monitor to step; its table is changed.
        inputs: Its input topics.

    Raises:
        ArmguardError: The recording cannot be read, lacks a topic, or has it in a type that is no
            input, or the package for it is missing.
    """

    def __init__(self, path: str | Path, monitor: Monitor, inputs: BagInputs) -> None:
        if importlib.util.find_spec("rosbags") is None:
            raise ArmguardError(
                "recordings of others",
                "need the package rosbags, which is not installed",
                remedy="pip install 'armguard[record]'",
            )
        topics, radius, snapshot, _ = self._inputs = inputs
        self._path, self._monitor = Path(path), monitor
        self._sources = {topic: source for source, topic in map(split_source, topics)}
        self._start = 0
        self._frames = {"world", *monitor.obstacles.settings.frames}
        with self._open() as reader:
            types = {name: info.msgtype or "" for name, info in reader.topics.items()}
        there = ", ".join(f"{name} ({kind})" for name, kind in sorted(types.items())) or "none"
        for topic in self._sources:
            if topic not in types:
                raise self._refuse(f"topic {topic!r}", "is not there", expected=f"one of: {there}")
        with self._naming():
            self._obstacles = {
                topic: ObstacleReader(topic, types[topic], radius, snapshot=snapshot)
                for topic in self._sources
                if types[topic] != JOINTS
            }
        count = len(self._sources) - len(self._obstacles)
        if count != 1:
            raise self._refuse(
                "topics",
                f"name {count} of joint states",
                expected=f"one of type {JOINTS}; there are: {there}",
            )

    @property
    def passed_over(self) -> dict[str, int]:
        """Markers that have no body, by kind."""
        found: dict[str, int] = {}
        for reader in self._obstacles.values():
            for kind, count in reader.passed_over.items():
                found[kind] = found.get(kind, 0) + count
        return found

    def ticks(self) -> Iterator[ReplayedTick]:
        """Step the monitor through the recording, joint state by joint state.

        Raises:
            ArmguardError: A message cannot be used.
        """
        robot, found = self._monitor.robot, 0
        with self._open() as reader:
            self._start = reader.start_time
            chosen = [one for one in reader.connections if one.topic in self._sources]
            joints = {
                one.topic: JointStateReader(one.topic, robot)
                for one in chosen
                if one.msgtype == JOINTS
            }
            for connection, nanoseconds, data in self._read(reader, chosen):
                message = self._decode(reader, data, connection.msgtype)
                now = self._to_seconds(nanoseconds)
                if connection.msgtype != JOINTS:
                    self._take_obstacles(connection, message, now)
                    continue
                stamp = self._read_stamp(connection.topic, message.header, now)
                with self._naming():
                    state = joints[connection.topic].read(message, stamp)
                if state is None:
                    continue
                found += 1
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
        import sqlite3
        import struct

        from rosbags.highlevel import AnyReader, AnyReaderError
        from rosbags.typesys import Stores, get_typestore

        # Of a damaged bag the reader tells by whatever error it meets.
        damage = AnyReaderError, OSError, ValueError, LookupError, AssertionError
        try:
            reader = AnyReader([self._path], default_typestore=get_typestore(Stores.ROS2_HUMBLE))
            reader.open()
        except FileNotFoundError:
            raise ArmguardError(
                str(self._path), "does not exist, or is a folder without metadata.yaml"
            ) from None
        except (*damage, sqlite3.DatabaseError, struct.error) as error:
            raise ArmguardError(
                str(self._path),
                f"cannot be read ({_shorten(error)})",
                expected="a rosbag2 folder or an MCAP file of ROS 2 messages",
            ) from None
        return contextlib.closing(reader)

    def _read(self, reader: Any, chosen: list[Any]) -> Iterator[tuple[Any, int, bytes]]:
        """Messages in the order in which they were recorded."""
        try:
            yield from reader.messages(chosen)
        except Exception as error:
            # A damaged file can make the reader stumble anywhere.
            raise ArmguardError(str(self._path), f"is damaged ({_shorten(error)})") from None

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
        if self._inputs.stamps == "recorded":
            return now
        stamp = self._to_seconds(read_nanoseconds(header))
        if not abs(stamp - now) <= FARTHEST_STAMP:
            raise self._refuse(
                f"topic {topic!r}",
                f"has a stamp {stamp - now:.6g} s from when it was recorded",
                expected=f"at most {FARTHEST_STAMP:g} s",
                remedy="--stamps recorded uses the time of recording instead",
            )
        return stamp

    def _take_obstacles(self, connection: Any, message: Any, now: float) -> None:
        topic, source = connection.topic, self._sources[connection.topic]
        with self._naming():
            gone, shown = self._obstacles[topic].read(message)
        remove_known(self._monitor.obstacles, gone, source)
        for one in shown:
            self._update(topic, source, one, now)

    def _update(self, topic: str, source: str, shown: Shown, now: float) -> None:
        frame = read_frame(shown.header)
        if frame not in self._frames:
            raise self._refuse(
                f"topic {topic!r}",
                f"is in the frame {frame!r}",
                expected=f"one of {', '.join(sorted(self._frames))}",
                remedy="name it in [frames] of the cell file",
            )
        stamp = self._read_stamp(topic, shown.header, now)
        for batch in make_batches(shown, source, stamp, snapshot=self._inputs.snapshot):
            try:
                self._monitor.obstacles.update(*batch)
            except ArmguardError as error:
                raise self._refuse(f"topic {topic!r}", str(error)) from None

    @contextlib.contextmanager
    def _naming(self) -> Iterator[None]:
        """Add the name of the recording to errors."""
        try:
            yield
        except ArmguardError as error:
            raise self._refuse(
                error.offender, error.problem, expected=error.expected, remedy=error.remedy
            ) from None

    def _refuse(self, offender: str, problem: str, **more: str) -> ArmguardError:
        return ArmguardError(f"{self._path}: {offender}", problem, **more)


def _shorten(error: Exception) -> str:
    """The first line of an error's message; its name if the message is empty."""
    return str(error).partition("\n")[0] or type(error).__name__
