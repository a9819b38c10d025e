"""The process that writes a recording: what it finds in shared memory goes into an MCAP file.

What it has written is whole up to the last chunk, twice a second, whichever process is killed. A
disk that is slow holds up this process alone; one that is full is tried again, and again.
"""

from __future__ import annotations

import errno
import os
import signal
import sys
import time
from collections.abc import Sequence
from typing import Any

import msgspec

from armguard.messages.answers import VerdictMessage
from armguard.messages.events import StaticObstacle
from armguard.messages.incoming import ObstaclesMessage, RemoveMessage
from armguard.recording.events import KINDS, PREFIX, TOPICS, Event, JointState, schema_name
from armguard.recording.json_form import make_schema, write_json
from armguard.recording.packing import ATTACHED, NOTED, unpack_record
from armguard.recording.ring import Ring
from armguard.recording.scene import INTERVAL, SCENE_SCHEMA, Scene, SceneUpdate

FLUSH_INTERVAL = 0.5
"""Between two chunks at most, in [s]: so much is lost when this process is killed."""

CHUNK_SIZE = 1024 * 1024
"""Bytes after which a chunk is ended sooner."""

PAUSE = 0.05
"""Between two looks into the memory, in [s]: what came meanwhile is written at once, which takes
less of the processor than to wake for each event."""

UNWRITTEN_LIMIT = 8 * 1024 * 1024
"""Bytes that wait for the disk in this process; while there are more, none are taken."""

STUCK_AFTER = 2.0
"""A record that is not whole after so long, in [s], with nobody left to write, never will be."""

NICE = 10
"""Of this process: with so many others at work it still gets a tenth of a processor, twice what it
needs."""


class PatientFile:
    """A file whose writes never fail: what a disk does not take waits, and is tried again.

    Args:
        descriptor: Open for writing.

    Attributes:
        problem: Why the last write failed; empty if it did not.
    """

    def __init__(self, descriptor: int) -> None:
        self.problem = ""
        self._descriptor = descriptor
        self._unwritten = bytearray()
        self._length = 0

    @property
    def unwritten(self) -> int:
        """Bytes that wait for the disk."""
        return len(self._unwritten)

    def write(self, data: bytes) -> int:
        """Take bytes; `flush` writes them."""
        self._unwritten += data
        self._length += len(data)
        return len(data)

    def tell(self) -> int:
        """How long the file will be."""
        return self._length

    def flush(self) -> None:
        """Write what the disk takes."""
        try:
            while self._unwritten:
                written = os.write(self._descriptor, self._unwritten)
                del self._unwritten[:written]
            self._sync()
            self.problem = ""
        except OSError as error:
            problem = error.strerror or str(error)
            if problem != self.problem:
                sys.stderr.write(f"armguard: the recording cannot be written: {problem}\n")
            self.problem = problem

    def _sync(self) -> None:
        try:
            os.fdatasync(self._descriptor)
        except OSError as error:
            if error.errno not in (errno.EINVAL, errno.EROFS):  # a pipe has nothing to sync
                raise


