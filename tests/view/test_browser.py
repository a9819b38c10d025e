"""The page in a real browser, drawn by software: slow, but the same code as on a screen."""

import contextlib
import io
import itertools
import threading

import msgspec
import numpy as np
import pytest
from PIL import Image
from playwright.sync_api import sync_playwright

from armguard.streams.inputs import SocketInput
from armguard.view import FramePublisher, ObstacleShapes, Pairs, VerdictSummary, launch
from armguard.view.buckets import compute_buckets
from armguard.view.colours import BUCKET_COLOURS, LEVEL_COLOURS, THEMES, parse_colour
from armguard.view.messages import (
    FEED_VERSION,
    CommandSummary,
    Latch,
    Load,
    SourceReport,
    StatusMessage,
)
from support.view_picture import CHROMIUM, FLAGS, TIMEOUT, settle, wait_until_drawn
from support.view_samples import PERIOD, make_frame, make_scene

pytestmark = pytest.mark.skipif(not CHROMIUM.exists(), reason=f"{CHROMIUM} is not installed")

LEVELS = {"STOP": 0.05, "SLOW": 0.25, "AWARE": 0.4, "CLEAR": 1.5}
SIZES = [(360, 640), (640, 360), (768, 1024), (1366, 600), (2560, 1440)]
PERSON = {
    "head": [[0.3, -2.4, 0.9]],
    "hip": [[0.3, -2.4, 0.2], [0.3, -2.4, 0.6]],
    "left_hand": [[0.3, -1.8, 0.4]],
}
NAME = "<img src=x onerror=alert(1)>"

# Whether each ball that the camera is to show lies within the picture with all of its outline.
IS_FRAMED = """() => {
    viewer.render();
    const turn = viewer.scene.matrixWorld; // the viewer's own world has y up
    const place = (x, y, z) => new MeshCat.THREE.Vector3(x, y, z).applyMatrix4(turn)
        .project(viewer.camera);
    const all = shapes.drawn;
    return ["/armguard/cover", "/armguard/obstacles/balls"].every((path) => {
        const { matrices, buckets } = all.get(path).userData.command;
        return [...Array(buckets.length).keys()].every((k) => {
            const [r, x, y, z] = [0, 12, 13, 14].map((place) => matrices[16 * k + place]);
            return [[r, 0, 0], [-r, 0, 0], [0, r, 0], [0, -r, 0], [0, 0, r], [0, 0, -r]].every(
                ([a, b, c]) => {
                    const at = place(x + a, y + b, z + c);
                    return Math.abs(at.x) <= 1.001 && Math.abs(at.y) <= 1.001 && at.z < 1;
                });
        });
    });
}"""
# Elements that leave the window, and pairs of panels that cover each other.
FIND_FLAWS = """() => {
    const boxes = ["banner", "panels", "presets", "pane", "strip", "transport"].map((id) => {
        const { left, top, right, bottom } = document.getElementById(id).getBoundingClientRect();
        return { id, left, top, right, bottom };
    });
    const flaws = boxes
        .filter((box) => box.left < -0.5 || box.top < -0.5 || box.right > innerWidth + 0.5
            || box.bottom > innerHeight + 0.5 || box.right - box.left < 100
            || box.bottom - box.top < 20)
        .map(({ id }) => `${id} is out or has no room`);
    boxes.forEach((a, k) => boxes.slice(k + 1).forEach((b) => {
        if (a.left < b.right - 0.5 && b.left < a.right - 0.5
            && a.top < b.bottom - 0.5 && b.top < a.bottom - 0.5) flaws.push(`${a.id} on ${b.id}`);
    }));
    return flaws;
}"""


class Feed:
    """Publishes the same moment again and again, as a monitor would that stands still."""

    def __init__(self, **scene):
        self.publisher = FramePublisher("tcp://127.0.0.1:*")
        self.publisher.publish_scene(make_scene(**scene))
        self._frame = {"contact_time": 0.05}
        self._ended = threading.Event()
        self._speaks = threading.Event()
        self._speaks.set()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def show(self, level=None, **frame):
        if level is not None:
            frame = show_person(level) | frame
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
                counted = {"sequence": sequence, "now": 0.05 * sequence}
                frame = make_frame(**(counted | self._frame))
                self.publisher.publish_frame(frame)


def show_person(level):
    """A frame with a person, as imminent as that level is."""
    time = LEVELS[level]
    points = np.zeros((len(PERSON), 2, 3))
    for row, some in zip(points, PERSON.values(), strict=True):
        row[: len(some)] = some
    counts = [len(some) for some in PERSON.values()]
    return {
        "contact_time": time,
        "verdict": VerdictSummary(
            level=level,
            contact_time=time,
            stop_time=0.2,
            speed_scale=0.4,
            link="panda_link6",
            obstacle="left_hand",
            reasons=("contact possible: panda_link6 and left_hand (soon)",),
            effects=("note",),
        ),
        "obstacles": ObstacleShapes.pack(
            list(PERSON), points, [0.16, 0.2, 0.13], counts=counts, times=[time] * len(PERSON)
        ),
        "pairs": Pairs.pack([5], [2], [time], [3, 0, 1] + [0] * 13),
    }


