"""`python tests/support/view_picture.py URL FILE.png [LEVEL]`: a picture of a running view.

Waits until the arm and a verdict are drawn, then for a verdict of that level, if one is named. No
screen is needed: Chromium draws by software, slow, but faithful.
"""

from __future__ import annotations

import sys
from pathlib import Path

from playwright.sync_api import Page, sync_playwright

CHROMIUM = Path("/usr/bin/chromium")
FLAGS = [
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
]
TIMEOUT = 60_000


def wait_until_drawn(page: Page) -> None:
    """Wait for the arm, for a verdict, and until both have reached the screen."""
    page.wait_for_function(
        "() => viewer.scene_tree.find(['armguard', 'cover']).children['<object>'] !== undefined"
        " && !document.body.classList.contains('silent')",
        timeout=TIMEOUT,
    )
    settle(page)


# Until a picture that is begun from now on is on the screen, or nothing is to be drawn.
SETTLE = """() => new Promise((done) => {
    const wanted = pace.begun + 1;
    const look = () => {
        const isDrawn = pace.finished >= wanted || !(viewer.needs_render || pace.fence);
        requestAnimationFrame(isDrawn ? () => requestAnimationFrame(done) : look);
    };
    requestAnimationFrame(look);
})"""


def settle(page: Page) -> None:
    """Let what was received be drawn."""
    page.evaluate(SETTLE)


def wait_for_level(page: Page, level: str) -> None:
    """Wait until the banner says so."""
    page.wait_for_function(
        "(level) => document.getElementById('level').textContent === level",
        arg=level,
        timeout=TIMEOUT,
    )


def main(url: str, file: str, level: str = "") -> None:
    """Save a picture of the view at `url`, of the first moment at `level`."""
    with (
        sync_playwright() as playwright,
        playwright.chromium.launch(executable_path=str(CHROMIUM), args=FLAGS) as browser,
    ):
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        page.goto(url)
        wait_until_drawn(page)
        if level:
            wait_for_level(page, level)
        page.screenshot(path=file)


if __name__ == "__main__":
    main(*sys.argv[1:])
