"""Writes a film as one HTML file that plays offline, with page, viewer and moments.

The page's modules import each other by relative paths, which do not exist in a single file. They
become bare names, and an import map maps these to the modules' text. The drawing commands follow as
gzipped MessagePack in base64, in the form that the server sends to browsers.
"""

from __future__ import annotations

import base64
import gzip
import json
import re
from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec

from armguard.exceptions import ArmguardError
from armguard.view.drawing import Command
from armguard.view.latest_values import join
from armguard.view.page_state import FilmPosition, PageState
from armguard.view.server import PAGE, VIEWER

MOST_BYTES = 200_000_000
"""Greatest size of all moments, before compression, in [bytes]."""

PREFIX = "armguard/"


def write_export(
    path: Path,
    values: Sequence[bytes],
    page_state: PageState,
    draw_past: Callable[[int, bool], list[Command] | None],
) -> None:
    """Write the file.

    Args:
        path: Path of the file.
        values: The latest drawing commands, including meshes.
        page_state: Holds the film.
        draw_past: Draws the moment with a given number, with or without the stopping volume.

    Raises:
        ArmguardError: There is nothing to write, or the file cannot be written.
    """
    moments = page_state.film.moments
    if not moments:
        raise ArmguardError(str(path), "has nothing to show: there was no moment to export")
    drawn: list[tuple[int, msgspec.Raw]] = []
    size = 0
    for moment in moments:
        parts = [one.payload for one in draw_past(moment.number, False) or []]
        size += sum(map(len, parts))
        if size > MOST_BYTES:
            raise ArmguardError(
                str(path),
                f"would hold more than {MOST_BYTES // 1_000_000} MB",
                remedy="export a shorter run, or one with fewer obstacles",
            )
        drawn.append((moment.number, msgspec.Raw(join(parts))))
    content = msgspec.msgpack.encode(
        {
            "scene": msgspec.Raw(join(list(values))),
            "news": msgspec.Raw(page_state.tell(FilmPosition())),
            "moments": drawn,
        }
    )
    try:
        path.write_text(_fill_page(gzip.compress(content, 6)), encoding="utf-8")
    except OSError as error:
        raise ArmguardError(str(path), f"cannot be written ({error.strerror})") from None


def check_export(path: Path) -> None:
    """Refuse a path that cannot be written, before the run rather than after it.

    Raises:
        ArmguardError: The folder does not exist, or the path is not a file.
    """
    if path.is_dir() or not path.resolve().parent.is_dir():
        raise ArmguardError(str(path), "cannot be written", expected="a file in an existing folder")


def _fill_page(film: bytes) -> str:
    """The page with all files that it otherwise fetches."""
    page = (PAGE / "index.html").read_text(encoding="utf-8")
    modules = {
        PREFIX + file.name: _make_address(
            re.sub(r'(from\s+)"\./', rf'\1"{PREFIX}', file.read_text(encoding="utf-8"))
        )
        for file in sorted(PAGE.glob("*.js"))
    }
    style = (PAGE / "view.css").read_text(encoding="utf-8")
    viewer = (VIEWER / "main.min.js").read_text(encoding="utf-8").replace("</script", "<\\/script")
    parts = {
        '<link rel="stylesheet" href="view.css">': f"<style>\n{style}</style>",
        '<script src="meshcat/main.min.js"></script>': f"<script>{viewer}</script>",
        '<script type="module" src="main.js"></script>': (
            f'<script type="importmap">{json.dumps({"imports": modules})}</script>\n'
            f'<script id="film" type="text/plain">{base64.b64encode(film).decode()}</script>\n'
            f'<script type="module">import "{PREFIX}main.js";</script>'
        ),
    }
    for place, content in parts.items():
        before, found, after = page.partition(place)
        assert found, f"the page has {place}"
        page = before + content + after
    return page


def _make_address(text: str) -> str:
    return "data:text/javascript;base64," + base64.b64encode(text.encode()).decode()
