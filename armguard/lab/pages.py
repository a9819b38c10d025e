"""What reports of studies have in common: numbers as plain data, tables, pages in Markdown, files.

A study decides on its columns and on what its page tells; how a number, a table and a page look is
decided here, once for all studies.
"""

from __future__ import annotations

import base64
import csv
import html
import io
import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np
from markdown_it import MarkdownIt
from markdown_it.token import Token

from armguard.app.terminal import make_plain
from armguard.exceptions import ArmguardError

JSON_FILE, PAGE = "report.json", "README.md"
"""What a report has for programs and for people, beside its table and its pictures."""

HTML_HEAD = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>{title}</title>
<meta name="viewport" content="width=device-width">
<style>
body {{ font: 15px/1.5 sans-serif; max-width: 90em; margin: 2em auto; padding: 0 1em; }}
table {{ border-collapse: collapse; font-size: 12px; display: block; overflow-x: auto; }}
th, td {{ border-bottom: 1px solid #ccc; padding: .3em .5em; }}
th {{ text-align: left; }}
td {{ white-space: nowrap; }}
td:first-child {{ white-space: normal; min-width: 12em; }}
img {{ max-width: 100%; display: block; }}
code {{ overflow-wrap: anywhere; }}
</style></head><body>
"""
"""Of a page in HTML."""

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


def write_json(data: Mapping[str, Any]) -> bytes:
    """Records and plain data, a line each; floats are rounded off, null where they are none."""
    return msgspec.json.format(msgspec.json.encode(round_off(make_plain(data))), indent=1)


def write_csv(heads: Sequence[str], rows: Iterable[Iterable[Any]]) -> bytes:
    """A table for programs: floats rounded off, cells empty where they are no numbers."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(heads)
    for row in rows:
        plain = map(round_off, row)
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


def write_html(title: str, page: bytes, folder: Mapping[str, bytes]) -> bytes:
    """A page in HTML that needs no other file, and no network.

    Args:
        title: Of the page.
        page: The same in Markdown.
        folder: Contents of the pictures, by the names that the page gives them.
    """
    parser = MarkdownIt("js-default")
    tokens = parser.parse(page.decode())
    for paragraph in tokens:
        for token in paragraph.children or ():
            if token.type == "image":
                image = base64.b64encode(folder[str(token.attrs["src"])]).decode()
                token.attrs["src"] = f"data:image/png;base64,{image}"
                # What it shows stands below it.
                paragraph.children = [token, Token("text", "", 0, content=token.content)]
    body = parser.renderer.render(tokens, parser.options, {})
    return f"{HTML_HEAD.format(title=html.escape(title))}{body}</body></html>\n".encode()


def check_page(out: Path) -> None:
    """Refuse a page that cannot be written now, not after minutes; what stands in it stays.

    Raises:
        ArmguardError: It is a folder or in none, or may not be written.
    """
    try:
        is_new = not out.exists()
        out.open("a").close()
        if is_new:
            out.unlink()  # a study that comes to no end leaves no page
    except OSError as error:
        raise ArmguardError(
            f"--out {out}",
            f"cannot be written ({error.strerror})",
            expected="a file in a folder that is, such as page.md",
        ) from None


def write_files(folder: Path, files: Mapping[str, bytes]) -> list[Path]:
    """Write the files of a report; their paths.

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
    return [folder / name for name in files]


def _list(lines: Iterable[str]) -> list[str]:
    return [f"- {line}" for line in lines]
