"""Drawings of the diagrams in the pages: `python docs/make_diagrams.py MERMAID_JS`.

Diagrams are written in Mermaid's language, which a repository's page draws by itself. For the site
they are drawn once, here, in Debian's Chromium by Playwright, so that it loads no script; each
drawing holds the digest of its text, by which `docs/mkdocs_hooks.py` finds it. The argument is
`node_modules/mermaid/dist/mermaid.min.js` of `npm install mermaid@11`.
"""

from __future__ import annotations

import hashlib
import re
import sys
from pathlib import Path

from playwright.sync_api import sync_playwright

DOCS = Path(__file__).resolve().parent
CHROMIUM = "/usr/bin/chromium"
DRAW = """async (text) => {
    mermaid.initialize({ startOnLoad: false, theme: "neutral", fontFamily: "sans-serif" });
    const { svg } = await mermaid.render("diagram", text);
    const page = new DOMParser().parseFromString(svg, "text/html");
    return new XMLSerializer().serializeToString(page.querySelector("svg"));
}"""


def main() -> None:
    """Draw each diagram of each page."""
    (script,) = sys.argv[1:]
    with (
        sync_playwright() as playwright,
        playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"]) as browser,
    ):
        page = browser.new_page()
        page.add_script_tag(path=script)
        for path in sorted(DOCS.glob("*.md")):
            text = path.read_text(encoding="utf-8")
            found = re.findall(r"^```mermaid\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
            for number, diagram in enumerate(found, 1):
                drawing = re.sub(r' data-points="[^"]*"', "", page.evaluate(DRAW, diagram))
                drawing = re.sub(r"-?\d+\.\d\d+", lambda one: f"{float(one[0]):.1f}", drawing)
                digest = hashlib.sha256(diagram.encode()).hexdigest()[:12]
                name = f"{path.stem}{number if len(found) > 1 else ''}.svg"
                target = DOCS / "pictures" / name
                target.write_text(f"<!-- {digest} -->\n{drawing}\n", encoding="utf-8")


if __name__ == "__main__":
    main()
