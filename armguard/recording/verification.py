"""Verifies that a recording is unchanged: its chain of links, its signatures, its end.

After a damaged link or length, the next link is searched for and checked like all others. So each
finding names the chunk and when it was recorded.
"""

from __future__ import annotations

import hashlib
import itertools
import mmap
from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import NamedTuple

from armguard.exceptions import ArmguardError
from armguard.recording.chain import FIRST, LINK, Link, read_link
from armguard.recording.parts import find_part
from armguard.recording.reading import FRAME, LONGEST_RECORD, MAGIC
from armguard.recording.recorder import check_installed
from armguard.recording.signing import is_signed

_METADATA = 12
"""Opcode of a metadata record in MCAP files."""
_LOSS = "if a power cut or a kill ended it, at most its last second is lost"
_NAME = len(LINK).to_bytes(4, "little") + LINK.encode()


class Verification(NamedTuple):
    """Results of one file."""

    path: Path
    part: int
    """Number of the file in its run, from 1."""
    chunks: int
    """Number of unchanged chunks."""
    problems: tuple[str, ...]
    """Changes, missing parts and misplaced parts, in words; empty: none."""
    is_ended: bool
    """Whether the end is there. Otherwise the writer was killed, or the end was cut off."""
    last: int
    """When the last message came that the chain holds, in [ns] since 1970; 0: there is none."""
    keys: tuple[str, ...]
    """Public keys whose signatures were found, in hexadecimal digits."""
    signer: str
    """The key of the last link; empty: it is not signed."""
    head: str
    """Head of the last link."""
    next: str
    """Name of the file in which the run goes on; empty: in none, as far as this file tells."""

    @property
    def is_intact(self) -> bool:
        """Whether there are no findings, and the end is there."""
        return self.is_ended and not self.problems


class _Found(NamedTuple):
    """A link, and where it stands in the file."""

    link: Link
    begin: int
    end: int
    is_content_right: bool


class _NothingWholeError(ArmguardError):
    """A file of which not even the beginning is there, as a power cut may leave it."""


def verify(path: str | Path, key: str | None = None) -> list[Verification]:
    """Verify a recording, and all files in which it goes on.

    If the first result is of a later part, the parts before it are not verified.

    Args:
        path: The file, which may be any part of a run.
        key: Public key whose signature each link must have, in hexadecimal digits; None: any, or
            none, is enough.

    Raises:
        ArmguardError: The file cannot be read, is no MCAP file, or has no chain, as those of
            earlier versions.
    """
    check_installed()
    results = [_verify_file(Path(path), key, None)]
    while (before := results[-1]).next:
        # By its number, not by its name in the file: the run may have been renamed as a whole.
        further = find_part(before.path, before.part, before.part + 1)
        try:
            if further.exists():
                results.append(_verify_file(further, key, before))
                continue
            problem = "is missing"
        except _NothingWholeError as error:
            problem = f"{error.problem}; {_LOSS}"
        # What stands in the files before is no less certain for it.
        problem = f"{further.name}, in which the recording goes on, {problem}"
        results.append(
            Verification(further, before.part + 1, 0, (problem,), False, 0, (), "", before.head, "")
        )
    last = results[-1]
    further = find_part(last.path, last.part, last.part + 1)
    if not last.is_ended and further.is_file() and further.stat().st_size:
        problem = f"{further.name} is there, and was not verified"
        results[-1] = last._replace(problems=(*last.problems, problem))
    return results


def _verify_file(path: Path, key: str | None, before: Verification | None) -> Verification:
    try:
        with path.open("rb") as file:
            start = file.read(len(MAGIC))
            if start != MAGIC:
                problem = "is no MCAP file" if start else "is empty"
                raise _NothingWholeError(str(path), problem, expected="a recording of armguard")
            with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
                return _verify_bytes(path, data, key, before)
    except OSError as error:
        raise ArmguardError(str(path), f"cannot be read ({error.strerror})") from None


def _verify_bytes(
    path: Path, data: mmap.mmap, key: str | None, before: Verification | None
) -> Verification:
    found = list(_list_links(data))
    if not found:
        raise _NothingWholeError(
            str(path),
            "has no chain that could be verified",
            expected="a recording of this version with its first chunk",
        )
    links = [one.link for one in found]
    problems = [
        f"{_name(one.link)}: its bytes were changed" for one in found if not one.is_content_right
    ]
    problems += _check_order(links)
    problems += _check_heads(links, before)
    problems += _check_signatures(links, key, before)
    last = found[-1]
    rest = data[last.end :]
    is_ended = bool(last.link.tail) and rest.endswith(MAGIC)
    if not last.link.tail:
        left = f"; {len(rest)} bytes after it are not a whole chunk" if rest else ""
        name = _name(last.link)
        problems.append(f"the end is missing; the last whole part is {name}{left}; {_LOSS}")
    elif not is_ended:
        problems.append("the index at the end of the file was cut off; no chunk is lost")
    elif hashlib.sha256(rest).hexdigest() != last.link.tail:
        problems.append("the index at the end of the file: its bytes were changed")
    numbers = {one.link.chunk for one in found if one.is_content_right and not one.link.tail}
    return Verification(
        path,
        # What a file says of itself must not lead to files of another run.
        last.link.part if before is None else before.part + 1,
        len(numbers - {0}),
        tuple(problems),
        is_ended,
        last.link.end,
        tuple(dict.fromkeys(link.key for link in links if link.key)),
        last.link.key,
        last.link.head,
        last.link.next,
    )


