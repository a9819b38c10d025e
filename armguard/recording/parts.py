"""The files of one run: a long recording goes on in further parts, and old ones are removed.

Part 1 of run.mcap is that file itself, and the others are run.2.mcap, run.3.mcap and so on.
"""

from __future__ import annotations

import math
import os
import re
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from armguard.exceptions import ArmguardError

_NAMED_BY_TIME = re.compile(r"armguard-\d{8}T\d{6}-\d+(\.\d+)?\.mcap")
"""Names that `name_by_time` gives, and those of further parts."""


class Rotation(NamedTuple):
    """When a recording goes on in another file, and how long files are kept."""

    duration: float | None = None
    """Longest part, in [s]; None: there is no limit."""
    size: float | None = None
    """Size of a part, in [bytes], from which on the next one begins; None: there is no limit. A
    part may be larger by what comes within half a second."""
    keep: float | None = None
    """How long a file is kept after its last change, in [s]; None: for ever."""

    def check(self) -> None:
        """Refuse times and sizes that are none.

        Raises:
            ArmguardError: One is not above 0.
        """
        for name, value in self._asdict().items():
            if value is not None and not 0.0 < value < math.inf:
                raise ArmguardError(f"rotation.{name}", f"is {value}", expected="a number above 0")


NO_ROTATION = Rotation()


def name_by_time() -> str:
    """The name of a file of a folder; a service that starts anew may do so within a second."""
    return f"{time.strftime('armguard-%Y%m%dT%H%M%S')}-{os.getpid()}.mcap"


def find_part(path: Path, part: int, number: int) -> Path:
    """Another part of a run.

    Args:
        path: A part.
        part: Its number, from 1.
        number: Of the other one.
    """
    stem = path.stem if part == 1 else path.stem.removesuffix(f".{part}")
    return path.with_name(
        f"{stem}{path.suffix}" if number == 1 else f"{stem}.{number}{path.suffix}"
    )


def is_begun(path: Path) -> bool:
    """Whether there is something in a file; one whose writer was killed at once is empty."""
    return path.is_file() and path.stat().st_size > 0


def open_file(path: Path) -> int:
    """Open a file for writing, and see to it that a power cut leaves its name; its descriptor.

    Raises:
        OSError: It cannot be.
    """
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o644)
    folder = os.open(path.parent, os.O_RDONLY | os.O_CLOEXEC)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)
    return descriptor


def remove_old(path: Path, part: int, keep: float) -> Iterator[str]:
    """Remove recordings that were kept for long enough; their names.

    These are earlier parts of the present run, and in its folder all files that are named by the
    time, as runs are that record into a folder.

    Args:
        path: The present part, which stays.
        part: Its number, from 1.
        keep: How long a file is kept after its last change, in [s].
    """
    latest = time.time() - keep
    run = {find_part(path, part, number).name for number in range(1, part)}
    for one in sorted(path.parent.glob("*.mcap")):
        if one == path or not (one.name in run or _NAMED_BY_TIME.fullmatch(one.name)):
            continue
        try:
            if one.stat().st_mtime < latest:
                one.unlink()
                yield one.name
        except OSError as error:
            yield f"{one.name} (not possible: {error.strerror})"