class RecordingWriter:
    """Makes an MCAP file of events.

    Args:
        file: Takes the bytes.
    """

    def __init__(self, file: PatientFile) -> None:
        # Here, since most of armguard works without recordings.
        from mcap.writer import CompressionType, IndexType, Writer

        self._file = file
        # Its types are incomplete, and it needs no more of a file than this one has.
        self._writer: Any = Writer(
            file,  # type: ignore[arg-type]
            chunk_size=CHUNK_SIZE,
            compression=CompressionType.ZSTD,
            index_types=IndexType.ALL,
        )
        self._writer.start(profile="", library="armguard")
        self._channels = [
            self._register(PREFIX + TOPICS[kind], schema_name(kind), make_schema(kind))
            for kind in KINDS
        ]
        self._scene_channel = self._register(
            f"{PREFIX}scene", SCENE_SCHEMA, make_schema(SceneUpdate)
        )
        self._attached: dict[str, Any] = {}
        self._scene: Scene | None = None
        self._next_scene = 0
        self._last_time = 0
        self._count = 0
        self._last_state: JointState | None = None

    def take(self, record: bytes) -> None:
        """Write one message, as `Recorder` sends it."""
        kind, nanoseconds, content = unpack_record(record)
        if kind == NOTED:
            self._writer.add_metadata(*content)
            return
        if kind == ATTACHED:
            self._attach(nanoseconds, *content)
            return
        # Messages are in order in the file; their times say so as well.
        self._last_time = max(nanoseconds, self._last_time + 1)
        self._write(self._channels[kind], self._last_time, write_json(content))
        if self._scene is None:
            return
        try:
            self._follow(self._scene, content)
        except Exception as error:
            # The picture is for viewers; what a replay needs goes on without it.
            self._scene = None
            sys.stderr.write(f"armguard: the recording has no scene from here on: {error!r}\n")

    def flush(self) -> None:
        """End the chunk, and write what there is."""
        self._writer.flush()

    def finish(self) -> None:
        """End the file."""
        self._writer.finish()
        self._file.flush()

    def _register(self, topic: str, name: str, schema: dict[str, Any]) -> int:
        number = self._writer.register_schema(name, "jsonschema", msgspec.json.encode(schema))
        return self._writer.register_channel(topic, "json", number)

    def _write(self, channel: int, nanoseconds: int, data: bytes) -> None:
        self._count += 1
        self._writer.add_message(
            channel, nanoseconds, data, nanoseconds, sequence=self._count & 0xFFFFFFFF
        )

    def _attach(self, nanoseconds: int, name: str, media_type: str, content: bytes) -> None:
        self._writer.add_attachment(nanoseconds, nanoseconds, name, media_type, content)
        self._attached[name] = msgspec.json.decode(content)
        if {"robot.json", "settings.json"} <= set(self._attached):
            self._scene = Scene(self._attached["robot.json"], self._attached["settings.json"])

    def _follow(self, scene: Scene, message: Event) -> None:
        """Keep the picture of the cell up to date."""
        if isinstance(message, VerdictMessage):
            if self._last_time >= self._next_scene:
                self._next_scene = self._last_time + round(1e9 * INTERVAL)
                scene.take_level(message.level)
                if self._last_state is not None:
                    scene.take_state(self._last_state)
                picture = msgspec.json.encode(scene.draw(self._last_time))
                self._write(self._scene_channel, self._last_time, picture)
        elif isinstance(message, JointState):
            self._last_state = message
        elif isinstance(message, ObstaclesMessage):
            scene.take_update(message)
        elif isinstance(message, StaticObstacle):
            scene.take_static(message)
        elif isinstance(message, RemoveMessage):
            scene.take_removal(message)


def write_recording(ring: Ring, file: PatientFile, parent: int) -> int:
    """Write what comes until its writer says that it is done, or is gone.

    Args:
        ring: Where events come from.
        file: Where they go.
        parent: The process that writes to the ring.

    Returns:
        The exit code of the process: 0 if all could be written.
    """
    writer = RecordingWriter(file)
    flushed = moved = time.monotonic()
    while True:
        ring.beat()
        record = ring.read() if file.unwritten < UNWRITTEN_LIMIT else None
        now = time.monotonic()
        if now - flushed >= FLUSH_INTERVAL:
            writer.flush()
            flushed = now
        if record is not None:
            moved = now
            writer.take(record)
            continue
        # Asked in this order: what is found afterwards was there before.
        is_alone = os.getppid() != parent
        if ring.is_finished or (is_alone and (ring.is_empty or now - moved > STUCK_AFTER)):
            break
        time.sleep(PAUSE)
    writer.finish()
    return 1 if file.problem else 0


def give_way() -> None:
    """Let others come first, the loop among them: whatever wakes is not held up by this process.

    It may have been started by one that has real-time scheduling, and is not to keep that.
    """
    os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
    os.nice(NICE)


def main(arguments: Sequence[str]) -> int:
    """Write a recording until its end; the exit code.

    Args:
        arguments: Descriptors of the shared memory and of the file, and the parent's number.
    """
    memory, file, parent = map(int, arguments)
    # It may go to the loop as well, which is to end first: its end is to be in the file.
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    give_way()
    return write_recording(Ring(memory), PatientFile(file), parent)
