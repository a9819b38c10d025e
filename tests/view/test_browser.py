"""The page in a real browser, drawn by software: slow, but the same code as on a screen."""

import io
import threading

import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import sync_playwright

from armguard.view import FramePublisher, VerdictSummary, launch
from armguard.view.messages import Load
from support.view_picture import CHROMIUM, FLAGS, TIMEOUT, settle, wait_until_drawn
from support.view_samples import make_frame, make_scene

STAGE = {"x": 310, "y": 30, "width": 490, "height": 470}  # beside the panels

pytestmark = pytest.mark.skipif(not CHROMIUM.exists(), reason=f"{CHROMIUM} is not installed")


class Feed:
    """Publishes the same moment again and again, as a monitor would that stands still."""

    def __init__(self, robot):
        self.publisher = FramePublisher("tcp://127.0.0.1:*")
        self.publisher.publish_scene(make_scene(robot=robot))
        self._frame = {"contact_time": 0.05}
        self._ended = threading.Event()
        self._speaks = threading.Event()
        self._speaks.set()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def show(self, **frame):
        self._frame = frame

    def fall_silent(self):
        self._speaks.clear()

    def speak(self):
        self._speaks.set()

    def close(self):
        self._ended.set()
        self._thread.join()
        self.publisher.close()

    def _run(self):
        sequence = 0
        while not self._ended.wait(0.05):
            sequence += 1
            if self._speaks.is_set():
                self.publisher.publish_frame(make_frame(sequence=sequence, **self._frame))


@pytest.fixture(scope="module")
def feed():
    feed = Feed("panda")
    yield feed
    feed.close()


@pytest.fixture(scope="module")
def page(feed):
    with (
        launch(feed.publisher.address) as view,
        sync_playwright() as playwright,
        playwright.chromium.launch(executable_path=str(CHROMIUM), args=FLAGS) as browser,
    ):
        page = browser.new_page(viewport={"width": 800, "height": 500})
        page.set_default_timeout(TIMEOUT)
        page.problems = []
        page.on("pageerror", lambda error: page.problems.append(str(error)))
        page.on(
            "console",
            lambda line: page.problems.append(line.text) if line.type == "error" else None,
        )
        page.goto(view.url)
        yield page


def wait_for_text(page, element, text):
    page.wait_for_function(
        "([id, text]) => document.getElementById(id).textContent.includes(text)",
        arg=[element, text],
    )


def take_picture(page):
    """Pixels of the stage, once what the panels say is drawn. Shape (height, width, 3)."""
    settle(page)
    picture = Image.open(io.BytesIO(page.screenshot(clip=STAGE))).convert("RGB")
    return np.asarray(picture).astype(int)


def count_reddish(picture):
    red, green, blue = np.moveaxis(picture, -1, 0)
    return int(np.count_nonzero((red > 90) & (red > 1.8 * green) & (red > 1.8 * blue)))


def count_bright(picture):
    return int(np.count_nonzero(picture.min(axis=-1) > 150))


def test_the_picture_is_not_blank_and_takes_the_colour_of_imminence(feed, page):
    feed.show(contact_time=0.05)
    wait_for_text(page, "level", "STOP")
    wait_until_drawn(page)
    wait_for_text(page, "contact", "50 ms")
    imminent = take_picture(page)
    assert len(np.unique(imminent.reshape(-1, 3), axis=0)) > 500
    assert count_reddish(imminent) > 3000
    assert count_bright(imminent) > 100  # the arm itself is white

    feed.show(contact_time=20.0)
    wait_for_text(page, "level", "CLEAR")
    far = take_picture(page)
    assert count_reddish(far) < count_reddish(imminent) / 20
    assert len(np.unique(far.reshape(-1, 3), axis=0)) > 500

    feed.show(contact_time=0.05)
    wait_for_text(page, "level", "STOP")
    again = take_picture(page)
    assert abs(count_reddish(again) - count_reddish(imminent)) < count_reddish(imminent) / 10
    assert page.problems == []


def test_the_panels_say_what_the_verdict_says(feed, page):
    feed.show(
        verdict=VerdictSummary(
            level="SLOW",
            contact_time=0.321,
            stop_time=0.21,
            speed_scale=0.4,
            link="panda_hand",
            obstacle="<img src=x onerror=alert(1)>",
            complete=False,
            reasons=("source silent: cam0",),
        ),
        load=Load(ticks=1000, late=3, evaluated=77, p50=12e-6, p99=1.3e-3),
    )
    wait_for_text(page, "level", "SLOW")
    assert page.inner_text("#contact") == "321 ms"
    assert page.inner_text("#stop") == "210 ms"
    assert page.inner_text("#speed") == "40 %"
    # Names are text, whatever they look like.
    assert page.inner_text("#link") == "panda_hand"
    assert page.inner_text("#obstacle") == "<img src=x onerror=alert(1)>"
    assert page.inner_text("#evaluated") == "77"
    assert page.inner_text("#duration") == "12 µs · 1.3 ms"
    assert page.inner_text("#late") == "3"
    assert "source silent: cam0" in page.inner_text("#reasons")
    assert "not every pair" in page.inner_text("#reasons")
    assert page.inner_text("#steps li.now span") == "256 to 512 ms"
    assert "time to stop" in page.inner_text("#steps li:nth-child(2)")
    assert page.problems == []


def test_silence_is_said_and_ends(feed, page):
    feed.show(contact_time=20.0)
    wait_for_text(page, "level", "CLEAR")
    feed.fall_silent()
    wait_for_text(page, "level", "NO DATA")
    assert "(last: CLEAR)" in page.inner_text("#silence")
    # Nor does a browser that comes now take the last picture for the present.
    page.reload()
    wait_for_text(page, "silence", "last: CLEAR")
    assert page.inner_text("#level") == "NO DATA"
    feed.speak()
    wait_for_text(page, "level", "CLEAR")
    assert not page.is_visible("#silence")


def test_buffers_do_not_grow_while_it_runs(feed, page):
    count = "() => [viewer.renderer.info.memory.geometries, viewer.scene.children.length]"
    feed.show(contact_time=0.05)
    page.wait_for_timeout(1000)
    before = page.evaluate(count)
    page.wait_for_timeout(2000)
    assert page.evaluate(count) == before


def test_the_page_finds_back_to_a_view_that_was_restarted(page):
    feed = Feed("an arm without meshes")
    try:
        with launch(feed.publisher.address) as view:
            page.goto(view.url)
            wait_for_text(page, "level", "STOP")
            wait_for_text(page, "reasons", "the arm is not drawn")
            port = int(view.url.rstrip("/").rsplit(":", 1)[1])
        wait_for_text(page, "level", "NO DATA")
        with launch(feed.publisher.address, port):
            wait_for_text(page, "level", "STOP")
    finally:
        feed.close()
