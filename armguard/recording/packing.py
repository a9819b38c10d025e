"""Data from the loop to the writer process: options at its start, and messages as bytes."""

from __future__ import annotations

import struct
from typing import Any

import msgspec

from armguard.messages.incoming import to_plain
from armguard.recording.events import KINDS
from armguard.recording.parts import NO_ROTATION, Rotation

ATTACHED, NOTED = range(len(KINDS), len(KINDS) + 2)
"""Instead of a kind: what stands in the file once, as an attachment or as metadata."""

_HEADER = struct.Struct("<Bq")
"""Kind of the content, by its place in `KINDS`, and when it came, in [ns] since 1970."""


class WriterOptions(msgspec.Struct, frozen=True):
    """Options of the writer process."""

    path: str
    """The first file."""
    key: str = ""
    """Secret file of the key that signs; empty: none does."""
    rotation: Rotation = NO_ROTATION
    """When the recording goes on in another file."""


_encode = msgspec.msgpack.Encoder(enc_hook=to_plain).encode

_decoders: list[msgspec.msgpack.Decoder[Any]] = [
    *map(msgspec.msgpack.Decoder, KINDS),
    *[msgspec.msgpack.Decoder()] * 2,
]


def pack_record(kind: int, came: int, content: object) -> bytes:
    """A message, or plain data, as bytes.

    Args:
        kind: Place in `KINDS`, or `ATTACHED`, or `NOTED`.
        came: When it came, in [ns] since 1970.
        content: The message, or plain data.

    Raises:
        Exception: It cannot be recorded.
    """
    return _HEADER.pack(kind, came) + _encode(content)


def unpack_record(record: bytes) -> tuple[int, int, Any]:
    """Kind, time and content of what `pack_record` made bytes of."""
    kind, came = _HEADER.unpack_from(record)
    return kind, came, _decoders[kind].decode(memoryview(record)[_HEADER.size :])
