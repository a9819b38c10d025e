"""What is printed on the terminal: text as it is, for what comes from data is no markup."""

from __future__ import annotations

import sys

import msgspec
from rich.console import Console
from rich.progress import ProgressColumn, TextColumn


def make_console(*, stderr: bool = False, soft_wrap: bool = False) -> Console:
    """A console that prints brackets as brackets, in tables as well; styles are `Text`.

    Args:
        stderr: Whether it prints on standard error.
        soft_wrap: Whether long lines are left to the terminal.
    """
    return Console(stderr=stderr, soft_wrap=soft_wrap, markup=False, highlight=False)


def print_json(report: object) -> None:
    """Print the report of a command as one JSON object, in a line of its own.

    Args:
        report: What msgspec encodes: a mapping or a record of numbers, texts, paths and the like.
    """
    sys.stdout.write(msgspec.json.encode(report).decode() + "\n")


def describe_column() -> ProgressColumn:
    """The column of a progress bar that tells what is done now."""
    return TextColumn("{task.description}", markup=False)
