"""What is printed on the terminal: text as it is, for what comes from data is no markup."""

from __future__ import annotations

import contextlib
import dataclasses
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextvars import ContextVar
from pathlib import Path
from typing import Any, TextIO

import msgspec
import numpy as np
from rich.console import Console
from rich.progress import ProgressColumn, TextColumn
from rich.table import Table


def make_console(*, stderr: bool = False, soft_wrap: bool = False) -> Console:
    """A console that prints brackets as brackets, in tables as well; styles are `Text`.

    Args:
        stderr: Whether it prints on standard error.
        soft_wrap: Whether long lines are left to the terminal.
    """
    return Console(stderr=stderr, soft_wrap=soft_wrap, markup=False, highlight=False)


def make_table(
    heads: Sequence[str],
    rows: Iterable[Sequence[str]],
    *,
    title: str | None = None,
    caption: str | None = None,
) -> Table:
    """A table whose first column is of words and whose others are of numbers.

    Args:
        heads: Of its columns.
        rows: Their cells.
        title: Above it.
        caption: Below it.
    """
    first, *others = heads
    table = Table(first, title=title, caption=caption, title_justify="left", caption_justify="left")
    for head in others:
        table.add_column(head, justify="right")
    for row in rows:
        table.add_row(*row)
    return table


_report: ContextVar[TextIO | None] = ContextVar("report", default=None)
"""Standard output, where `--json` keeps it for one report."""


@contextlib.contextmanager
def keep_for_report() -> Iterator[None]:
    """Inside, standard output takes a report alone; all else that is printed goes aside.

    What a command prints for people goes to standard error then.
    """
    token = _report.set(sys.stdout)
    try:
        with contextlib.redirect_stdout(sys.stderr):
            yield
    finally:
        _report.reset(token)


def print_json(make: Callable[[], object]) -> None:
    """Print what a command has found as one JSON object, where `--json` asks for it.

    Args:
        make: Gives what was found: records, mappings, sequences, numbers, texts and paths. What is
            infinite or no number becomes null.
    """
    output = _report.get()
    if output is not None:
        output.write(msgspec.json.encode(make_plain(make())).decode() + "\n")


def make_plain(value: Any) -> Any:
    """What JSON has a name for: records as objects, arrays as lists, paths as text."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    if isinstance(value, Path):
        return str(value)
    if dataclasses.is_dataclass(value):
        value = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
    elif hasattr(value, "_asdict"):  # a NamedTuple
        value = value._asdict()
    if isinstance(value, Mapping):
        return {str(key): make_plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [make_plain(item) for item in value]
    return value


def describe_column() -> ProgressColumn:
    """The column of a progress bar that tells what is done now."""
    return TextColumn("{task.description}", markup=False)
