"""How smooth the page of the view is, beside an empty Meshcat scene in the same browser.

    python benchmarks/bench_page.py [--seconds 10] [--pixels 1]

Debian's Chromium draws without a screen and without a graphics card, so milliseconds are those of a
processor; what counts is the ratio to the empty scene, taken in the same run, before and after, and
how it compares with Meshcat's own page with the same arm in it, as Pinocchio shows it, and nothing
else. All scenes move, thirty times a second, and are drawn in a pane of the same size.

| column | what it is |
|---|---|
| picture | from the begin of a picture until its last pixel is there, by `performance.now()` |
| processor | time of all of the browser's processes for it, whatever else the machine does |
| ratio | of both to those of the empty scene: median, and processor |
| between | from one picture to the next while the feed speaks thirty times a second |
| script | time of the page's main thread for each of these: script, style, layout |
| pixels | share of the pixels of a row that the page draws; fewer where pictures take long |
"""

from __future__ import annotations

import argparse
import contextlib
import importlib.metadata
import io
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio
from pinocchio.visualize import MeshcatVisualizer
from playwright.sync_api import Browser, CDPSession, Page, sync_playwright

from armguard.app.view_feed import PAIR_LIMIT, pack_cover
from armguard.robot import Robot
from armguard.robot.description import find_example_urdf
from armguard.view import (
    FrameMessage,
    FramePublisher,
    ObstacleShapes,
    Pairs,
    SceneMessage,
    VerdictSummary,
    launch,
)
from scene.machine import describe_machine

CHROMIUM = "/usr/bin/chromium"
FLAGS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
MESHCAT = Path(
    str(importlib.metadata.distribution("meshcat").locate_file("meshcat/viewer/dist/index.html"))
)
WINDOW = {"width": 1280, "height": 800}
COUNTS = (0, 100, 1000)
INTERVAL = 1.0 / 30.0
READY = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
PATIENCE = 300_000.0  # [ms]
SETTLING = 5.0  # [s]: meshes come one by one, and the pace finds its pixels
PICTURES = 20
PANDA_PARTS = 11  # meshes of its visual model; some are drawn as several

# Pictures one after the other, each until its last pixel is there.
DRAW = """async (count) => {
    const gl = viewer.renderer.getContext(), pixel = new Uint8Array(4), times = [];
    for (let k = 0; k < count; k++) {
        await new Promise((done) => setTimeout(done, 0));
        const begin = performance.now();
        viewer.render();
        gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
        times.push(performance.now() - begin);
    }
    return times;
}"""
LISTEN = """() => {
    const draw = viewer.render.bind(viewer);
    window.moments = [];
    viewer.render = () => { moments.push(performance.now()); draw(); };
}"""
KEEP_MOVING = "() => { setInterval(() => viewer.set_dirty(), 1000 / 30); }"
HAS_PARTS = """(parts) => {
    let count = 0;
    viewer.scene.traverse((node) => { count += node.isMesh === true; });
    return count >= parts;
}"""
IS_THERE = """(obstacles) => typeof shapes !== "undefined" && shapes.drawn.has("/armguard/cover")
    && shapes.drawn.get("/armguard/obstacles/balls")?.count === obstacles
    && Object.values(viewer.scene_tree.find(["armguard", "arm"]).children)
        .filter((node) => node.children["<object>"] !== undefined).length > 10"""


class Feed:
    """Speaks as a monitor does: an arm that moves among balls that go around it.

    Args:
        count: How many balls.
    """

    def __init__(self, count: int) -> None:
        robot = Robot.load("panda")
        self._count = count
        self._cover = pack_cover(robot)
        self._publisher = FramePublisher("tcp://127.0.0.1:*")
        self.address = self._publisher.address
        self._publisher.publish_scene(
            SceneMessage(robot="panda", joints=robot.joints, cover=self._cover, period=1e-3)
        )
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def close(self) -> None:
        """Fall silent."""
        self._ended.set()
        self._thread.join()
        self._publisher.close()

    def _run(self) -> None:
        number = 0
        while not self._ended.wait(INTERVAL):
            number += 1
            self._publisher.publish_frame(self._make_frame(number))

    def _make_frame(self, number: int) -> FrameMessage:
        count, random = self._count, np.random.default_rng(0)
        angle = random.uniform(0.0, 2.0 * np.pi, count) + 0.02 * number
        distance, height = random.uniform(0.8, 2.0, count), random.uniform(0.0, 1.5, count)
        points = np.column_stack([distance * np.cos(angle), distance * np.sin(angle), height])
        times = np.sort(random.uniform(0.3, 2.0, count))
        lines = min(PAIR_LIMIT, count)
        balls = sum(len(link.spheres) for link in self._cover)
        return FrameMessage(
            sequence=number,
            now=number * INTERVAL,
            q=tuple((READY + 0.2 * np.sin(0.1 * number + np.arange(7))).tolist()),
            verdict=VerdictSummary(level="AWARE", contact_time=0.4, stop_time=0.2),
            sphere_times=np.full(balls, 0.5, "<f4").tobytes(),
            obstacles=ObstacleShapes.pack(
                [f"ball{k}" for k in range(count)], points, np.full(count, 0.08), times=times
            ),
            pairs=Pairs.pack(np.arange(lines) % len(self._cover), np.arange(lines), times[:lines]),
        )


