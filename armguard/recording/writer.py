"""The writer process of a recording: moves events from shared memory into MCAP files.

Its files are whole up to the last chunk if any process is killed. Twice a second it ends the chunk
and writes all data to the disk. A slow disk delays only this process; a full disk is tried again
and again.
"""

from __future__ import annotations

import errno
import os
import signal
import sys
import time
from collections import deque
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import msgspec

from armguard.messages.answers import VerdictMessage
from armguard.messages.events import StaticObstacle
from armguard.messages.incoming import ObstaclesMessage, RemoveMessage
from armguard.recording.chain import FIRST
from armguard.recording.events import NUMBERS, Event, JointState, Log, Time
from armguard.recording.json_form import write_json
from armguard.recording.packing import ATTACHED, NOTED, WriterOptions, unpack_record
from armguard.recording.part_writer import SCENE, PartWriter
from armguard.recording.parts import find_part, open_file, remove_old
from armguard.recording.ring import Ring
from armguard.recording.scene import INTERVAL, Scene
from armguard.recording.signing import FileSigner

FLUSH_INTERVAL = 0.5
"""Greatest time between two chunks, in [s]: this much is lost when this process is killed."""

PAUSE = 0.05
"""Between two looks into the memory, in [s]: what came meanwhile is written at once, which takes
less of the processor than to wake for each event."""

UNWRITTEN_LIMIT = 8 * 1024 * 1024
"""Bytes that wait for the disk in this process; while there are more, none are taken."""

STUCK_AFTER = 2.0
"""Time after which an incomplete record of an ended writer is given up, in [s]."""

NICE = 10
"""Of this process: with so many others at work it still gets a tenth of a processor, twice what it
needs."""


class PatientFile:
    """A file whose writes never fail: bytes that the disk does not accept wait for another try.

    Args:
        descriptor: Open for writing.

    Attributes:
        problem: Why the last write failed; empty if it did not.
    """

    def __init__(self, descriptor: int) -> None:
        self.problem = ""
        self._waiting = deque([(descriptor, bytearray())])
        """Files, and bytes that wait for them; the last one is written to."""
        self._length = 0

    @property
    def unwritten(self) -> int:
        """Bytes that wait for the disk."""
        return sum(len(data) for _, data in self._waiting)

    def write(self, data: bytes) -> int:
        """Take bytes; `flush` writes them."""
        self._waiting[-1][1].extend(data)
        self._length += len(data)
        return len(data)

    def tell(self) -> int:
        """How long the file will be."""
        return self._length

    def go_on(self, descriptor: int) -> None:
        """Write to another file from now on; this one is closed once all of it is on the disk."""
        self._waiting.append((descriptor, bytearray()))
        self._length = 0

    def flush(self) -> None:
        """Write as many bytes as the disk accepts."""
        try:
            while True:
                descriptor, data = self._waiting[0]
                while data:
                    del data[: os.write(descriptor, data)]
                _sync(descriptor)
                if len(self._waiting) == 1:
                    break
                self._waiting.popleft()
                os.close(descriptor)
            self.problem = ""
        except OSError as error:
            problem = error.strerror or str(error)
            if problem != self.problem:
                sys.stderr.write(f"armguard: the recording cannot be written: {problem}\n")
            self.problem = problem


def _sync(descriptor: int) -> None:
    try:
        os.fdatasync(descriptor)
    except OSError as error:
        if error.errno not in (errno.EINVAL, errno.EROFS):  # a pipe has nothing to sync
            raise


