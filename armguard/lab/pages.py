"""What reports of studies have in common: numbers as plain data, tables, pages in Markdown, files.

A study decides on its columns and on what its page tells; how a number, a table and a page look is
decided here, once for all studies.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from armguard.exceptions import ArmguardError

JSON_FILE, PAGE = "report.json", "README.md"
"""What a report has for programs and for people, beside its table and its pictures."""

UNKNOWN = "–"
"""What people are shown instead of what is no number."""


class Column(NamedTuple):
    """A column of a table for people."""

    head: str
    fields: str
    """Names of the attributes that a cell shows, apart from each other by spaces."""
    form: str
    """How they are shown, as for `str.format`."""

    def show(self, record: object) -> str:
        """The cell of a record; `UNKNOWN` if one of its numbers is none."""
        values = [getattr(record, field) for field in self.fields.split()]
        return self.form.format(*values) if all(map(math.isfinite, values)) else UNKNOWN


def round_off(value: float) -> float | None:
    """Six digits of a number; None for what is no number."""
    return float(f"{value:.6g}") if math.isfinite(value) else None


def make_plain(fields: Mapping[str, Any]) -> dict[str, Any]:
    """A record as plain data: its floats rounded off, null where they are no numbers."""
    return {name: _make_plain(value) for name, value in fields.items()}


def write_json(data: Mapping[str, Any]) -> bytes:
    """Plain data, a line each."""
    return msgspec.json.format(msgspec.json.encode(data), indent=1)


def write_csv(heads: Sequence[str], rows: Iterable[Iterable[Any]]) -> bytes:
    """A table for programs: floats rounded off, cells empty where they are no numbers."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(heads)
    for row in rows:
        plain = map(_make_plain, row)
        writer.writerow(["" if cell is None else cell for cell in plain])
    return text.getvalue().encode()


def write_table(
    heads: Sequence[str], rows: Iterable[Sequence[str]], words: Collection[int] = (0,)
) -> list[str]:
    """Lines of a table in Markdown.

    Args:
        heads: Of its columns.
        rows: Their cells.
        words: Which columns are of words; the others are of numbers, and aligned to the right.
    """
    rules = ["---" if place in words else "---:" for place in range(len(heads))]
    lines = [f"| {' | '.join(heads)} |", f"|{'|'.join(rules)}|"]
    for row in rows:
        lines.append(f"| {' | '.join(cell.replace('|', '&#124;') for cell in row)} |")
    return lines


def list_pictures(captions: Mapping[str, str], files: Collection[str]) -> dict[str, str]:
    """What pictures show, by name of their PNG files, of those that were drawn.

    Args:
        captions: By name of the picture, in the order in which they are shown.
        files: That were drawn.
    """
    named = {f"{name}.png": caption for name, caption in captions.items()}
    return {file: caption for file, caption in named.items() if file in files}


def write_page(
    title: str,
    summary: Sequence[str],
    body: Sequence[str],
    pictures: Mapping[str, str],
    facts: Sequence[str],
    table: str,
) -> bytes:
    """A page in Markdown: summary, body, pictures, and how all that was measured.

    Args:
        title: Of the page.
        summary: What was found, a line each.
        body: Lines.
        pictures: What each one shows, by name of its file.
        facts: Command, machine, versions and seed, a line each.
        table: Name of the file with the table for programs.
    """
    lines = [f"# {title}", "", *_list(summary), "", *body, ""]
    for name, caption in pictures.items():
        lines += [f"![{caption}]({name})", ""]
    lines += ["## How it was measured", "", *_list(facts), ""]
    lines.append(f"All figures are in [{JSON_FILE}]({JSON_FILE}) and [{table}]({table}).")
    return ("\n".join(lines) + "\n").encode()


def write_files(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write the files of a report.

    Args:
        folder: Which is there.
        files: Their contents, by name.

    Raises:
        ArmguardError: One of them cannot be written.
    """
    for name, content in files.items():
        try:
            (folder / name).write_bytes(content)
        except OSError as error:
            raise ArmguardError(
                str(folder / name), f"cannot be written: {error.strerror}"
            ) from None


def _make_plain(value: Any) -> Any:
    return round_off(value) if isinstance(value, float) else value


def _list(lines: Iterable[str]) -> list[str]:
    return [f"- {line}" for line in lines]