def measure(page: Page, browser: CDPSession, seconds: float) -> dict[str, Any]:
    """What is said of one page that moves."""
    session = page.context.new_cdp_session(page)
    session.send("Performance.enable")
    page.evaluate(LISTEN)
    begin = _read_script(session)
    page.wait_for_timeout(1000.0 * seconds)
    script = _read_script(session) - begin
    moments = page.evaluate("() => moments")
    begin = _read_processor(browser)
    pictures = np.array(page.evaluate(DRAW, PICTURES))
    processor = _read_processor(browser) - begin
    return {
        "between": np.diff(moments) if len(moments) > 1 else np.array([np.inf]),
        "picture": pictures,
        "processor": 1e3 * processor / PICTURES,
        "script": 1e3 * script / max(len(moments), 1),
        "pixels": page.evaluate("() => viewer.renderer.getPixelRatio()"),
    }


def _read_processor(browser: CDPSession) -> float:
    """Time of all processes of the browser so far, in [s]."""
    found = browser.send("SystemInfo.getProcessInfo")["processInfo"]
    return float(sum(process["cpuTime"] for process in found))


def _read_script(session: CDPSession) -> float:
    """Time of the page's main thread for script, style and layout so far, in [s]."""
    found = {one["name"]: one["value"] for one in session.send("Performance.getMetrics")["metrics"]}
    names = ("ScriptDuration", "LayoutDuration", "RecalcStyleDuration")
    return float(sum(found[name] for name in names))


def show_panda() -> str:
    """Meshcat's page with a Panda in it, as `pinocchio.visualize` shows it: one HTML file."""
    urdf, packages = find_example_urdf("panda_description/urdf/panda.urdf")
    visualizer = MeshcatVisualizer(*pinocchio.buildModelsFromUrdf(str(urdf), str(packages)))
    with contextlib.redirect_stdout(io.StringIO()):  # it tells its address
        visualizer.initViewer(open=False)
    visualizer.loadViewerModel()
    visualizer.display(np.append(READY, [0.02, 0.02]))
    return str(visualizer.viewer.static_html())


def measure_meshcat(
    browser: Browser, session: CDPSession, seconds: float, address: str, parts: int = 0
) -> dict[str, Any]:
    """Meshcat's own page, drawn anew thirty times a second once so many meshes are in it."""
    page = browser.new_page(viewport=PANE)
    page.set_default_timeout(PATIENCE)
    page.goto(address)
    page.wait_for_function("() => typeof viewer !== 'undefined'")
    page.wait_for_function(HAS_PARTS, arg=parts)
    page.evaluate(KEEP_MOVING)
    try:
        return measure(page, session, seconds)
    finally:
        page.close()


def measure_page(
    browser: Browser, session: CDPSession, count: int, seconds: float, pixels: float | None
) -> dict[str, Any]:
    """The page with a Panda and so many obstacles."""
    feed = Feed(count)
    page = browser.new_page(viewport=WINDOW)
    page.set_default_timeout(PATIENCE)
    try:
        with launch(feed.address, floor=-0.75) as view:
            page.goto(view.url + ("" if pixels is None else f"#pixels={pixels}"))
            page.wait_for_function(IS_THERE, arg=count)
            time.sleep(SETTLING)
            size = page.evaluate(
                "() => [viewer.dom_element.clientWidth, viewer.dom_element.clientHeight]"
            )
            PANE.update(width=size[0], height=size[1])
            return measure(page, session, seconds)
    finally:
        page.close()
        feed.close()


PANE = {"width": 976, "height": 600}


def describe(name: str, found: dict[str, Any], empty: list[dict[str, Any]]) -> str:
    """A row of the table."""
    picture, between = (np.percentile(found[key], [50, 99, 100]) for key in ("picture", "between"))
    ratios = [
        np.median(found[key]) / np.mean([np.median(other[key]) for other in empty])
        for key in ("picture", "processor")
    ]
    return (
        f"| {name} | {picture[0]:.0f} / {picture[1]:.0f} / {picture[2]:.0f} "
        f"| {found['processor']:.0f} | {ratios[0]:.1f}, {ratios[1]:.1f} "
        f"| {between[0]:.0f} / {between[1]:.0f} / {between[2]:.0f} | {found['script']:.1f} "
        f"| {found['pixels']:.2f} |"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=10.0, help="that each page is watched")
    parser.add_argument("--pixels", type=float, help="share that the page is held to")
    arguments = parser.parse_args()
    with (
        sync_playwright() as playwright,
        playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS) as browser,
    ):
        session = browser.new_browser_cdp_session()
        empty_page = MESHCAT.as_uri()
        with tempfile.TemporaryDirectory() as folder:
            shown = Path(folder, "panda.html")
            shown.write_text(show_panda(), encoding="utf-8")
            rows = [
                (name, measure_meshcat(browser, session, arguments.seconds, address, parts))
                for name, address, parts in (
                    ("Meshcat, empty", empty_page, 0),
                    ("Meshcat, Panda", shown.as_uri(), PANDA_PARTS),
                )
            ]
        for count in COUNTS:
            name = f"Panda and {count} obstacles" if count else "Panda"
            found = measure_page(browser, session, count, arguments.seconds, arguments.pixels)
            rows.append((name, found))
        again = measure_meshcat(browser, session, arguments.seconds, empty_page)
        rows.append(("Meshcat, empty, again", again))
    empty = [found for name, found in rows if "empty" in name]
    print(f"{describe_machine()}; pane {PANE['width']} x {PANE['height']}\n")
    print("| scene | picture p50 / p99 / max [ms] | processor [ms] | ratio "
          "| between p50 / p99 / max [ms] | script [ms] | pixels |")  # fmt: skip
    print("|---|---|---|---|---|---|---|")
    for name, found in rows:
        print(describe(name, found, empty))


if __name__ == "__main__":
    main()
