"""Rows of a study, measured one by one: kept as they come, so that a study can be gone on with.

A row is plain data, which msgpack knows, whatever place it was measured in, so that it is the same
to the bit whether it comes from this process, from another machine, or from an earlier run.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import platform
import tempfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Protocol

import msgspec
import numpy as np
from numpy.typing import NDArray

from armguard.exceptions import ArmguardError
from armguard.recording.provenance import describe_software

Row = dict[str, Any]
"""What was measured, as plain data."""

Measure = Callable[..., Row]
"""Measures a row, given what all rows share and the arguments of its task; importable by name."""

Tell = Callable[[str, float], None]
"""Is told what is done, and which share of that is done."""

MACHINE = "machine"
"""Field of a row that is added: where it was measured, as times of different places differ."""

FOLDER, STUDY_FILE = "rows", "study.json"
"""Below a report: where its rows are kept, and what they are of."""

ROW_FILES = f"{'[0-9a-f]' * 16}.msgpack"
"""Pattern of the files of rows, which are named by digests."""

PART_PREFIX, PART_SUFFIX = "row-", ".part"
"""Of the file in which a row is until it is whole."""


class Place(Protocol):
    """Where rows are measured."""

    def run(
        self, measure: Measure, shared: Any, tasks: Mapping[str, tuple[Any, ...]]
    ) -> Iterator[tuple[str, Row]]:
        """Measure all, and hand over each as it comes, in whatever order.

        Args:
            measure: Is called as `measure(shared, *arguments)`.
            shared: What all have in common.
            tasks: Arguments, by name of the row.
        """
        ...


class Here:
    """This process, in which one row is measured after the other.

    Args:
        names_machine: Whether rows name their machine, as a study may be gone on with on another.
    """

    def __init__(self, *, names_machine: bool = True) -> None:
        self._names_machine = names_machine

    def run(
        self, measure: Measure, shared: Any, tasks: Mapping[str, tuple[Any, ...]]
    ) -> Iterator[tuple[str, Row]]:
        """Measure all, in their order."""
        machine = {MACHINE: name_machine()} if self._names_machine else {}
        for name, arguments in tasks.items():
            yield name, measure(shared, *arguments) | machine


class Rows:
    """Rows of one study.

    Args:
        place: Where they are measured.
        folder: Of the report, in which they are kept; None: they are not.
        study: What they are of: whatever must be the same in a study that is gone on with.
        resume: Whether rows of an earlier run are taken; else they are deleted, and they alone.

    Attributes:
        resumed: How many came from an earlier run.
        kept: How many are kept, those included.

    Raises:
        ArmguardError: The rows that are there are of another study, or cannot be read, or what is
            there is not rows.
    """

    def __init__(
        self, place: Place, folder: Path | None, study: Mapping[str, str], *, resume: bool
    ) -> None:
        self._place = place
        self._folder = None if folder is None else folder / FOLDER
        self.resumed = self.kept = 0
        if self._folder is not None:
            self._open(self._folder, dict(study), resume)

    def measure(
        self,
        measure: Measure,
        shared: Any,
        tasks: Mapping[str, tuple[Any, ...]],
        part: str,
        tell: Tell,
        place: Place | None = None,
    ) -> tuple[dict[str, Row], bool]:
        """Measure what is not there yet; all rows in the order of their tasks, and whether all are.

        Ctrl-C ends it with the rows that there are.

        Args:
            measure: Measures one; see `Place.run`.
            shared: What all have in common.
            tasks: Arguments, by name of the row.
            part: Of the study, for the progress.
            tell: Is told how far it is.
            place: Where these are measured; None: where all are.
        """
        is_whole = True
        found: dict[str, Row] = {}
        for name in tasks:
            row = self._read(name)
            if row is not None:
                found[name] = row
        self.resumed += len(found)
        self.kept += len(found)
        missing = {name: tasks[name] for name in tasks if name not in found}
        tell(part, len(found) / max(len(tasks), 1))
        try:
            for name, row in (place or self._place).run(measure, shared, missing):
                found[name] = self._keep(name, row)
                tell(f"{part}: {name}", len(found) / len(tasks))
        except KeyboardInterrupt:
            is_whole = False
        is_whole = is_whole and len(found) == len(tasks)
        return {name: found[name] for name in tasks if name in found}, is_whole

    def _open(self, folder: Path, study: dict[str, str], resume: bool) -> None:
        file = folder / STUDY_FILE
        try:
            if resume and file.is_file():
                self._check(file, study)
                return
            if folder.is_dir():
                self._clear(folder)
            folder.mkdir(parents=True, exist_ok=True)
            file.write_bytes(msgspec.json.encode(study))
        except OSError as error:
            raise ArmguardError(
                str(folder), f"rows cannot be kept there: {error.strerror}"
            ) from None

    def _clear(self, folder: Path) -> None:
        """Delete the rows of an earlier run, and nothing that is not of this module's making."""
        if not (folder / STUDY_FILE).is_file() and any(folder.iterdir()):
            raise ArmguardError(
                str(folder),
                f"holds what is no study's: there is no {STUDY_FILE} in it",
                expected="a folder that is empty or not there, to keep rows in",
                remedy="move it away, or name another folder",
            )
        # The study's own file stays until it is written anew: without it what is left of an
        # interrupted deletion would count as somebody else's.
        for pattern in (ROW_FILES, f"{PART_PREFIX}*{PART_SUFFIX}"):
            for path in folder.glob(pattern):
                path.unlink(missing_ok=True)

    def _check(self, file: Path, study: dict[str, str]) -> None:
        """Make sure that rows which are there are of this study."""
        try:
            before = msgspec.json.decode(file.read_bytes(), type=dict[str, str])
        except (msgspec.DecodeError, OSError) as error:
            raise ArmguardError("--resume", f"{file} cannot be read: {error}") from None
        for name in {**study, **before}:
            if before.get(name) != study.get(name):
                raise ArmguardError(
                    "--resume",
                    f"the rows in {file.parent} are of another study: {name} was "
                    f"{before.get(name, 'not there')}, is {study.get(name, 'not there')}",
                    remedy="leave --resume out to measure all anew, or name another folder",
                )

    def _path(self, name: str) -> Path:
        assert self._folder is not None
        return self._folder / f"{hashlib.sha256(name.encode()).hexdigest()[:16]}.msgpack"

    def _read(self, name: str) -> Row | None:
        """A row that was kept; None if there is none, or no whole one."""
        if self._folder is None:
            return None
        with contextlib.suppress(OSError, msgspec.DecodeError):
            kept = msgspec.msgpack.decode(self._path(name).read_bytes(), type=dict[str, Any])
            if kept.get("name") == name and isinstance(kept.get("row"), dict):
                row: Row = kept["row"]
                return row
        return None

    def _keep(self, name: str, row: Row) -> Row:
        content = msgspec.msgpack.encode({"name": name, "row": row})
        if self._folder is not None:
            descriptor, temporary = tempfile.mkstemp(PART_SUFFIX, PART_PREFIX, self._folder)
            try:
                with open(descriptor, "wb") as file:
                    file.write(content)
                os.replace(temporary, self._path(name))
            except OSError as error:
                raise ArmguardError(
                    str(self._folder), f"a row cannot be kept: {error.strerror}"
                ) from None
            self.kept += 1
        kept: Row = msgspec.msgpack.decode(content)["row"]
        return kept


@functools.cache
def name_machine() -> str:
    """This machine, by name and processor."""
    return f"{platform.node()} ({describe_software()['processor']})"


def pack_array(values: NDArray[Any]) -> dict[str, Any]:
    """An array as plain data, to the bit."""
    values = np.ascontiguousarray(values)
    return {"type": values.dtype.str, "shape": list(values.shape), "bytes": values.tobytes()}


def unpack_array(data: Mapping[str, Any]) -> NDArray[Any]:
    """The array that `pack_array` was given."""
    return np.frombuffer(data["bytes"], np.dtype(data["type"])).reshape(data["shape"])
