"""Prints on the terminal: text is printed literally, since data must not act as markup."""

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
    """A console that prints brackets literally, also in tables; styles must be `Text`.

    Args:
        stderr: Whether it prints on standard error.
        soft_wrap: Whether the terminal wraps long lines.
    """
    return Console(stderr=stderr, soft_wrap=soft_wrap, markup=False, highlight=False)


def make_table(
    heads: Sequence[str],
    rows: Iterable[Sequence[str]],
    *,
    title: str | None = None,
    caption: str | None = None,
) -> Table:
    """A table with words in its first column and numbers in the others.

    Args:
        heads: Titles of the columns.
        rows: Cells of each row.
        title: Title above the table.
        caption: Caption below the table.
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
    """Context in which standard output is reserved for the report of `--json`.

    Text for people goes to standard error.
    """
    token = _report.set(sys.stdout)
    try:
        with contextlib.redirect_stdout(sys.stderr):
            yield
    finally:
        _report.reset(token)


def print_json(make: Callable[[], object]) -> None:
    """Print the results of a command as one JSON object, if `--json` is given.

    Args:
        make: Returns the results: records, mappings, sequences, numbers, texts and paths. Infinite
            values and NaN become null.
    """
    output = _report.get()
    if output is not None:
        output.write(msgspec.json.encode(make_plain(make())).decode() + "\n")


def make_plain(value: Any) -> Any:
    """Convert to JSON types: records to objects, arrays to lists, paths to text."""
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
    """The column of a progress bar that names the current step."""
    return TextColumn("{task.description}", markup=False)
