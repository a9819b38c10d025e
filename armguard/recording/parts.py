"""The files of one run: a long recording continues in further parts, and old ones are removed.

Part 1 of run.mcap is that file itself, and the others are run.2.mcap, run.3.mcap and so on.
"""

from __future__ import annotations

import math
import os
import re
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

from armguard.exceptions import ArmguardError

FEWEST = 10
"""Files of which no earlier one is removed, however old it seems."""

FIRST_TIME = 1767225600.0
"""The year 2026 in [s] since 1970: armguard is no older, and a clock behind that was not set."""

_NAMED_BY_TIME = re.compile(r"(armguard-\d{8}T\d{6}-\d+)(?:\.(\d+))?\.mcap")
"""Names that `name_by_time` gives, and those of further parts: run and part."""


class Rotation(NamedTuple):
    """When a recording goes on in another file, and how long files are kept."""

    duration: float | None = None
    """Longest part, in [s]; None: there is no limit."""
    size: float | None = None
    """Size of a part, in [bytes], from which on the next one begins; None: there is no limit. A
    part may be larger by what comes within half a second."""
    keep: float | None = None
    """How long a file is kept after its last change at least, in [s]; None: for ever."""

    def check(self) -> None:
        """Refuse unusable times and sizes.

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


def open_file(path: Path) -> int:
    """Open a file for writing such that its name survives a power cut; returns its descriptor.

    Raises:
        OSError: The file cannot be opened.
    """
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o644)
    folder = os.open(path.parent, os.O_RDONLY | os.O_CLOEXEC)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)
    return descriptor


def remove_old(path: Path, part: int, keep: float) -> Iterator[str]:
    """Remove recordings that are older than `keep`; returns their names.

    These are earlier parts of the present run and, where that is named by the time, as runs are
    that record into a folder, all earlier files of the folder that are.

    The system clock may be wrong and may jump. So the age of a file is the sum of the time steps
    from its last change through later files to the present. Each step counts for a tenth of `keep`
    at most, a step back for nothing, and the longest not at all. So one jump makes no file older,
    and each further jump adds at most a tenth of `keep`; ten files always stay. Later files are
    those of later runs and parts, and those with later changes, as runs can record at once: a file
    must be old by both sums. By the clock a file must be as old too, and its time must be after
    2026.

    Args:
        path: The present part, which stays.
        part: Its number, from 1.
        keep: How long a file is kept after its last change, in [s].
    """
    present = time.time()
    changes: dict[Path, float] = {}
    for file in _list_earlier(path, part):
        try:
            changes[file] = file.stat().st_mtime
        except OSError as error:
            yield f"{file.name} (not possible: {error.strerror})"
    by_name = _sum_steps(changes.items(), present, keep)
    latest_first = sorted(changes.items(), key=lambda item: item[1], reverse=True)
    by_time = _sum_steps(latest_first, present, keep)
    for file, changed in changes.items():
        age = min(by_name[file], by_time[file], present - changed)
        if age >= keep and changed >= FIRST_TIME:
            try:
                file.unlink()
                yield file.name
            except OSError as error:
                yield f"{file.name} (not possible: {error.strerror})"


def _sum_steps(
    changes: Iterable[tuple[Path, float]], present: float, keep: float
) -> dict[Path, float]:
    """Ages of files by the times between their changes, as `remove_old` says, in [s]."""
    age, longest, later = 0.0, 0.0, present
    ages = {}
    for file, changed in changes:
        step = min(max(later - changed, 0.0), keep / FEWEST)
        age, longest, later = age + step, max(longest, step), changed
        ages[file] = age - longest
    return ages


def _list_earlier(path: Path, part: int) -> list[Path]:
    """Files that may be removed once they are old, the latest first."""
    if _find_place(path) is None:
        files = [find_part(path, part, number) for number in range(part - 1, 0, -1)]
        return [file for file in files if file.is_file()]
    places = {_find_place(file): file for file in path.parent.glob("*.mcap")}
    present = _find_place(path)
    earlier = [place for place in places if place and present and place < present]
    return [places[place] for place in sorted(earlier, reverse=True)]


def _find_place(path: Path) -> tuple[str, int] | None:
    """Run and part of a file that is named by the time; None: it is not."""
    found = _NAMED_BY_TIME.fullmatch(path.name)
    return None if found is None else (found[1], int(found[2] or 1))