@pytest.fixture(scope="module")
def feed():
    feed = Feed()
    yield feed
    feed.close()


@pytest.fixture(scope="module")
def browser():
    with (
        sync_playwright() as playwright,
        playwright.chromium.launch(executable_path=str(CHROMIUM), args=FLAGS) as browser,
    ):
        yield browser


@pytest.fixture(scope="module")
def view(feed, tmp_path_factory):
    path = tmp_path_factory.mktemp("export") / "scene.html"
    with launch(feed.publisher.address, floor=-0.75, export=path) as view:
        view.export = path
        yield view
        view.close()


@pytest.fixture(scope="module")
def page(view, browser):
    page = open_page(browser)
    page.goto(view.url)
    return page


def open_page(browser, **options):
    page = browser.new_page(viewport={"width": 900, "height": 600}, **options)
    page.set_default_timeout(TIMEOUT)
    page.problems = []
    page.on("pageerror", lambda error: page.problems.append(str(error)))
    page.on(
        "console", lambda line: page.problems.append(line.text) if line.type == "error" else None
    )
    return page


def wait_for_text(page, element, text):
    page.wait_for_function(
        "([id, text]) => document.getElementById(id).textContent.includes(text)",
        arg=[element, text],
    )


def wait_for_room(page):
    """Until the next event gets a marker of its own: of two that are close, one is shown."""
    page.wait_for_function(
        "() => document.querySelector('#events button')"
        " && [...document.querySelectorAll('#events button')].every("
        "(marker) => parseFloat(marker.style.left) + 40 < marker.parentElement.clientWidth)"
    )


def take_picture(page):
    """Pixels of the pane, once what the panels say is drawn. Shape (height, width, 3)."""
    settle(page)
    picture = Image.open(io.BytesIO(page.locator("#pane").screenshot())).convert("RGB")
    return np.asarray(picture).astype(int)


def count_like(picture, code):
    """Pixels whose hue is about that of a colour, however dark."""
    wanted = parse_colour(code)
    wanted = wanted / np.linalg.norm(wanted)
    length = np.linalg.norm(picture, axis=-1)
    likeness = picture @ wanted / np.maximum(length, 1.0)
    return int(np.count_nonzero((length > 90) & (likeness > 0.985)))


def test_person_and_arm_are_in_the_picture_in_the_colour_of_every_level(feed, page):
    page.check("#by-level")
    codes = LEVEL_COLOURS["dark"]
    for level, code in zip(LEVELS, codes, strict=True):
        feed.show(level)
        wait_for_text(page, "level", level)
        if level == "STOP":
            wait_until_drawn(page)
        page.wait_for_function(IS_FRAMED)
        picture = take_picture(page)
        counts = {one: count_like(picture, one) for one in codes}
        assert counts[code] > 1000
        assert max(counts, key=counts.get) == code
    assert page.evaluate("() => location.hash") == "#colours=level"
    page.uncheck("#by-level")
    assert "colours" not in page.evaluate("() => location.hash")
    assert page.problems == []


# Colours of the lines between pairs, the most imminent first, as they are handed to WebGL.
READ_PAIRS = """() => ["first", "near"].flatMap((name) => {
    const { count, instanceColor } = shapes.drawn.get(`/armguard/pairs/${name}`);
    return [...Array(count).keys()].map((k) => [...instanceColor.array.slice(3 * k, 3 * k + 3)]);
})"""


@pytest.mark.parametrize("theme", THEMES)
def test_pairs_bodies_and_legend_have_the_colours_of_their_buckets(feed, page, theme):
    times = [0.0, 0.003, 0.05, 0.2, 1.5, 40.0]
    buckets = compute_buckets(times, PERIOD)
    wanted = [parse_colour(BUCKET_COLOURS[theme][bucket]) for bucket in buckets]
    pairs = Pairs.pack([5] * 6, [2] * 6, times, np.bincount(buckets, minlength=16))
    page.set_checked("#light", theme == "light")
    feed.show("STOP", pairs=pairs)
    page.wait_for_function(
        "(count) => shapes.drawn.get('/armguard/pairs/near')?.count === count", arg=len(times) - 1
    )
    assert np.allclose(page.evaluate(READ_PAIRS), wanted, atol=1e-6)
    (person,) = np.unique(
        page.evaluate(
            """() => {
                const { count, instanceColor } = shapes.drawn.get("/armguard/obstacles/balls");
                return [...Array(count).keys()].map(
                    (k) => [...instanceColor.array.slice(3 * k, 3 * k + 3)]);
            }"""
        ),
        axis=0,
    )
    bucket = int(compute_buckets(LEVELS["STOP"], PERIOD))
    assert np.allclose(person, parse_colour(BUCKET_COLOURS[theme][bucket]), atol=1e-6)
    swatches = page.locator("#buckets u").evaluate_all(
        "(all) => all.map((one) => getComputedStyle(one).backgroundColor)"
    )
    codes = [parse_colour(code) for code in BUCKET_COLOURS[theme]]
    assert swatches == [
        "rgb({}, {}, {})".format(*np.rint(255.0 * code).astype(int)) for code in codes
    ]
    labels = page.locator("#buckets u + b").all_inner_texts()
    assert [label for label in labels if label] == ["0", "8ms", "64ms", "512ms", "4.1s"]
    # The level stays what it is.
    assert page.inner_text("#level") == "STOP"
    level = parse_colour(LEVEL_COLOURS[theme][0])
    found = page.evaluate("() => getComputedStyle(document.getElementById('sign')).color")
    assert found == "rgb({}, {}, {})".format(*np.rint(255.0 * level).astype(int))
    page.uncheck("#light")
    assert page.problems == []


