"""Reads a recording through all its files, up to its end or its last whole record.

A file whose writer was killed has no end. It is read from the front, record by record, up to the
last whole one, so it needs no index.
"""

from __future__ import annotations

import io
import re
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from armguard.exceptions import ArmguardError
from armguard.recording.chain import LINK
from armguard.recording.events import FORMAT, PREFIX, TOPICS, Event
from armguard.recording.json_form import read_json
from armguard.recording.parts import find_part
from armguard.recording.recorder import check_installed

LONGEST_RECORD = 256 * 1024 * 1024
"""Longest record, in bytes; a longer one is damaged."""

MAGIC = b"\x89MCAP0\r\n"

FRAME = struct.Struct("<BQ")
"""Opcode and length in front of each record."""

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
        provenance: Versions and machine of the recorded verdicts; see `provenance.NAMES`.
        settings: Settings of the monitor and its table.
        robot: The arm, as plain data.
        is_cut_off: Whether the file ends without an end, or the file in which it goes on is
            missing; known once all events were read.

    Raises:
        ArmguardError: The file cannot be read, is no recording of armguard, or one of a later
            version, or the packages for recordings are missing.
    """

    def __init__(self, path: str | Path) -> None:
        check_installed()
        from mcap.records import Attachment, Message, Metadata

        self.path = Path(path)
        self.is_cut_off = False
        self.provenance: dict[str, str] = {}
        attached: dict[str, bytes] = {}
        for record in self._read_records(self.path):
            if isinstance(record, Metadata) and record.name == "armguard":
                self.provenance = dict(record.metadata)
                self._check_part(self.provenance.pop("part", "1"))
                self._check_format(self.provenance.get("format", ""))
            elif isinstance(record, Attachment):
                attached[record.name] = record.data
            elif isinstance(record, Message):
                break
            if self.provenance and {"settings.json", "robot.json"} <= set(attached):
                break
        if not self.provenance:
            raise ArmguardError(
                str(self.path),
                "is no recording of armguard",
                expected="a file from --record",
                remedy="recordings of other programs need --cell and --topics",
            )
        try:
            self.settings: dict[str, Any] = msgspec.json.decode(attached["settings.json"])
            self.robot: dict[str, Any] = msgspec.json.decode(attached["robot.json"])
        except (KeyError, ValueError):
            raise ArmguardError(
                str(self.path),
                "ends before the settings of the monitor",
                expected="a recording that was written for at least a second",
            ) from None

    def events(self) -> Iterator[TimedEvent]:
        """All events, in order, also those of the files in which the recording goes on.

        Raises:
            ArmguardError: One of them is not as this version writes it.
        """
        from mcap.records import Channel, Message

        channels: dict[int, type[Event] | None] = {}
        for record in self._read_parts():
            if isinstance(record, Channel):
                channels[record.id] = _KINDS.get(record.topic)
            elif isinstance(record, Message):
                kind = channels.get(record.channel_id)
                if kind is None:
                    continue
                try:
                    event = read_json(kind, record.data)
                except ValueError as error:
                    raise ArmguardError(
                        str(self.path), f"has a message that cannot be read ({error})"
                    ) from None
                yield TimedEvent(record.log_time, event, record.data)

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

    def _check_part(self, part: str) -> None:
        if part != "1":
            raise ArmguardError(
                str(self.path),
                f"is part {part} of a recording",
                expected="its first part: a replay needs all parts",
                remedy="`armguard replay --verify` takes any part",
            )

    def _read_parts(self) -> Iterator[Any]:
        """Records of the file, and of those in which the recording goes on."""
        from mcap.records import Metadata

        path, part = self.path, 1
        while True:
            goes_on = False
            for record in self._read_records(path):
                if isinstance(record, Metadata) and record.name == LINK:
                    goes_on = bool(record.metadata.get("next"))
                yield record
            if not goes_on:
                return
            part += 1
            path = find_part(self.path, 1, part)
            if not path.is_file():
                self._check_nothing_follows(part)
                self.is_cut_off = True
                return

    def _check_nothing_follows(self, part: int) -> None:
        """Raise ArmguardError if a part is missing, and a later one is there."""
        name = re.escape(self.path.stem) + r"\.([1-9]\d*)" + re.escape(self.path.suffix)
        files = [re.fullmatch(name, file.name) for file in self.path.parent.iterdir()]
        later = sorted(int(file[1]) for file in files if file is not None and int(file[1]) > part)
        if later:
            raise ArmguardError(
                str(find_part(self.path, 1, part)),
                f"is missing, but part {later[0]} is there",
                expected="all parts of the run",
                remedy="`armguard replay --verify` checks the parts that are left",
            )

    def _read_records(self, path: Path) -> Iterator[Any]:
        """Metadata, attachments, and what is in chunks, as the package mcap has them."""
        import zstandard
        from mcap.data_stream import ReadDataStream
        from mcap.exceptions import McapError
        from mcap.opcode import Opcode
        from mcap.records import Attachment, Chunk, Metadata
        from mcap.stream_reader import breakup_chunk

        try:
            for opcode, content in self._read_frames(path):
                stream = ReadDataStream(io.BytesIO(content))
                if opcode == Opcode.METADATA:
                    yield Metadata.read(stream)
                elif opcode == Opcode.ATTACHMENT:
                    if zlib.crc32(content[:-4]) != int.from_bytes(content[-4:], "little"):
                        raise ValueError("an attachment has a wrong check sum")
                    yield Attachment.read(stream)
                elif opcode == Opcode.CHUNK:
                    yield from breakup_chunk(Chunk.read(stream), validate_crc=True)
                elif opcode == Opcode.DATA_END:
                    return
        except (
            McapError,
            ValueError,
            LookupError,
            OverflowError,  # by a length that no file has
            struct.error,
            zstandard.ZstdError,
        ) as error:
            raise ArmguardError(str(path), f"is damaged ({error})") from None
        self.is_cut_off = True

    def _read_frames(self, path: Path) -> Iterator[tuple[int, bytes]]:
        """Opcode and content of each record that is whole."""
        try:
            with path.open("rb") as file:
                start = file.read(len(MAGIC))
                if path != self.path and start != MAGIC and MAGIC.startswith(start):
                    return  # what wrote it was killed as soon as it was there
                if start != MAGIC:
                    problem = "is empty" if not start else "is no MCAP file"
                    raise ArmguardError(str(path), problem, expected="a recording of armguard")
                while True:
                    header = file.read(FRAME.size)
                    if len(header) < FRAME.size:
                        return
                    opcode, length = FRAME.unpack(header)
                    if length > LONGEST_RECORD:
                        raise ValueError(f"a record is {length} bytes long")
                    content = file.read(length)
                    if len(content) < length:
                        return
                    yield opcode, content
        except OSError as error:
            raise ArmguardError(str(path), f"cannot be read ({error.strerror})") from None
