"""Moves large tables of a page into CSV files beside it, so that the page can be read."""

from __future__ import annotations

import csv
import io
import re
from pathlib import Path

MOST_ROWS, MOST_COLUMNS = 12, 9
"""Of a table that stays on its page."""


def write_with_tables(page: str, out: Path) -> None:
    """Write a page, and its large tables as CSV files into a folder of its name.

    Args:
        page: In Markdown.
        out: The page's file.
    """
    folder = out.with_suffix("")
    text, tables = split_tables(page, folder.name)
    out.write_text(text, encoding="utf-8")
    if tables:
        folder.mkdir(exist_ok=True)
    for name, content in tables.items():
        (folder / name).write_text(content, encoding="utf-8")


def split_tables(page: str, folder: str) -> tuple[str, dict[str, str]]:
    """The page with links in place of large tables, and these as CSV by their names.

    Args:
        page: In Markdown.
        folder: Of the files, as the page names it.
    """
    lines: list[str] = []
    table: list[str] = []
    tables: dict[str, str] = {}
    name = "table"
    for line in [*page.splitlines(), ""]:
        if line.startswith("|"):
            table.append(line)
            continue
        if len(table) > MOST_ROWS + 2 or (table and len(_split(table[0])) > MOST_COLUMNS):
            number = sum(one.startswith(name) for one in tables) + 1
            file = f"{name}.csv" if number == 1 else f"{name}-{number}.csv"
            tables[file] = _write_csv(table)
            lines.append(f"[{file}]({folder}/{file}): {len(table) - 2} rows.")
        else:
            lines += table
        table = []
        lines.append(line)
        if line.startswith("#"):
            name = re.sub(r"\W+", "-", line.strip("# ").lower()).strip("-")
    return "\n".join(lines[:-1]) + "\n", tables


def _write_csv(table: list[str]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    for line in (table[0], *table[2:]):
        writer.writerow(re.sub(r"[*`]", "", cell).strip() for cell in _split(line))
    return text.getvalue()


def _split(line: str) -> list[str]:
    return re.split(r"(?<!\\)\|", line.strip().strip("|"))