class RecordingWriter:
    """Makes MCAP files of events.

    Args:
        file: Takes the bytes.
        options: What else it is told.
    """

    def __init__(self, file: PatientFile, options: WriterOptions) -> None:
        self._file = file
        self._path, self._rotation = Path(options.path), options.rotation
        self._signer = FileSigner(options.key) if options.key else None
        self._part = 1
        self._begun: float | None = None
        self._writer = PartWriter(file, 1, FIRST, self._signer)
        self._start: list[tuple[int, int, Any]] = []
        """Records at the start of each part: kind, time and content."""
        self._attached: dict[str, Any] = {}
        self._scene: Scene | None = None
        self._next_scene = 0
        self._last_time = 0
        self._last_state: JointState | None = None
        self._problem = ""

    def take(self, record: bytes) -> None:
        """Write one message, as `Recorder` sends it."""
        kind, nanoseconds, content = unpack_record(record)
        if kind in (ATTACHED, NOTED):
            self._start.append((kind, nanoseconds, content))
            self._write_start(kind, nanoseconds, content)
            if kind == ATTACHED:
                self._look_at(*content)
            return
        # Messages are in order in the file; their times say so as well.
        self._last_time = max(nanoseconds, self._last_time + 1)
        self._writer.write(kind, self._last_time, write_json(content))
        if self._scene is None:
            return
        try:
            self._follow(self._scene, content)
        except Exception as error:
            # The picture is for viewers; what a replay needs goes on without it.
            self._scene = None
            sys.stderr.write(f"armguard: the scene of the recording ends here: {error!r}\n")

    def flush(self, now: float) -> None:
        """End the chunk, write all bytes, and continue in another file if that is due.

        Args:
            now: Time in [s], of a clock that never goes back.
        """
        self._writer.end_chunk()
        self._file.flush()
        if self._begun is None:
            self._begun = now
            self._remove_old()
        duration, size, _ = self._rotation
        is_long = duration is not None and now - self._begun >= duration
        if is_long or (size is not None and self._file.tell() >= size):
            self._go_on(now)

    def finish(self) -> None:
        """End the file."""
        self._writer.close()
        self._file.flush()

    def _go_on(self, now: float) -> None:
        """Continue in another file; if that cannot be made, continue in this one."""
        path = find_part(self._path, 1, self._part + 1)
        try:
            if path.exists():
                raise FileExistsError(errno.EEXIST, "is there already")
            descriptor = open_file(path)
        except OSError as error:
            if not self._problem:
                self._problem = f"{path} cannot be written ({error.strerror})"
                sys.stderr.write(f"armguard: the recording stays in one file: {self._problem}\n")
            return
        self._problem = ""
        self._writer.close(path.name)
        self._file.go_on(descriptor)
        self._part, self._begun = self._part + 1, now
        self._writer = PartWriter(self._file, self._part, self._writer.head, self._signer)
        for entry in self._start:
            self._write_start(*entry)
        self._remove_old()
        self._file.flush()

    def _remove_old(self) -> None:
        """Remove files that were kept for long enough, and note their names."""
        if self._rotation.keep is None:
            return
        path = find_part(self._path, 1, self._part)
        for name in remove_old(path, self._part, self._rotation.keep):
            self._last_time += 1
            timestamp = Time(*divmod(self._last_time, 1_000_000_000))
            text = f"removed, since its time to keep has passed: {name}"
            line = Log(timestamp=timestamp, level=2, message=text)
            self._writer.write(NUMBERS[Log], self._last_time, write_json(line))

    def _write_start(self, kind: int, nanoseconds: int, content: Any) -> None:
        if kind == ATTACHED:
            self._writer.attach(nanoseconds, *content)
        else:
            name, values = content
            self._writer.note(name, values | {"part": str(self._part)})

    def _look_at(self, name: str, _: str, content: bytes) -> None:
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
                self._writer.write(SCENE, self._last_time, picture)
        elif isinstance(message, JointState):
            self._last_state = message
        elif isinstance(message, ObstaclesMessage):
            scene.take_update(message)
        elif isinstance(message, StaticObstacle):
            scene.take_static(message)
        elif isinstance(message, RemoveMessage):
            scene.take_removal(message)


def write_recording(ring: Ring, writer: RecordingWriter, file: PatientFile, parent: int) -> int:
    """Write events until the loop's process reports its end, or has ended.

    Args:
        ring: Where events come from.
        writer: Makes files of them.
        file: Where the bytes go.
        parent: The process that writes to the ring.

    Returns:
        The exit code of the process: 0 if all could be written.
    """
    flushed = moved = time.monotonic()
    while True:
        ring.beat()
        record = ring.read() if file.unwritten < UNWRITTEN_LIMIT else None
        now = time.monotonic()
        if now - flushed >= FLUSH_INTERVAL:
            writer.flush(now)
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
    """Lower the priority of this process, so that it delays neither the loop nor others.

    Its parent may have real-time scheduling, which this process must not inherit.
    """
    os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
    os.nice(NICE)


def main(arguments: Sequence[str]) -> int:
    """Write a recording until its end; the exit code.

    Args:
        arguments: Descriptors of the shared memory and of the file, the parent's number, and
            `WriterOptions` as JSON.
    """
    memory, descriptor, parent = map(int, arguments[:3])
    options = msgspec.json.decode(arguments[3], type=WriterOptions)
    # It may go to the loop as well, which is to end first: its end is to be in the file.
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    give_way()
    file = PatientFile(descriptor)
    return write_recording(Ring(memory), RecordingWriter(file, options), file, parent)
