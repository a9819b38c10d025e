"""What studies have in common at the command line: progress, and facts for their pages."""

from __future__ import annotations

import contextlib
import os
import shlex
import sys
from collections.abc import Callable, Iterator

from rich.progress import BarColumn, Progress, TaskProgressColumn, TimeElapsedColumn

from armguard.app.terminal import describe_column, make_console
from armguard.monitor.provenance import describe_software

Tell = Callable[[str, float], None]
"""Is told what is done, and which share of that is done."""

VERSIONS = ("armguard", "numpy", "numba", "llvmlite", "pinocchio", "python")
"""What a page names the versions of."""


def tell_command() -> str:
    """The command that this process was called by."""
    return shlex.join(["armguard", *sys.argv[1:]])


def list_facts(seed: int | None = None) -> dict[str, str]:
    """Machine and versions, and the seed of all that was drawn at random, by name."""
    software = describe_software()
    facts = {
        "machine": f"{software['processor']}, {os.cpu_count()} cores, {software['machine']}",
        "versions": ", ".join(f"{name} {software[name]}" for name in VERSIONS),
    }
    return facts if seed is None else facts | {"seed": str(seed)}


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