def test_a_printed_page_is_light_and_whole(feed, page):
    feed.show("SLOW")
    wait_for_text(page, "level", "SLOW")
    page.emulate_media(media="print")
    try:
        page.wait_for_function("() => document.documentElement.classList.contains('light')")
        picture = np.asarray(Image.open(io.BytesIO(page.screenshot(full_page=True))).convert("L"))
        assert np.median(picture) > 200.0
        assert page.is_visible("#banner")
        assert page.is_visible("#source")
        assert not page.is_visible("#transport")
    finally:
        page.emulate_media(media="screen")
    page.wait_for_function("() => !document.documentElement.classList.contains('light')")
    assert page.problems == []


def test_the_panels_say_what_the_verdict_says(feed, page):
    feed.show(
        verdict=VerdictSummary(
            level="SLOW",
            contact_time=0.321,
            stop_time=0.25,
            speed_scale=0.4,
            link="panda_hand",
            obstacle=NAME,
            complete=False,
            reasons=("source silent: cam0",),
            effects=("standing",),
        ),
        load=Load(ticks=1000, late=3, evaluated=77, p50=12e-6, p99=1.3e-3),
        sources=(
            SourceReport(name="robot", age=0.002, rate=1000.0, timeout=0.05),
            SourceReport(name="cam0", age=0.5, rate=9.5, timeout=0.2),
            SourceReport(name="cam1", age=None),
        ),
        pairs=Pairs.pack([5], [0], [0.3], [3, 0, 1] + [0] * 13),
    )
    wait_for_text(page, "level", "SLOW")
    wait_for_text(page, "link", "panda_hand")
    expected = {
        "#contact": "321 ms",
        "#stop": "250 ms",
        "#speed": "40 %",
        "#obstacle": NAME,  # names are text, whatever they look like
        "#evaluated": "77",
        "#duration": "12 µs · 1.3 ms",
        "#late": "3",
    }
    assert {name: page.inner_text(name) for name in expected} == expected
    assert "source silent: cam0" in page.inner_text("#reasons")
    assert "not every pair" in page.inner_text("#reasons")
    assert page.inner_text("#levels li.now b") == "SLOW"
    heard = page.inner_text("#heard").replace("\t", " ")
    assert "robot 1000 Hz 2 ms old" in heard
    assert "cam0 9.5 Hz ✕ late, 500 ms" in heard
    assert "nothing received" in heard
    titles = page.locator("#buckets div").evaluate_all("(all) => all.map((one) => one.title)")
    assert [int(title.split(": ")[1].split()[0]) for title in titles] == [3, 0, 1] + [0] * 13
    assert page.problems == []


@pytest.mark.parametrize("size", SIZES)
def test_no_panel_covers_another_at_any_size(feed, page, size):
    feed.show("CLEAR")
    width, height = size
    page.set_viewport_size({"width": width, "height": height})
    try:
        page.wait_for_function("() => document.getElementById('level').textContent === 'CLEAR'")
        settle(page)
        assert page.evaluate(FIND_FLAWS) == []
        page.wait_for_function(IS_FRAMED)
    finally:
        page.set_viewport_size({"width": 900, "height": 600})


def test_a_stop_is_an_event_that_leads_back_to_its_reasons(feed, page):
    feed.show("CLEAR")
    wait_for_text(page, "level", "CLEAR")
    page.wait_for_timeout(500)
    feed.show("STOP")
    wait_for_text(page, "level", "STOP")
    feed.show("CLEAR")
    wait_for_text(page, "level", "CLEAR")
    stop = page.locator("#events .stop").last
    assert "panda_link6 and left_hand" in stop.get_attribute("title")
    stop.click()
    wait_for_text(page, "past", "PAST")
    wait_for_text(page, "level", "STOP")
    assert "panda_link6 and left_hand" in page.inner_text("#reasons")
    # On a phone the times stay beside the level.
    page.set_viewport_size({"width": 390, "height": 844})
    headline, times = (page.locator(f"#{name}").bounding_box() for name in ("headline", "times"))
    assert times["x"] >= headline["x"] + headline["width"]
    assert times["y"] < headline["y"] + headline["height"]
    page.set_viewport_size({"width": 900, "height": 600})
    # The past stays while the present goes on, and a step further is a later moment.
    page.wait_for_timeout(300)
    assert page.inner_text("#level") == "STOP"
    before = page.inner_text("#source")
    page.get_by_label("one moment on").click()
    page.wait_for_function(
        "(before) => document.getElementById('source').textContent !== before", arg=before
    )
    page.get_by_label("back to the present").click()
    wait_for_text(page, "level", "CLEAR")
    assert not page.is_visible("#past")
    assert page.problems == []


