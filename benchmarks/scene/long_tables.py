"""Writes a page, and the tables that are too large for it as CSV files beside it."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Mapping
from pathlib import Path


def write_with_tables(page: str, tables: Mapping[str, list[str]], out: Path) -> None:
    """Write a page that names its tables in its last line, and these into a folder of its name.

    Args:
        page: In Markdown.
        tables: Their lines in Markdown, by the names of their files.
        out: The page's file.
    """
    folder = out.with_suffix("")
    if tables:
        folder.mkdir(exist_ok=True)
        links = ", ".join(f"[{name}.csv]({folder.name}/{name}.csv)" for name in tables)
        page += f"\nAll figures: {links}.\n"
    out.write_text(page, encoding="utf-8")
    for name, table in tables.items():
        (folder / f"{name}.csv").write_text(_write_csv(table), encoding="utf-8")


def _write_csv(table: list[str]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    for line in (table[0], *table[2:]):
        writer.writerow(re.sub(r"[*`]", "", cell).strip() for cell in _split(line))
    return text.getvalue()


def _split(line: str) -> list[str]:
    return re.split(r"(?<!\\)\|", line.strip().strip("|"))
