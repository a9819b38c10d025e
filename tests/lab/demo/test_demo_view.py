"""The demo in a real browser: what it shows changes when the person reaches in."""

import io
import re
import time

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import sync_playwright

from support.demo_processes import RunningDemo
from support.view_picture import CHROMIUM, FLAGS, NICE_CHROMIUM, TIMEOUT, settle, wait_until_drawn

pytestmark = pytest.mark.skipif(not CHROMIUM.exists(), reason=f"{CHROMIUM} is not installed")

READ = """
  const text = (id) => document.getElementById(id).textContent;
  const [number, unit] = text("contact").split(" ");
  const imminence = Number(number) * (unit === "ms" ? 0.001 : 1);
"""
DURATION = 50.0  # [s]; nobody waits for the end

# At any level: on a busy machine late ticks alone may hold it down. Where nothing is known, it says
# that contact may be at once, and no link is near anything.
AT_THE_ARM = "imminence > 0.05 && imminence < 0.3"
AWAY = "imminence > 0.7"


def look(page, condition):
    """Colour of the contact time, if the banner says so; else None."""
    if not page.evaluate(f"() => {{ {READ} return {condition}; }}"):
        return None
    return page.evaluate("document.getElementById('contact').style.color")


def take_picture(page):
    """Pixels of the scene. Shape (height, width, 3)."""
    picture = Image.open(io.BytesIO(page.locator("#pane").screenshot())).convert("RGB")
    return np.asarray(picture).astype(int)


def count_warm(picture):
    """Pixels that are red to yellow, as nothing is that is far off in time: that is bluer."""
    red, green, blue = np.moveaxis(picture, -1, 0)
    return int(np.count_nonzero((red > 90) & (red > 1.6 * blue) & (green > blue)))


def test_the_colours_change_when_the_person_reaches_in(tmp_path):
    with (
        # First, so that the page is there before the person is.
        sync_playwright() as playwright,
        playwright.chromium.launch(executable_path=str(NICE_CHROMIUM), args=FLAGS) as browser,
        RunningDemo("--duration", str(DURATION), "--json", folder=tmp_path) as demo,
    ):
        url = None
        while url is None:
            url = re.search(r"http://127.0.0.1:\d+/", demo.process.stderr.readline())
        page = browser.new_page(viewport={"width": 800, "height": 500})
        page.set_default_timeout(TIMEOUT)
        problems = []
        page.on("pageerror", lambda error: problems.append(str(error)))
        page.goto(url[0])
        wait_until_drawn(page)
        # He is away before and after; a busy machine may show us only one of these.
        said, pictures = {}, {}
        deadline = time.monotonic() + DURATION
        while len(said) < 2 and time.monotonic() < deadline:
            for place in {AT_THE_ARM, AWAY} - said.keys():
                if look(page, place) is None:
                    continue
                # A picture takes seconds on a busy machine: of a moment that stands still.
                page.get_by_label("pause", exact=True).click()
                page.wait_for_selector("#past", state="visible")
                settle(page)
                answer = look(page, place)
                if answer is not None:
                    said[place], pictures[place] = answer, take_picture(page)
                page.get_by_label("back to the present").click()
                page.wait_for_selector("#past", state="hidden")
            page.wait_for_timeout(100)
        assert problems == []
        assert said.keys() == {AT_THE_ARM, AWAY}
    assert len(np.unique(pictures[AT_THE_ARM].reshape(-1, 3), axis=0)) > 500
    assert len(np.unique(pictures[AWAY].reshape(-1, 3), axis=0)) > 500
    assert said[AT_THE_ARM] != said[AWAY]
    assert count_warm(pictures[AT_THE_ARM]) > 1000
    assert count_warm(pictures[AWAY]) < count_warm(pictures[AT_THE_ARM]) / 2
