"""Reads a recording: up to its end, or as far as it goes.

A file whose writer was killed has no end. It is read from the front, record by record, up to the
last that is whole, and so needs no index.
"""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from armguard.exceptions import ArmguardError
from armguard.recording.events import FORMAT, PREFIX, TOPICS, Event
from armguard.recording.json_form import read_json
from armguard.recording.recorder import check_installed

LONGEST_RECORD = 256 * 1024 * 1024
"""Bytes; what is said to be longer is damaged."""

MAGIC = b"\x89MCAP0\r\n"

_FRAME = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")

_KINDS = {PREFIX + topic: kind for kind, topic in TOPICS.items()}


class TimedEvent(NamedTuple):
    """An event, and when it was recorded."""

    nanoseconds: int
    """Since 1970."""
    event: Event
    data: bytes
    """As it stands in the file."""


class Recording:
    """A recording that was opened; iterating over `events` reads it from the front.

    Args:
        path: The file.

    Attributes:
        path: The file.
        provenance: What the recorded verdicts rest on; see `provenance.NAMES`.
        settings: What the monitor and its table were made with.
        robot: The arm, as plain data.
        is_cut_off: Whether the file ends without an end; known once all events were read.

    Raises:
        ArmguardError: The file cannot be read, is no recording of armguard, or one of a later
            version, or the packages for recordings are missing.
    """

    def __init__(self, path: str | Path) -> None:
        check_installed()
        self.path = Path(path)
        self.is_cut_off = False
        self.provenance: dict[str, str] = {}
        attached: dict[str, bytes] = {}
        for kind, record in self._read_records():
            if kind == "metadata" and record.name == "armguard":
                self.provenance = dict(record.metadata)
                self._check_format(self.provenance.get("format", ""))
            elif kind == "attachment":
                attached[record.name] = record.data
            elif kind == "message":
                break
            if self.provenance and {"settings.json", "robot.json"} <= set(attached):
                break
        if not self.provenance:
            raise ArmguardError(
                str(self.path),
                "is no recording of armguard",
                expected="what --record wrote",
                remedy="recordings of others need --cell and --topics",
            )
        try:
            self.settings: dict[str, Any] = msgspec.json.decode(attached["settings.json"])
            self.robot: dict[str, Any] = msgspec.json.decode(attached["robot.json"])
        except (KeyError, ValueError):
            raise ArmguardError(
                str(self.path),
                "ends before what the monitor was made with",
                expected="a recording that was written for at least a second",
            ) from None

    def events(self) -> Iterator[TimedEvent]:
        """All events, in order.

        Raises:
            ArmguardError: One of them is not as this version writes it.
        """
        channels: dict[int, type[Event] | None] = {}
        for name, record in self._read_records():
            if name == "channel":
                number, topic = record
                channels[number] = _KINDS.get(topic)
            elif name == "message":
                number, nanoseconds, data = record
                kind = channels.get(number)
                if kind is None:
                    continue
                try:
                    event = read_json(kind, data)
                except ValueError as error:
                    raise ArmguardError(
                        str(self.path), f"has a message that cannot be read ({error})"
                    ) from None
                yield TimedEvent(nanoseconds, event, data)

    def _check_format(self, found: str) -> None:
        if not found.isdecimal():
            raise ArmguardError(str(self.path), f"has format {found!r}", expected="a number")
        if int(found) != FORMAT:
            version = self.provenance.get("armguard", "unknown")
            age = "a newer" if int(found) > FORMAT else "an older"
            raise ArmguardError(
                str(self.path),
                f"is of {age} version of armguard (format {found})",
                expected=f"format {FORMAT}",
                remedy=f"replay it with the version that wrote it, armguard {version}",
            )

    def _read_records(self) -> Iterator[tuple[str, Any]]:
        """Metadata, attachments, topics of channels, and messages, each with its name.

        Of a message channel, time and data; of a channel its number and topic.
        """
        import zstandard
        from mcap.data_stream import ReadDataStream
        from mcap.exceptions import McapError
        from mcap.opcode import Opcode
        from mcap.records import Attachment, Channel, Chunk, Metadata
        from mcap.stream_reader import get_chunk_data_stream

        try:
            for opcode, content in self._read_frames():
                if opcode == Opcode.METADATA:
                    yield "metadata", Metadata.read(ReadDataStream(io.BytesIO(content)))
                elif opcode == Opcode.ATTACHMENT:
                    if zlib.crc32(content[:-4]) != int.from_bytes(content[-4:], "little"):
                        raise ValueError("an attachment has another check sum")
                    yield "attachment", Attachment.read(ReadDataStream(io.BytesIO(content)))
                elif opcode == Opcode.CHUNK:
                    chunk = Chunk.read(ReadDataStream(io.BytesIO(content)))
                    stream, size = get_chunk_data_stream(chunk, validate_crc=True)
                    for inner, part in _split(stream.read(size)):
                        if inner == Opcode.MESSAGE:
                            channel, _, nanoseconds, _ = _MESSAGE.unpack_from(part)
                            data = bytes(part[_MESSAGE.size :])
                            yield "message", (channel, nanoseconds, data)
                        elif inner == Opcode.CHANNEL:
                            found = Channel.read(ReadDataStream(io.BytesIO(part)))
                            yield "channel", (found.id, found.topic)
                elif opcode == Opcode.DATA_END:
                    return
        except (McapError, ValueError, LookupError, struct.error, zstandard.ZstdError) as error:
            raise ArmguardError(str(self.path), f"is damaged ({error})") from None
        self.is_cut_off = True

    def _read_frames(self) -> Iterator[tuple[int, bytes]]:
        """Opcode and content of each record that is whole."""
        try:
            with self.path.open("rb") as file:
                start = file.read(len(MAGIC))
                if start != MAGIC:
                    problem = "is empty" if not start else "is no MCAP file"
                    raise ArmguardError(str(self.path), problem, expected="a recording of armguard")
                while True:
                    header = file.read(_FRAME.size)
                    if len(header) < _FRAME.size:
                        return
                    opcode, length = _FRAME.unpack(header)
                    if length > LONGEST_RECORD:
                        raise ValueError(f"a record is {length} bytes long")
                    content = file.read(length)
                    if len(content) < length:
                        return
                    yield opcode, content
        except OSError as error:
            raise ArmguardError(str(self.path), f"cannot be read ({error.strerror})") from None


def _split(content: bytes) -> Iterator[tuple[int, memoryview]]:
    """Opcode and content of each record in a chunk."""
    view, place = memoryview(content), 0
    while place < len(view):
        opcode, length = _FRAME.unpack_from(view, place)
        place += _FRAME.size
        if length > len(view) - place:
            raise ValueError("a record is longer than its chunk")
        yield opcode, view[place : place + length]
        place += length
