"""What the documentation site needs beyond MkDocs, so that pages can be read as files, too.

- Links that leave `docs/` lead to pages that show those files: `source/…` in the site.
- Formulas between dollar signs become MathML, which browsers draw without a script.
- Diagrams in Mermaid's language become the drawings that `docs/make_diagrams.py` keeps of them, so
  that nothing is loaded from elsewhere.
"""

from __future__ import annotations

import hashlib
import html
import posixpath
import re
from pathlib import Path
from typing import Any

from latex2mathml.converter import convert
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parent.parent
DRAWINGS = ROOT / "docs" / "pictures"
SOURCE = "source/"
LINK = re.compile(r"(?<!!)(\[(?:[^\[\]]|\[[^\]]*\])*\])\(([^)\s]+)\)")
FENCE = re.compile(r"(^```+\w*\n.*?^```+$)", re.MULTILINE | re.DOTALL)
FORMULA = re.compile(r'<(span|div) class="arithmatex">\\([(\[])(.*?)\\[)\]]</\1>', re.DOTALL)
BAR = "<mo>&#x0007C;</mo>"
MERMAID = re.compile(r"^```mermaid\n(.*?)^```$", re.MULTILINE | re.DOTALL)
LANGUAGES = {".py": "python", ".cpp": "cpp", ".toml": "toml", ".urdf": "xml", ".yml": "yaml"}


def on_files(files: Files, config: Any) -> Files:
    """Add a page for each file outside `docs/` that a page links to."""
    todo = [(file.src_uri, file.content_string) for file in files.documentation_pages()]
    wanted = [f"{SOURCE}CONTRIBUTING.md", f"{SOURCE}CHANGELOG.md"]
    while todo or wanted:
        for uri in wanted:
            if files.get_file_from_path(uri) is None:
                text = show(to_repository(uri))
                files.append(File.generated(config, uri, content=text))
                todo.append((uri, text))
        wanted = []
        if todo:
            page, text = todo.pop()
            found = (resolve(page, target) for _, target in LINK.findall(text))
            wanted = [target for target, _ in filter(None, found) if target.startswith(SOURCE)]
    return files


def on_page_markdown(markdown: str, page: Page, config: Any, files: Files) -> str:
    """Lead links to where the site has their targets, and put drawings for diagrams."""
    uri = page.file.src_uri

    def lead(match: re.Match[str]) -> str:
        found = resolve(uri, match[2])
        if found is None:
            return match[0]
        target, anchor = found
        if not target:  # a folder has no page
            return match[1][1:-1]
        return f"{match[1]}({posixpath.relpath(target, posixpath.dirname(uri) or '.')}{anchor})"

    # Text and blocks of code take turns.
    parts = FENCE.split(markdown)
    parts[::2] = [LINK.sub(lead, part) for part in parts[::2]]
    parts[1::2] = [MERMAID.sub(draw, part) for part in parts[1::2]]
    return "".join(parts)


def on_page_content(content: str, page: Page, config: Any, files: Files) -> str:
    """Make MathML of formulas."""

    def write(match: re.Match[str]) -> str:
        display = "block" if match[2] == "[" else "inline"
        formula = convert(html.unescape(match[3]), display=display)
        # Bars and names of functions stand as close to what they belong to as brackets do.
        formula = formula.replace(BAR, '<mo stretchy="false" lspace="0" rspace="0">|</mo>')
        return re.sub(r"<mo>(min|max)</mo>", r"<mi>\1</mi>", formula)

    return FORMULA.sub(write, content)


def to_repository(uri: str) -> str:
    """Path in the repository of what the site has as `uri`."""
    if not uri.startswith(SOURCE):
        return f"docs/{uri}"
    path = uri.removeprefix(SOURCE)
    return path if (ROOT / path).is_file() else path.removesuffix(".md")


def resolve(uri: str, link: str) -> tuple[str, str] | None:
    """Where the site has what a page links to, and the anchor; None for links that stay.

    The first is empty where the link leads to a folder.
    """
    target, mark, anchor = link.partition("#")
    if not target or ":" in target:
        return None
    path = posixpath.normpath(posixpath.join(posixpath.dirname(to_repository(uri)), target))
    if (ROOT / path).is_dir():
        return "", ""
    if path.startswith("docs/"):
        return path.removeprefix("docs/"), mark + anchor
    if not (ROOT / path).is_file():
        return None  # MkDocs says that it leads nowhere
    return f"{SOURCE}{path}" + ("" if path.endswith(".md") else ".md"), mark + anchor


def show(path: str) -> str:
    """A page that shows a file of the repository."""
    text = (ROOT / path).read_text(encoding="utf-8")
    if path.endswith(".md"):
        return text
    suffix = posixpath.splitext(path)[1]
    return f"# {path}\n\n````{LANGUAGES.get(suffix, 'text')}\n{text}````\n"


def draw(match: re.Match[str]) -> str:
    """The drawing that is kept of a diagram."""
    digest = hashlib.sha256(match[1].encode()).hexdigest()[:12]
    found = [path for path in DRAWINGS.glob("*.svg") if digest in path.read_text(encoding="utf-8")]
    if not found:
        raise PluginError("a diagram has changed since it was drawn: python docs/make_diagrams.py")
    return f"![Diagram](pictures/{found[0].name})"