def _list_links(data: mmap.mmap) -> Iterator[_Found]:
    """All links of a file, in the order in which they stand."""
    begin = 0
    while (found := _find_link(data, begin)) is not None:
        link, start, end = found
        content = hashlib.sha256(memoryview(data)[begin:start]).hexdigest()
        yield _Found(link, start, end, content == link.content)
        if link.tail:
            return
        begin = end


def _find_link(data: mmap.mmap, begin: int) -> tuple[Link, int, int] | None:
    """The next link, with where it begins and ends; None: there is none."""
    place = begin or len(MAGIC)
    while (end := _find_end(data, place)) is not None:
        link = _read_link(data, place, end)
        if link is not None:
            return link, place, end
        place = end
    # The lengths of records lead no farther, since one was changed, or the file was cut off.
    place = begin
    while (place := data.find(_NAME, place)) >= 0:
        start = place - FRAME.size
        end = _find_end(data, start)
        link = None if end is None else _read_link(data, start, end)
        if link is not None and end is not None:
            return link, start, end
        place += 1
    return None


def _find_end(data: mmap.mmap, place: int) -> int | None:
    """Where a record ends; None: nothing that begins there is a whole record."""
    if not len(MAGIC) <= place <= len(data) - FRAME.size:
        return None
    opcode, length = FRAME.unpack_from(data, place)
    end = place + FRAME.size + length
    return int(end) if opcode and length <= LONGEST_RECORD and end <= len(data) else None


def _read_link(data: mmap.mmap, begin: int, end: int) -> Link | None:
    if data[begin] != _METADATA:
        return None
    try:
        return read_link(data[begin + FRAME.size : end])
    except Exception:
        return None  # it is not as it was written, and the chunk in front of it has no link


def _check_order(links: list[Link]) -> Iterator[str]:
    """Chunks that are missing, or stand in another place."""
    numbers = [link.chunk for link in links]
    places = sorted(numbers)
    known = {link.chunk: link for link in links}
    for near, far in itertools.pairwise([-1, *places]):
        if far == near and near >= 0:
            yield f"chunk {near}: it occurs {numbers.count(near)} times"
        elif far > near + 1:
            since = _tell(known[near].end) if near in known else "the beginning"
            names = f"chunk {near + 1}" if far == near + 2 else f"chunks {near + 1} to {far - 1}"
            yield (
                f"{names}, recorded from {since} to {_tell(known[far].begin)}: missing, or without "
                "a link"
            )
    for link, number in zip(links, places, strict=True):
        if link.chunk != number:
            yield f"{_name(link)}: it is at the place of chunk {number}"


def _check_heads(links: list[Link], before: Verification | None) -> Iterator[str]:
    """Links that do not belong to the one in front of them.

    Missing and misplaced links are found by their numbers.
    """
    first = links[0]
    if before is not None and first.part != before.part + 1:
        known = f"{before.path.name} is part {before.part}"
        yield f"the beginning: it is of part {first.part}, and {known}"
    if first.chunk == 0:
        if before is not None and first.before != before.head:
            yield f"the beginning: it does not go on from the file before, {before.path.name}"
        elif before is None and (first.part < 1 or (first.part == 1) != (first.before == FIRST)):
            other = "none" if first.before == FIRST else "another file"
            yield f"the beginning: it says that it is part {first.part}, and goes on from {other}"
    for one, two in itertools.pairwise(links):
        if two.part != one.part:
            yield f"{_name(two)}: it is of part {two.part}"
        elif two.chunk == one.chunk + 1 and two.before != one.head:
            yield f"{_name(two)}: its link, or the one before, was changed"


def _check_signatures(
    links: list[Link], key: str | None, before: Verification | None
) -> Iterator[str]:
    """Links whose signature is missing or wrong, and links where the signing key changes."""
    last = links[0].key if before is None else before.signer
    for link in links:
        if link.key and not is_signed(link.key, link.signature, link.head):
            yield f"{_name(link)}: its signature is wrong"
        elif key is not None and link.key != key:
            yield f"{_name(link)}: it is {_tell_signer(link.key)}"
        elif key is None and link.key != last:
            signers = f"{_tell_signer(link.key)}, and what stands before is {_tell_signer(last)}"
            yield f"{_name(link)}: it is {signers}"
        last = link.key


def _tell_signer(key: str) -> str:
    return f"signed by {key}" if key else "not signed"


def _name(link: Link) -> str:
    """A chunk in words, with its time."""
    if link.tail:
        return f"the end, at {_tell(link.end)}"
    if link.chunk == 0:
        return "the part before all chunks"
    return f"chunk {link.chunk}, recorded from {_tell(link.begin)} to {_tell(link.end)}"


def _tell(nanoseconds: int) -> str:
    try:
        return datetime.fromtimestamp(nanoseconds * 1e-9).isoformat(" ", "milliseconds")
    except (ValueError, OverflowError, OSError):
        return f"{nanoseconds} ns"
