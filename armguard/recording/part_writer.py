"""One MCAP file of a recording: channels, messages in chunks, and a link behind each chunk."""

from __future__ import annotations

from typing import Any

import msgspec

from armguard.recording.chain import ChainedFile, File, Signer
from armguard.recording.events import KINDS, PREFIX, TOPICS, schema_name
from armguard.recording.json_form import make_schema
from armguard.recording.scene import SCENE_SCHEMA, SceneUpdate

CHUNK_SIZE = 1024 * 1024
"""Bytes of messages after which a chunk is ended sooner."""

SCENE = len(KINDS)
"""Channel of the scene; that of a message is the place of its kind in `KINDS`."""


class PartWriter:
    """Writes one file.

    Args:
        file: Takes the bytes.
        part: Number of the file in its run, from 1.
        before: Head of the last link of the part before; `chain.FIRST` where there is none.
        signer: Signs the head of each link; None: nobody does.
    """

    def __init__(self, file: File, part: int, before: str, signer: Signer | None) -> None:
        # Here, since most of armguard works without recordings.
        from mcap.writer import CompressionType, IndexType, Writer

        self._file = ChainedFile(file, part, before, signer)
        # Its types are incomplete, and it needs no more of a file than this one has.
        self._writer: Any = Writer(
            self._file,  # type: ignore[arg-type]
            chunk_size=2**63,  # a chunk ends where its link is written
            compression=CompressionType.ZSTD,
            index_types=IndexType.ALL,
        )
        self._writer.start(profile="", library="armguard")
        self._channels = [
            self._register(PREFIX + TOPICS[kind], schema_name(kind), make_schema(kind))
            for kind in KINDS
        ]
        self._channels.append(
            self._register(f"{PREFIX}scene", SCENE_SCHEMA, make_schema(SceneUpdate))
        )
        self._count = self._size = 0
        self._begin = self._end = 0
        self._is_begun = False

    @property
    def head(self) -> str:
        """Head of the last link."""
        return self._file.head

    def note(self, name: str, content: dict[str, str]) -> None:
        """Write metadata, in front of all messages."""
        self._writer.add_metadata(name, content)

    def attach(self, nanoseconds: int, name: str, media_type: str, content: bytes) -> None:
        """Write an attachment, in front of all messages."""
        self._writer.add_attachment(nanoseconds, nanoseconds, name, media_type, content)

    def write(self, channel: int, nanoseconds: int, data: bytes) -> None:
        """Write a message.

        Args:
            channel: Place of its kind in `KINDS`, or `SCENE`.
            nanoseconds: When it came, since 1970.
            data: As JSON.
        """
        if not self._is_begun:
            self._is_begun = True
            self._begin = self._end = nanoseconds
            self._add_link()
        if not self._size:
            self._begin = nanoseconds
        self._end = nanoseconds
        self._count += 1
        self._size += len(data)
        self._writer.add_message(
            self._channels[channel],
            nanoseconds,
            data,
            nanoseconds,
            sequence=self._count & 0xFFFFFFFF,
        )
        if self._size > CHUNK_SIZE:
            self.end_chunk()

    def end_chunk(self) -> None:
        """End the chunk, if there is one, and write its link."""
        if self._size:
            self._size = 0
            self._writer.flush()
            self._add_link()

    def close(self, next_file: str = "") -> None:
        """End the file.

        Args:
            next_file: Name of the file in which the run goes on; empty: it ends here.
        """
        self.end_chunk()
        self._file.close(self._writer, self._end, next_file)

    def _add_link(self) -> None:
        self._file.add_link(self._writer, self._begin, self._end)

    def _register(self, topic: str, name: str, schema: dict[str, Any]) -> int:
        number = self._writer.register_schema(name, "jsonschema", msgspec.json.encode(schema))
        return self._writer.register_channel(topic, "json", number)
