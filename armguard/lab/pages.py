"""Common parts of reports of studies: plain data, tables, pages in Markdown, files.

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
import numpy as np

from armguard.app.terminal import make_plain
from armguard.exceptions import ArmguardError

JSON_FILE, PAGE = "report.json", "README.md"
"""What a report has for programs and for people."""

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


def fit_exponent(sizes: Sequence[float], values: Sequence[float]) -> float:
    """The exponent e of values ~ sizes^e, by least squares on log axes; NaN of fewer than two."""
    if len(sizes) < 2:
        return math.nan
    return float(np.polyfit(np.log(sizes), np.log(values), 1)[0])


def round_off(value: Any) -> Any:
    """Plain data with six digits of each float; None for those that are no numbers."""
    if isinstance(value, float):
        return float(f"{value:.6g}") if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {name: round_off(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [round_off(item) for item in value]
    return value


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


def list_lines(lines: Iterable[str]) -> str:
    """A list in Markdown, which is one on a terminal, too."""
    return "".join(f"- {line}\n" for line in lines)


def write_report(
    folder: Path,
    title: str,
    body: Sequence[str],
    facts: Sequence[str],
    data: Mapping[str, Any],
) -> None:
    """Write a page in Markdown, and the same for programs as JSON.

    The page has the summary, the body, and how all that was measured.

    Args:
        folder: Where; it is there.
        title: Of the page.
        body: Lines.
        facts: Command, machine, versions and seed, a line each.
        data: All that was found, as records and plain data; `summary` is a list of lines. What is
            no number becomes null.

    Raises:
        ArmguardError: One of them cannot be written.
    """
    lines = [f"# {title}", "", list_lines(data["summary"]), *body, ""]
    lines += ["## How it was measured", "", list_lines(facts)]
    lines.append(f"All figures are in [{JSON_FILE}]({JSON_FILE}).\n")
    plain = round_off(make_plain(data))
    write_files(
        folder,
        {
            JSON_FILE: msgspec.json.format(msgspec.json.encode(plain), indent=1),
            PAGE: "\n".join(lines).encode(),
        },
    )


def name_table(out: Path) -> Path:
    """The CSV file beside a page, for its long table."""
    return out.with_suffix(".csv")


def write_csv(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> bytes:
    """A table as CSV, without the marks of Markdown."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    for row in (heads, *rows):
        writer.writerow(cell.replace("**", "") for cell in row)
    return text.getvalue().encode()


def check_page(out: Path) -> None:
    """Refuse a page that cannot be written now, not after minutes, and its table beside it.

    Raises:
        ArmguardError: It is a folder or in none, or may not be written.
    """
    _check_file(out)
    table = name_table(out)
    if table == out:
        problem = "is where the page's table goes"
        raise ArmguardError(f"--out {out}", problem, expected="a page, such as page.md")
    _check_file(table)


def _check_file(path: Path) -> None:
    """What stands in it stays."""
    try:
        is_new = not path.exists()
        path.open("a").close()
        if is_new:
            path.unlink()  # a study that comes to no end leaves no page
    except OSError as error:
        raise ArmguardError(
            f"--out {path}",
            f"cannot be written ({error.strerror})",
            expected="a file in a folder that is, such as page.md",
        ) from None


def make_folder(out: Path) -> None:
    """Make the folder of a report.

    Raises:
        ArmguardError: It cannot be made, or is a file.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ArmguardError(
            f"--out {out}", f"cannot be made ({error.strerror})", expected="a folder"
        ) from None


def write_files(folder: Path, files: Mapping[str, bytes]) -> list[Path]:
    """Write the files of a report; their paths.

    Raises:
        ArmguardError: One of them cannot be written.
    """
    paths = []
    for name, content in files.items():
        path = folder / name
        try:
            path.write_bytes(content)
        except OSError as error:
            raise ArmguardError(str(path), f"cannot be written: {error.strerror}") from None
        paths.append(path)
    return paths