@pytest.mark.parametrize("is_told", [True, False])
def test_a_moment_that_is_never_drawn_does_not_keep_from_the_present(feed, view, browser, is_told):
    held, withheld = [], []

    def hand_on(socket, bundle):
        """What the page hears, without a moment of the past in it while one is held."""
        news, *commands = msgspec.msgpack.decode(bundle)
        if held:
            seen = [one | {"drawn": False} for one in commands if one["type"] == "seen"]
            withheld.extend(seen)
            bundle = msgspec.msgpack.encode([news, *(seen if is_told else [])])
        socket.send(bundle)

    def connect(socket):
        socket.connect_to_server().on_message(lambda bundle: hand_on(socket, bundle))

    feed.show("CLEAR")
    page = open_page(browser)
    page.route_web_socket("**/feed*", connect)
    page.goto(view.url)
    wait_for_text(page, "level", "CLEAR")
    page.wait_for_function("() => document.querySelector('[aria-label=time]').max > 1")
    held.append(True)
    page.get_by_label("pause").click()
    while not withheld:
        page.wait_for_timeout(20)
    held.clear()
    if not is_told:
        assert page.is_visible("#past")
        page.get_by_label("back to the present").click()
    feed.show("STOP")
    wait_for_text(page, "level", "STOP")
    assert not page.is_visible("#past")
    assert page.problems == []
    page.close()


def test_the_camera_stays_where_a_hand_has_put_it(feed, page):
    feed.show("CLEAR")
    page.get_by_label("from above").click()
    page.wait_for_function("() => location.hash.includes('camera=top')")
    page.wait_for_function(IS_FRAMED)
    page.mouse.move(400, 200)
    page.mouse.wheel(0, -200)
    where = "() => viewer.camera.position.toArray()"
    page.wait_for_timeout(300)
    before = page.evaluate(where)
    assert not page.locator("#presets [aria-pressed=true]").count()
    feed.show("STOP")
    wait_for_text(page, "level", "STOP")
    assert page.evaluate(where) == pytest.approx(before, abs=1e-9)
    page.get_by_label("all that matters").click()
    page.wait_for_function(IS_FRAMED)


