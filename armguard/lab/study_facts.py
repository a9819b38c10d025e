"""What studies have in common at the command line: progress, where rows are measured, and facts.

A study goes on, `--resume`, where all that its rows rest on is the same; processors may differ, as
they do in a cluster.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import shlex
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

from rich.progress import BarColumn, Progress, TaskProgressColumn, TimeElapsedColumn

from armguard.app import cli
from armguard.app.terminal import describe_column, make_console
from armguard.exceptions import ArmguardError
from armguard.lab.cluster import LOCAL, SOFTWARE, Cluster
from armguard.lab.rows import Here, Rows, Tell
from armguard.recording.provenance import describe_provenance, describe_software
from armguard.robot.robot import Robot

VERSIONS = ("armguard", "numpy", "numba", "llvmlite", "pinocchio", "python")
"""What a page names the versions of."""


def tell_command() -> str:
    """The command that this process was called by."""
    return shlex.join(["armguard", *sys.argv[1:]])


def describe_machine(provenance: dict[str, str]) -> str:
    """Processor, cores and system of the machine that `describe_provenance` told of."""
    return f"{provenance['processor']}, {os.cpu_count()} cores, {provenance['machine']}"


def describe_versions(provenance: dict[str, str]) -> str:
    """Versions of what `VERSIONS` names, as `describe_provenance` told them."""
    return ", ".join(f"{name} {provenance[name]}" for name in VERSIONS)


def list_facts(seed: int) -> dict[str, str]:
    """Machine, versions and seed, by name.

    Args:
        seed: Of all that was drawn at random.
    """
    provenance = describe_provenance(Robot.load("panda"))
    return {
        "machine": describe_machine(provenance),
        "versions": describe_versions(provenance),
        "seed": str(seed),
    }


def make_folder(out: Path) -> None:
    """Make the folder of a report.

    Raises:
        ArmguardError: It cannot be made, or is a file.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError):
        raise ArmguardError("--out", f"{out} is a file", expected="a folder") from None
    except OSError as error:
        raise ArmguardError("--out", f"{out} cannot be made: {error.strerror}") from None


@contextlib.contextmanager
def show_progress() -> Iterator[Tell]:
    """A bar on the terminal, gone at the end; what it is told is shown beside it."""
    columns = describe_column(), BarColumn(), TaskProgressColumn()
    with Progress(
        *columns, TimeElapsedColumn(), console=make_console(stderr=True), transient=True
    ) as progress:
        bar = progress.add_task("starting", total=1.0)

        def tell(text: str, share: float) -> None:
            progress.update(bar, description=text, completed=share)

        yield tell


def is_by_rows(wishes: cli.Tradeoff | cli.Extremes) -> bool:
    """Whether the command line asks for rows that are kept, or measured by other processes."""
    return wishes.resume or wishes.dask is not None or wishes.workers is not None


@contextlib.contextmanager
def open_rows(
    wishes: cli.Tradeoff | cli.Extremes, folder: Path | None, study: Mapping[str, str]
) -> Iterator[Rows]:
    """Rows that are measured where they are to be; kept only where that was asked for.

    Args:
        wishes: What the command line says.
        folder: Of the report; rows are kept below it.
        study: What must be the same in a study that is gone on with, beside the software.

    Raises:
        ArmguardError: No worker can be had, or rows that are there are of another study.
    """
    if not is_by_rows(wishes):
        yield Rows(Here(names_machine=False), None, {}, resume=False)
        return
    software = describe_software()
    about = {**study, **{name: software[name] for name in SOFTWARE}}
    if wishes.dask is None and wishes.workers is None:
        yield Rows(Here(), folder, about, resume=wishes.resume)
        return
    with Cluster(wishes.dask or LOCAL, wishes.workers) as cluster:
        yield Rows(cluster, folder, about, resume=wishes.resume)


def digest_file(path: Path | None) -> str:
    """A digest of a file's content; "none" where there is no file.

    Raises:
        ArmguardError: It cannot be read.
    """
    if path is None:
        return "none"
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()[:16]
    except OSError as error:
        raise ArmguardError(str(path), f"cannot be read: {error.strerror}") from None
