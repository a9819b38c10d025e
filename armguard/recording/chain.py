"""A chain of digests through a recording, by which changes of the file are found.

A *link* follows each chunk: a metadata record that readers of MCAP files ignore. A link
holds the SHA-256 of all bytes since the link before, and the *head* of that link, the SHA-256 of
its content [HaberStornetta1991]_. So each head covers all bytes before it. The last link of a file
also holds the SHA-256 of the bytes behind it, the index and the end.

Anyone who can write the file can make another chain. A signature of each head shows who made it
(`signing`).
"""

from __future__ import annotations

import hashlib
import io
from typing import Any, NamedTuple, Protocol

import msgspec

LINK = "armguard.link"
"""Name of the metadata records that are links."""

FIRST = ""
"""Value in the first link of a run instead of the previous head."""

_DIGEST_LENGTH = hashlib.sha256().digest_size * 2
_SIGNATURE_LENGTH = 2 * 64
"""Hexadecimal digits of an Ed25519 signature."""


class Link(NamedTuple):
    """Content of a link."""

    part: int
    """Number of the file in its run, from 1."""
    chunk: int
    """Number of the chunk in its file, from 1; 0: the part before all chunks. The last link has the
    next number and no chunk."""
    begin: int
    """When the first message of the chunk came, in [ns] since 1970."""
    end: int
    """When its last message came, in [ns] since 1970."""
    content: str
    """SHA-256 of the bytes since the link before."""
    before: str
    """Head of the link before, of the run's file before where this is the first link."""
    tail: str = ""
    """SHA-256 of the bytes behind the last link; empty in all others."""
    next: str = ""
    """In the last link, the name of the file in which the run goes on; empty: it ends here."""
    key: str = ""
    """Public key of the signature; empty: there is none."""
    signature: str = ""
    """Of the head."""

    @property
    def head(self) -> str:
        """SHA-256 of the link's content, without its signature."""
        fields = self._replace(signature="")._asdict()
        return hashlib.sha256(msgspec.json.encode(fields, order="deterministic")).hexdigest()

    def to_fields(self) -> dict[str, str]:
        """The content of the metadata record."""
        return {name: str(value) for name, value in self._asdict().items()}


def read_link(record: bytes) -> Link | None:
    """The link that a metadata record is; None: it is another record.

    Args:
        record: The content of the record, without opcode and length.

    Raises:
        Exception: It is a malformed link.
    """
    from mcap.data_stream import ReadDataStream
    from mcap.records import Metadata

    name = LINK.encode()
    if not record.startswith(len(name).to_bytes(4, "little") + name):
        return None
    fields = Metadata.read(ReadDataStream(io.BytesIO(record))).metadata
    numbers = {key: int(fields[key]) for key in ("part", "chunk", "begin", "end")}
    link = Link(**{**fields, **numbers})
    if _write_record(link)[-len(record) :] != record:
        raise ValueError("a link is written in another form")
    return link


def _write_record(link: Link) -> bytes:
    from mcap.data_stream import RecordBuilder
    from mcap.records import Metadata

    builder: Any = RecordBuilder()  # its types are incomplete
    Metadata(LINK, link.to_fields()).write(builder)
    return bytes(builder.end())


class File(Protocol):
    """A sink for the bytes of a recording."""

    def write(self, data: bytes) -> int:
        """Take bytes; how many were taken."""
        ...

    def tell(self) -> int:
        """How many bytes were taken so far."""
        ...


class Signer(Protocol):
    """Signs heads."""

    @property
    def public(self) -> str:
        """Its public key, in hexadecimal digits."""
        ...

    def sign(self, head: str) -> str:
        """The signature of a head, in hexadecimal digits."""
        ...


class ChainedFile:
    """A file for a writer of MCAP that adds links.

    Args:
        file: Takes the bytes.
        part: Number of the file in its run, from 1.
        before: Head of the last link of the file before; `FIRST` where there is none.
        signer: Signs each head; None: nobody does.

    Attributes:
        head: Of the last link.
    """

    def __init__(self, file: File, part: int, before: str, signer: Signer | None) -> None:
        self.head = before
        self._file, self._part, self._signer = file, part, signer
        self._content = hashlib.sha256()
        self._chunk = 0
        self._held: bytearray | None = None
        """Bytes after the last link, held until the next link has their digest."""

    def write(self, data: bytes) -> int:
        """Take bytes of the writer's."""
        if self._held is not None:
            self._held += data
        else:
            self._content.update(data)
            self._file.write(data)
        return len(data)

    def tell(self) -> int:
        """How long the file will be."""
        return self._file.tell() + len(self._held or b"")

    def flush(self) -> None:
        """Does nothing: a chunk waits for its link."""

    def add_link(self, writer: Any, begin: int, end: int) -> None:
        """Have a link written for what was taken since the one before.

        Args:
            writer: The writer of MCAP, whose chunk is ended.
            begin: When the chunk's first message came, in [ns] since 1970.
            end: When its last message came, in [ns] since 1970.
        """
        link = self._sign(self._make_link(begin, end))
        writer.add_metadata(LINK, link.to_fields())
        self._content = hashlib.sha256()
        self.head = link.head

    def close(self, writer: Any, time: int, next_file: str) -> None:
        """Have the last link written, the index, and the end of the file.

        Args:
            writer: The writer of MCAP, whose chunk is ended and has its link.
            time: When the last message came, in [ns] since 1970.
            next_file: Name of the file in which the run goes on; empty: it ends here.
        """
        # The index holds where the last link stands, and the last link the digest of the index.
        # So the index is made first, behind a link of the same length.
        link = self._make_link(time, time)._replace(next=next_file, tail="0" * _DIGEST_LENGTH)
        if self._signer is not None:
            link = link._replace(key=self._signer.public, signature="0" * _SIGNATURE_LENGTH)
        self._held = bytearray()
        writer.add_metadata(LINK, link.to_fields())
        length = len(self._held)
        writer.finish()
        tail = bytes(self._held[length:])
        link = self._sign(link._replace(tail=hashlib.sha256(tail).hexdigest()))
        self._file.write(_write_record(link) + tail)
        self.head = link.head

    def _make_link(self, begin: int, end: int) -> Link:
        content = self._content.hexdigest()
        link = Link(self._part, self._chunk, begin, end, content, self.head)
        self._chunk += 1
        return link

    def _sign(self, link: Link) -> Link:
        if self._signer is None:
            return link
        link = link._replace(key=self._signer.public)
        return link._replace(signature=self._signer.sign(link.head))