def test_a_pointer_is_told_a_name_and_two_clicks_look_there(feed, page):
    feed.show("AWARE")
    wait_for_text(page, "level", "AWARE")
    page.get_by_label("all that matters").click()
    page.wait_for_function(IS_FRAMED)
    find = """() => {
        const { left, top, width, height } = viewer.dom_element.getBoundingClientRect();
        const { matrices } = shapes.drawn.get("/armguard/obstacles/balls").userData.command;
        const place = new MeshCat.THREE.Vector3(...matrices.slice(12, 15))
            .applyMatrix4(viewer.scene.matrixWorld).project(viewer.camera);
        return [left + (place.x + 1) / 2 * width, top + (1 - place.y) / 2 * height];
    }"""
    for _ in range(TIMEOUT // 500):  # the camera may still be on its way
        if page.is_visible("#tip"):
            break
        x, y = page.evaluate(find)
        page.mouse.move(x, y)
        page.wait_for_timeout(500)
    name, _, time = page.inner_text("#tip").partition(": ")
    assert name in PERSON
    assert time == "contact time 400 ms"
    distance = "() => viewer.camera.position.distanceTo(viewer.controls.target)"
    before = after = page.evaluate(distance)
    for _ in range(TIMEOUT // 500):  # what is under the pointer may have moved on meanwhile
        page.mouse.dblclick(*page.evaluate(find))
        after = page.evaluate(distance)
        if after < before:
            break
        page.wait_for_timeout(500)
    assert after < before
    assert not page.locator("#presets [aria-pressed=true]").count()
    page.get_by_label("all that matters").click()


def permit(**changes):
    """A verdict beside a hand that the arm may touch at its speed."""
    fields = {
        "level": "AWARE",
        "contact_time": 0.05,
        "stop_time": 0.2,
        "speed_scale": 1.0,
        "link": "panda_hand",
        "obstacle": "left_hand",
        "reasons": (
            "contact allowed: panda_hand and left_hand (at most 0.21 of 0.9 m/s (hand: X))",
        ),
        "effects": ("note",),
        "harm_time": 1.25,
        "contact_speed": 0.21,
    }
    return VerdictSummary(**(fields | changes))


def test_what_contact_limits_permit_is_shown_only_where_they_are_stated(feed, page):
    limited = ["#harm", "#touch"]
    feed.show("AWARE")
    wait_for_text(page, "contact", "400 ms")
    before = page.inner_text("body")
    assert not any(map(page.is_visible, limited))
    assert "harm" not in before
    assert "levels by contact time" in page.inner_text("#legend")
    shown = {
        (0.21, 1.25): ("1.25 s", "at most 0.21 m/s"),
        (0.0, np.inf): ("none possible", "no contact before rest"),
        (np.inf, 0.0): ("0 ms", "unknown"),
    }
    for (contact_speed, harm_time), texts in shown.items():
        feed.show("AWARE", verdict=permit(contact_speed=contact_speed, harm_time=harm_time))
        wait_for_text(page, "harm", texts[0])
        wait_for_text(page, "contact", "50 ms")
        assert tuple(map(page.inner_text, limited)) == texts
    feed.show("AWARE", verdict=permit())
    wait_for_text(page, "harm", "1.25 s")
    assert page.inner_text("#reasons").startswith("contact allowed: panda_hand and left_hand")
    assert "0.21 of 0.9 m/s" in page.inner_text("#reasons")
    assert "levels by harm time" in page.inner_text("#legend")
    # The arm may be touched, and would rest long before harm.
    sides = "(id) => getComputedStyle(document.getElementById(id)).color"
    assert page.evaluate(sides, "harm") != page.evaluate(sides, "contact")
    for width, height in SIZES:
        page.set_viewport_size({"width": width, "height": height})
        settle(page)
        assert page.evaluate(FIND_FLAWS) == []
    page.set_viewport_size({"width": 900, "height": 600})
    feed.show("AWARE")
    wait_for_text(page, "contact", "400 ms")
    assert not any(map(page.is_visible, limited))
    assert page.problems == []


def test_a_latched_stop_tells_since_when_and_what_ends_it(feed, page):
    jump, gap = "joint state jumped: panda_joint3", "gap in joint states"
    latches = (
        Latch(reason=jump, since=1.0, remedy="check for <b>swapped</b> states"),
        Latch(reason=gap, since=3.5, remedy="set a longer `joint_timeout <b>x</b>`, then reset"),
    )
    verdict = VerdictSummary(
        level="STOP",
        contact_time=0.0,
        stop_time=0.2,
        reasons=(jump, f"{gap} (0.4 s)", "source silent: cam0"),
        effects=("latched", "latched", "standing"),
    )
    feed.show("STOP", latches=latches, verdict=verdict)
    page.wait_for_selector("#latch:not([hidden])")
    wait_for_text(page, "reasons", "source silent")
    panels = page.inner_text("#panels")
    assert panels.count(jump) == panels.count(gap) == 1
    assert page.inner_text("#latches").splitlines() == [
        jump,
        "check for <b>swapped</b> states",
        f"3.50 s {gap}",
        "set a longer joint_timeout <b>x</b>, then reset",
    ]
    assert page.locator("#latches code").all_inner_texts() == ["joint_timeout <b>x</b>"]
    assert page.inner_text("#since").startswith("since 1.00 s, for")
    assert "refuses resets" in page.inner_text("#remedy")
    # On a phone each time stays in one line beside the sign of the latch.
    page.set_viewport_size({"width": 360, "height": 640})
    heights = "() => ['contact', 'speed'].map((id) => document.getElementById(id).clientHeight)"
    assert max(page.evaluate(heights)) < 25
    page.set_viewport_size({"width": 900, "height": 600})
    feed.show("STOP")
    page.wait_for_selector("#latch", state="hidden")


def test_a_proved_piece_is_shown_only_where_the_arm_is_on_one(feed, page):
    feed.show("AWARE")
    wait_for_text(page, "contact", "400 ms")
    assert not page.is_visible("#proved")
    on_it = msgspec.structs.replace(show_person("AWARE")["verdict"], proved_until=40.25)
    feed.show("AWARE", verdict=on_it, now=40.0)
    wait_for_text(page, "proved", "250 ms")
    assert page.is_visible("#proved")
    # An arm that has come to rest there goes on resting.
    feed.show("AWARE", verdict=on_it, now=41.0)
    wait_for_text(page, "proved", "0 ms")


def test_where_a_shield_moves_the_arm_its_pace_is_told_and_why_it_is_slower(feed, page):
    command = {"scale": 0.4, "reason": "plan unsafe: <b>hand</b>", "progress": 0.5}
    feed.show("AWARE")
    wait_for_text(page, "going", "allowed speed")
    assert not page.is_visible("#slower")
    feed.show("AWARE", command=CommandSummary(**command, is_proved=True))
    wait_for_text(page, "going", "pace")
    wait_for_text(page, "speed", "40 %")
    wait_for_text(page, "slower", "slower: plan unsafe: <b>hand</b>")
    feed.show("AWARE", command=CommandSummary(**command, is_proved=False))
    wait_for_text(page, "slower", "not proved any more, the arm must brake: plan unsafe")
    full = command | {"scale": 1.0, "reason": ""}
    before = page.locator("#banner").bounding_box()
    feed.show("AWARE", command=CommandSummary(**full, is_proved=True))
    wait_for_text(page, "speed", "100 %")
    assert page.inner_text("#slower") == ""
    assert page.locator("#banner").bounding_box() == before
    feed.show("AWARE")
    wait_for_text(page, "going", "allowed speed")


def test_a_level_that_is_held_tells_its_cause_and_when_it_may_rise(feed, page):
    cause = "panda_link1 and <b>left_hand</b>, contact time 46 ms, stop time 83 ms"
    begun = msgspec.structs.replace(show_person("STOP")["verdict"], since=39.9, cause=cause)
    held = msgspec.structs.replace(begun, contact_time=0.157, stop_time=0.073, rises_at=40.3)
    sizes = []
    for width, height in [(900, 600), (390, 844)]:
        page.set_viewport_size({"width": width, "height": height})
        feed.show("STOP", verdict=begun, now=39.9)
        wait_for_text(page, "contact", "50 ms")
        wait_for_text(page, "cause", f"since 39.90 s: {cause}")
        assert page.inner_text("#rises") == ""
        before = page.locator("#banner").bounding_box()
        feed.show("STOP", verdict=held, now=40.1)
        wait_for_text(page, "contact", "157 ms")
        assert page.inner_text("#cause") == f"since 39.90 s: {cause}; may rise in 0.2 s"
        sizes.append((before, page.locator("#banner").bounding_box()))
    page.set_viewport_size({"width": 900, "height": 600})
    # Nothing on the page moves when the level begins to be held.
    assert all(before == after for before, after in sizes)
    # Without data it is not known when that will be.
    feed.fall_silent()
    wait_for_text(page, "silence", "last: STOP")
    assert page.inner_text("#cause") == f"since 39.90 s: {cause}"
    feed.speak()
    feed.show("STOP", sequence=0)
    wait_for_text(page, "level", "WAITING")
    assert page.inner_text("#cause").strip() == ""


# Labels that touch the next one, or leave the panel.
def test_no_text_from_data_is_markup(browser):
    page = open_page(browser)
    feed = Feed(robot="<b>bare</b>", sensors=(("<b>camera</b>", (1.0,) * 16),))
    texts = [f"<b>{place}</b> [statics] &amp; {NAME}" for place in range(9)]
    (reason, link, obstacle, latched, remedy, source, why, late, note) = texts
    verdict = VerdictSummary(
        level="STOP",
        contact_time=0.1,
        stop_time=0.2,
        link=link,
        obstacle=obstacle,
        reasons=(reason, late),
        effects=("note", "standing"),
    )
    feed.show(
        "STOP",
        verdict=verdict,
        latches=(Latch(reason=latched, since=0.0, remedy=remedy),),
        sources=(SourceReport(name=source, age=0.5, timeout=0.2),),
        explanation=(why,),
        obstacles=ObstacleShapes.pack([note], [[0.3, -2.4, 0.9]], [0.2], times=[0.1]),
        pairs=Pairs(),
    )
    try:
        with launch(feed.publisher.address) as view:
            page.goto(view.url)
            wait_for_text(page, "reasons", reason)
            shown = {
                "#link": link,
                "#obstacle": obstacle,
                "#latches": latched,
                "#latch": remedy,
                "#heard": source,
                "#explanation": why,
                "#source": "<b>bare</b>",
            }
            for place, text in shown.items():
                assert text in page.inner_text(place)
            titles = page.locator("#events button").evaluate_all("(all) => all.map((b) => b.title)")
            assert any(latched in title for title in titles)
            made = "() => [...document.querySelectorAll('img, #panels li b, #banner b, #events b')]"
            found = page.evaluate(f"({made})().filter((one) => one.closest('#levels') === null)")
            assert found == []
    finally:
        feed.close()
    assert page.problems == []
    page.close()


def test_a_page_that_hangs_does_not_hold_up_another(feed, view, browser, page):
    """The first is held by a debugger, amid its work, as long as the second takes."""
    feed.show("CLEAR")
    other = open_page(browser)
    other.goto(view.url)
    for one in (page, other):
        wait_for_text(one, "level", "CLEAR")
    debugger, held = page.context.new_cdp_session(page), []
    debugger.on("Debugger.paused", lambda event: held.append(event))
    debugger.send("Debugger.enable")
    debugger.send("Debugger.pause")
    while not held:
        other.wait_for_timeout(20)
    for level in ("STOP", "AWARE", "SLOW"):
        feed.show(level)
        wait_for_text(other, "level", level)
    debugger.send("Debugger.disable")  # lets it go on
    wait_for_text(page, "level", "SLOW")
    other.close()
    assert page.problems == []


# Whether the band of the levels below the strip has a colour in it.
HAS_COLOUR = """(wanted) => {
    const canvas = document.getElementById("curves");
    const { width, height } = canvas;
    const { data } = canvas.getContext("2d").getImageData(0, height - 2, width, 1);
    const isLike = (x) => wanted.every((part, k) => data[4 * x + k] === part);
    return [...Array(width).keys()].some(isLike);
}"""


def test_silence_is_said_and_ends(feed, page):
    feed.show("CLEAR")
    wait_for_text(page, "level", "CLEAR")
    feed.fall_silent()
    wait_for_text(page, "level", "NO DATA")
    assert "(last: CLEAR)" in page.inner_text("#silence")
    # Nor does a browser that comes now take the last picture for the present.
    page.reload()
    wait_for_text(page, "silence", "last: CLEAR")
    assert page.inner_text("#level") == "NO DATA"
    # Moments that came before the colours have them all the same.
    clear = np.rint(255.0 * parse_colour(LEVEL_COLOURS["dark"][-1]))
    page.wait_for_function(HAS_COLOUR, arg=clear.astype(int).tolist())
    feed.publisher.publish_status(StatusMessage(text="compiling kernel 12 of about 40"))
    wait_for_text(page, "silence", "compiling kernel 12 of about 40")
    feed.publisher.publish_status(StatusMessage(text="", version=FEED_VERSION + 1))
    wait_for_text(page, "level", "CANNOT READ")
    feed.speak()
    wait_for_text(page, "level", "CLEAR")
    page.wait_for_selector("#silence", state="hidden")
    # A monitor that runs before its robot does.
    feed.show("STOP", sequence=0)
    wait_for_text(page, "level", "WAITING")
    wait_for_text(
        page, "silence", "for the robot's joint states; the level is STOP until they arrive"
    )


def test_readers_of_the_screen_hear_of_levels_and_of_no_numbers(feed, page):
    feed.show("CLEAR")
    wait_for_text(page, "announcement", "CLEAR")
    page.evaluate("""() => {
        window.heard = [];
        const live = document.querySelectorAll(
            "[aria-live], [role=status], [role=alert], [role=log], output");
        for (const one of live) {
            new MutationObserver(() => heard.push(one.textContent)).observe(
                one, { childList: true, subtree: true, characterData: true });
        }
    }""")
    for time in (1.5, 1.6, 1.7):
        verdict = show_person("CLEAR")["verdict"]
        feed.show("CLEAR", verdict=msgspec.structs.replace(verdict, contact_time=time))
        wait_for_text(page, "contact", f"{time:.2f} s")
    feed.show("STOP")
    wait_for_text(page, "announcement", "STOP")
    heard = page.evaluate("() => heard")
    assert heard[-1] == "STOP"
    # A busy machine may be silent for a while, and lag behind what was shown before.
    assert set(heard) <= {*LEVELS, "NO DATA", "WAITING"}
    assert all(one != other for one, other in itertools.pairwise(heard))
    unnamed = "() => document.querySelectorAll('canvas:not([aria-label])').length"
    assert page.evaluate(unnamed) == 0


def test_buffers_do_not_grow_while_it_runs(feed, page):
    count = "() => [viewer.renderer.info.memory.geometries, viewer.scene.children.length]"
    feed.show("STOP")
    wait_for_text(page, "level", "STOP")
    page.wait_for_function("() => shapes.drawn.get('/armguard/pairs/first').count === 1")
    page.wait_for_timeout(3000)  # a busy machine draws meshes for a while after a reload
    before = page.evaluate(count)
    page.wait_for_timeout(2000)
    assert page.evaluate(count) == before
    # A crowd comes and goes, and comes again: what was made for it is freed or used again.
    held = []
    for _ in range(3):
        for crowd in (300, 3):
            names = [f"one{k}" for k in range(crowd)]
            points = np.random.default_rng(crowd).uniform(-2.0, 2.0, (crowd, 3))
            feed.show(obstacles=ObstacleShapes.pack(names, points, [0.1] * crowd), pairs=Pairs())
            wait_for_text(page, "source", f"· {crowd} obstacles")
            page.wait_for_function(
                "(count) => shapes.drawn.get('/armguard/obstacles/balls').count === count",
                arg=crowd,
            )
            settle(page)
        held.append(page.evaluate(count))
    assert held[2] == held[1]
    assert page.problems == []


def test_a_browser_without_webgl_says_so_and_shows_the_rest(feed, view, browser):
    feed.show("SLOW")
    page = open_page(browser)
    page.add_init_script("HTMLCanvasElement.prototype.getContext = ((original) => function (kind) {"
                         " return kind.includes('webgl') ? null : original.apply(this, arguments);"
                         " })(HTMLCanvasElement.prototype.getContext)")  # fmt: skip
    page.goto(view.url)
    wait_for_text(page, "notice", "WebGL")
    wait_for_text(page, "level", "SLOW")
    assert page.inner_text("#contact") == "250 ms"
    page.close()


def test_the_export_plays_from_a_file_without_a_network(view, browser, page):
    page.close()
    view.close()
    page = open_page(browser)
    page.context.set_offline(True)
    page.goto(view.export.as_uri())
    wait_for_text(page, "past", "FILM")
    page.get_by_label("jump to the next STOP").click()
    wait_for_text(page, "level", "STOP")
    page.wait_for_function("() => shapes.drawn.has('/armguard/cover')")
    assert page.problems == []
    page.close()


@contextlib.contextmanager
def busy_cell(browser, **options):
    """A page of a cell in which the arm has stopped and gone on every two seconds."""
    feed, page = Feed(robot="bare"), open_page(browser, **options)

    def tell(number):
        level = "STOP" if number % 2 else "CLEAR"
        feed.show(level, sequence=number + 1, now=2.0 * number)
        wait_for_text(page, "source", f"tick {number + 1} ")

    try:
        with launch(feed.publisher.address) as view:
            page.goto(view.url)
            wait_for_text(page, "level", "STOP")
            for number in range(12):
                tell(number)
            page.wait_for_function("() => document.querySelectorAll('#events button').length > 8")
            yield page, tell
    finally:
        feed.close()
    assert page.problems == []
    page.close()


HAS_FOCUS = "() => document.activeElement.getAttribute('aria-label') || ''"


def test_a_few_tabs_lead_to_what_goes_through_the_past_on_a_busy_cell(browser):
    wanted = {"pause", "jump to the next STOP", "live: back to the present"}
    with busy_cell(browser) as (page, tell):
        # What stands on a button is in its name.
        names = page.locator("button").evaluate_all(
            "(all) => all.map((one) => [one.textContent, one.getAttribute('aria-label')])"
        )
        assert all(text in (name or text) for text, name in names if text[0].isalpha())
        reached = []
        for number in range(12, 20):  # something happens between any two presses
            page.keyboard.press("Tab")
            reached.append(page.evaluate(HAS_FOCUS))
            tell(number)
        assert wanted <= set(reached)
        page.get_by_label("jump to the next STOP").focus()
        page.keyboard.press("Enter")
        wait_for_text(page, "past", "PAST")
        spoken = page.get_by_label("time", exact=True)
        assert spoken.get_attribute("aria-valuetext") == page.inner_text("#transport span")
        page.keyboard.press("Tab")
        page.keyboard.press("Enter")
        page.wait_for_selector("#past", state="hidden")
        assert spoken.get_attribute("aria-valuetext") == "the present"


def test_a_marker_keeps_the_focus_while_more_happens_and_arrows_lead_to_others(browser):
    with busy_cell(browser) as (page, tell):
        page.keyboard.press("Tab")
        newest = page.evaluate(HAS_FOCUS)
        page.evaluate("() => { window.held = document.activeElement; }")
        tell(12)
        tell(13)
        assert page.evaluate("() => document.activeElement === held")
        assert page.evaluate(HAS_FOCUS) == newest
        tab_stops = "() => document.querySelectorAll('#events button[tabindex=\"0\"]').length"
        page.keyboard.press("ArrowLeft")
        earlier = page.evaluate(HAS_FOCUS)
        assert earlier != newest
        assert page.evaluate(tab_stops) == 1
        page.keyboard.press("ArrowRight")
        assert page.evaluate(HAS_FOCUS) == newest
        page.keyboard.press("End")
        assert page.evaluate(HAS_FOCUS).startswith("26.00 s stop")
        page.keyboard.press("Home")
        first = page.evaluate(HAS_FOCUS)
        # It leaves the window: the focus goes to one that is still there.
        for number in range(14, 18):
            tell(number)
        assert "events" in page.evaluate("() => document.activeElement.parentElement.id")
        assert page.evaluate(HAS_FOCUS) != first
        page.keyboard.press("Enter")
        wait_for_text(page, "past", "PAST")


def test_a_reset_from_the_page_needs_the_token(browser):
    """A monitor that obeys "sesame" alone."""
    page, ended, latch = open_page(browser), threading.Event(), Latch(reason="a jump", since=0.0)
    with contextlib.closing(SocketInput("tcp://127.0.0.1:*")) as monitor:
        feed = Feed(robot="bare", reset_address=monitor.address, obeys_reset=True)
        feed.show("STOP", latches=(latch,))

        def obey():
            refused = 0
            while not ended.wait(0.005):
                message = monitor.receive() or b""
                if b"sesame" in message:
                    feed.show("CLEAR", refused_resets=refused, obeyed_resets=1)
                elif b"reset" in message:
                    refused += 1
                    feed.show("STOP", latches=(latch,), refused_resets=refused)

        listener = threading.Thread(target=obey)
        listener.start()
        try:
            with launch(feed.publisher.address) as view:
                page.goto(view.url)
                wait_for_text(page, "remedy", "token is on the command line")
                wait_for_room(page)
                page.fill("#token", "guessed")
                page.click("#reset button")
                wait_for_text(page, "outcome", "refused")
                page.wait_for_selector("#events .refused")
                assert page.is_visible("#latch")
                wait_for_room(page)
                page.fill("#token", "sesame")
                while page.is_visible("#latch"):  # at most one attempt a second is handed on
                    page.evaluate(
                        "() => document.getElementById('latch').hidden"
                        " || document.getElementById('reset').requestSubmit()"
                    )
                    page.wait_for_timeout(200)
                wait_for_text(page, "level", "CLEAR")
                page.wait_for_selector("#events .reset")
                assert page.input_value("#token") == ""
                # Where the reset was asked for is hidden: the focus stays nearby.
                assert page.evaluate("() => document.activeElement.id") == "panels"
        finally:
            ended.set()
            listener.join()
            feed.close()
    assert page.problems == []
    page.close()


def test_of_an_arm_alone_the_levels_of_its_tree_are_shown(browser):
    cover, page = make_scene().cover, open_page(browser)
    feed = Feed(robot="bare", levels=(cover[:1], cover))
    try:
        with launch(feed.publisher.address) as view:
            page.goto(view.url)
            wait_for_text(page, "depths", "level 0 of 1: 2 balls")
            page.locator("#depth").press("ArrowRight")
            wait_for_text(page, "depths", "level 1 of 1: 14 balls")
            page.wait_for_function("() => location.hash.includes('depth=1')")
            assert page.inner_text("#level") == "bare"
            assert not page.is_visible("#time")
    finally:
        feed.close()
    assert page.problems == []
    page.close()


def test_the_page_finds_back_to_a_view_that_was_restarted(browser):
    feed, page = Feed(robot="an arm without meshes"), open_page(browser)
    try:
        with launch(feed.publisher.address) as view:
            page.goto(view.url)
            wait_for_text(page, "level", "STOP")
            wait_for_text(page, "reasons", "the arm is not drawn")
            port = int(view.url.rstrip("/").rsplit(":", 1)[1])
        wait_for_text(page, "level", "NO VIEW")
        with launch(feed.publisher.address, port):
            wait_for_text(page, "level", "STOP")
            feed.close()
            wait_for_text(page, "silence", "the monitor has disconnected")
    finally:
        feed.close()
