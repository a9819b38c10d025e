"""Pictures of the page for docs/view.md: `python docs/make_view_pictures.py [NAME …]`.

A Panda works while a person comes, reaches in and goes, as in the demo, judged in one process with
a clock of its own, so that the pictures are the same each time. What a monitor would tell is handed
to a view as it is, and Debian's Chromium (driven by Playwright, both from the extra `test`) shows
it.
"""

from __future__ import annotations

import io
import sys
import tempfile
import time
from collections.abc import Callable
from datetime import datetime
from pathlib import Path

import msgspec
import numpy as np
from make_pictures import CHROMIUM, FLAGS
from PIL import Image
from playwright.sync_api import Browser, Page, sync_playwright

import armguard
from armguard import Monitor, Obstacles, OperatingLimits, Robot, Shield
from armguard.app.loop import Durations
from armguard.app.view_feed import MonitorFeed
from armguard.exceptions import ArmguardError
from armguard.lab.demo import nodes
from armguard.lab.demo.launcher import FLOOR
from armguard.lab.demo.places import find_place
from armguard.lab.simulation import SimulatedArm, keeps_within, random_trajectory
from armguard.verdict import ReasonKind
from armguard.view import (
    FrameMessage,
    FramePublisher,
    ObstacleShapes,
    Pairs,
    SceneMessage,
    VerdictSummary,
    ViewProcess,
    launch,
)
from armguard.view.messages import FEED_VERSION, Latch, Message, Origin, StatusMessage

FOLDER = Path(__file__).resolve().parent / "pictures"
SIZE = (1280, 800)
DURATION, PERIOD = 20.0, 0.01
WARM = 1.0  # [s] of the scene after which ticks are timed; before, caches fill
BEGIN = datetime(2026, 3, 2, 14, 3).timestamp()
LEVELS = ("CLEAR", "AWARE", "SLOW", "STOP")
EYES = ("deuteranopia", "protanopia", "tritanopia")
CROWD = 1000
PATIENCE = 300.0  # [s]: drawing by software may take minutes

IS_DRAWN = """() => {
    const arm = viewer.scene_tree.find(["armguard", "arm"]);
    return shapes.drawn.has("/armguard/cover") && Object.values(arm.children)
        .filter((node) => node.children["<object>"] !== undefined).length > 10;
}"""
PLACE = "() => viewer.camera.position.toArray()"
IS_RESTING = "() => !viewer.needs_render && !pace.fence"


class Collection:
    """Stands for a publisher: keeps what a monitor tells."""

    def __init__(self) -> None:
        self.scenes: list[SceneMessage] = []
        self.frames: list[FrameMessage] = []

    def publish_scene(self, scene: SceneMessage) -> None:
        """Keep the scene."""
        self.scenes.append(scene)

    def publish_frame(self, frame: FrameMessage) -> None:
        """Keep a moment."""
        self.frames.append(frame)


def play() -> Collection:
    """What a monitor tells while the person of the demo comes and goes."""
    robot, place = Robot.load("panda"), find_place("panda")
    (source,) = nodes.make_sources(DURATION, "", 0, 0)
    obstacles, told = Obstacles(sources=[source.name]), Collection()
    monitor = Monitor(robot, obstacles, rate=1.0 / PERIOD)
    trajectory = random_trajectory(
        robot,
        0,
        nodes.WORK_CYCLE,
        speed_fraction=nodes.SPEED_FRACTION,
        accept=keeps_within(robot, place.lower, place.upper),
    )
    arm, durations, scale = SimulatedArm(trajectory), Durations(), 0.0
    origin = Origin(obeys_reset=True, reset_address="tcp://127.0.0.1:5702", recording="cell7.mcap")
    feed = MonitorFeed(monitor, told, origin)  # type: ignore[arg-type]
    for tick in range(1, round(DURATION / PERIOD)):
        now = tick * PERIOD
        source.publish(obstacles, now)
        q, v = arm.step(PERIOD, scale)
        begin = time.thread_time()
        verdict = monitor.step(now, q, v)
        if now > WARM:
            durations.add(time.thread_time() - begin)
        scale = verdict.speed_scale
        feed.observe(verdict, now, durations, 0, wall=BEGIN + now)
    return told


def play_shield() -> Collection:
    """The same while a shield moves the arm, from waypoint to waypoint."""
    robot, place = Robot.load("panda"), find_place("panda")
    (source,) = nodes.make_sources(DURATION, "", 0, 0)
    obstacles, told = Obstacles(sources=[source.name]), Collection()
    rate = 1.0 / PERIOD
    limits = OperatingLimits.fraction(
        robot, velocity=nodes.SHIELDED_SPEED_FRACTION, acceleration=0.25
    )
    monitor = Monitor(robot, obstacles, rate=rate, motion="planned", operating=limits, payload=0.0)
    shield = Shield(monitor, jerk=500.0, rate=rate)
    waypoints = nodes.make_trajectory(robot, place, 0).waypoints
    q, v, durations, ways = waypoints[0], np.zeros(len(robot.joints)), Durations(), 1
    shield.set_path(armguard.Path([q, waypoints[ways]]))
    feed = MonitorFeed(monitor, told)  # type: ignore[arg-type]
    for tick in range(1, round(DURATION / PERIOD)):
        now = tick * PERIOD
        source.publish(obstacles, now)
        if shield.progress == 1.0 and np.abs(v).max() < 1e-9:
            ways += 1
            shield.set_path(armguard.Path([q, waypoints[ways % len(waypoints)]]))
        command = shield.step(now, q, v)
        feed.note(command.verdict, now, command)
        feed.publish(now, durations, 0, wall=BEGIN + now, shield=shield)
        q, v, _ = command.at(now + PERIOD)
    return told


class Stage:
    """A view, and a page of it that is shown what has been collected.

    Args:
        browser: To show it in.
        told: What a monitor told.
        export: Where the view writes a film at its end; None: nowhere.
    """

    def __init__(self, browser: Browser, told: Collection, export: Path | None = None) -> None:
        self.told = told
        self._publisher = FramePublisher("tcp://127.0.0.1:*", is_patient=True)
        self._view: ViewProcess = launch(self._publisher.address, floor=FLOOR, export=export)
        self.page = open_page(browser)
        self.page.goto(self._view.url + "#pixels=1")
        self._last: Message = StatusMessage(text="")

    def close(self) -> None:
        """End the view; an export is written by then."""
        self.page.close()
        self._view.close()
        self._publisher.close()

    def show(self, count: int, **changes: object) -> None:
        """Show the first moments, as if the last of them were the present.

        Args:
            count: How many.
            changes: Of the last one.
        """
        self._publisher.publish_scene(self.told.scenes[-1])
        frames = self.told.frames[:count]
        last = msgspec.structs.replace(frames[-1], **changes)
        for frame in [*frames[:-1], last]:
            self._publisher.publish_frame(frame)
        self._last = last

    def tell(self, message: Message) -> None:
        """Tell something that is no moment, again and again while it is waited for."""
        self._last = message

    def wait(self, condition: Callable[[Page], bool]) -> None:
        """Repeat the present until something holds."""
        end = time.monotonic() + PATIENCE
        while not condition(self.page):
            if time.monotonic() > end:
                raise ArmguardError("page", f"is not as it should be within {PATIENCE:g} s")
            self.repeat()

    def repeat(self) -> None:
        """Tell the present once more."""
        if isinstance(self._last, FrameMessage):
            self._publisher.publish_frame(self._last)
        elif isinstance(self._last, StatusMessage):
            self._publisher.publish_status(self._last)
        self.page.wait_for_timeout(150)

    def settle(self) -> None:
        """Repeat the present until the camera rests and pictures of it are finished."""
        self.wait(lambda page: bool(page.evaluate(IS_DRAWN)))
        before = [np.nan] * 3
        while not np.allclose(place := self.page.evaluate(PLACE), before, atol=1e-4):
            before = place
            self.repeat()
            self.wait(lambda page: bool(page.evaluate(IS_RESTING)))

    def take(self, name: str, size: tuple[int, int] = SIZE) -> None:
        """Save a picture of the present."""
        self.page.set_viewport_size({"width": size[0], "height": size[1]})
        self.settle()
        save(take_screenshot(self.page), FOLDER / f"{name}.webp")


def open_page(browser: Browser) -> Page:
    """A page that is patient."""
    page = browser.new_page(viewport={"width": SIZE[0], "height": SIZE[1]})
    page.set_default_timeout(1000.0 * PATIENCE)
    return page


def take_screenshot(page: Page) -> Image.Image:
    """What the page shows."""
    return Image.open(io.BytesIO(page.screenshot())).convert("RGB")


def has_text(element: str, text: str) -> Callable[[Page], bool]:
    """Whether an element of the page has this text in it."""
    return lambda page: text in (page.text_content(f"#{element}") or "")


def save(picture: Image.Image, path: Path) -> None:
    """Write a picture with all of its colours, small."""
    picture.save(path, quality=88, method=6)


def find(told: Collection, level: str) -> int:
    """How many moments there are up to the middle of the longest time at a level."""
    best, begin = (0, 0), None
    for place, frame in enumerate([*told.frames, None]):
        if frame is not None and frame.verdict.level == level:
            begin = place if begin is None else begin
        elif begin is not None:
            best, begin = max(best, (place - begin, begin)), None
    if not best[0]:
        raise ArmguardError("the scene", f"has no {level} in it")
    # Not before some of it is seen in the strip.
    return best[1] + best[0] // 2 + 1


def take_levels(stage: Stage) -> None:
    """The page at each level, as it is on desks and on phones."""
    for level in LEVELS:
        stage.show(find(stage.told, level))
        stage.wait(has_text("level", level))
        stage.take(level.lower())
        if level == "SLOW":
            stage.take("phone", (360, 640))
            stage.take("laptop", (1366, 600))
        if level == "STOP":
            take_eyes(stage)


def take_eyes(stage: Stage) -> None:
    """The same picture as eyes see it that tell fewer colours apart."""
    stage.page.set_viewport_size({"width": 760, "height": 560})
    session, seen = stage.page.context.new_cdp_session(stage.page), []
    for kind in EYES:
        session.send("Emulation.setEmulatedVisionDeficiency", {"type": kind})
        stage.settle()
        seen.append(take_screenshot(stage.page))
    session.send("Emulation.setEmulatedVisionDeficiency", {"type": "none"})
    row = Image.new("RGB", (sum(one.width for one in seen), seen[0].height))
    for place, one in enumerate(seen):
        row.paste(one, (place * one.width, 0))
    save(row, FOLDER / "eyes.webp")


def take_past(stage: Stage) -> None:
    """A STOP that is over, looked at again."""
    stage.show(len(stage.told.frames))
    stage.wait(has_text("source", f"{stage.told.frames[-1].sequence}"))
    stage.settle()
    stage.page.locator("#events .stop").first.click()
    stage.wait(has_text("past", "PAST"))
    stage.wait(has_text("level", "STOP"))
    stage.take("past")
    stage.page.get_by_label("back to the present").click()


def take_latched(stage: Stage) -> None:
    """A STOP that a reset alone ends, after a reset with a token that was not the run's."""
    count = find(stage.told, "STOP")
    now = stage.told.frames[count - 1].now
    reason = "gap in joint states: 0.412 s without one"
    verdict = msgspec.structs.replace(
        stage.told.frames[count - 1].verdict,
        reasons=(f"latched: {reason}",),
        effects=("latched",),
        contact_time=0.0,
        speed_scale=0.0,
        since=now - 1.3,
        cause="",
        rises_at=None,
    )
    remedy = ReasonKind.JOINT_STATE_GAP.remedy
    latches = (Latch(reason=reason, since=now - 1.3, remedy=remedy),)
    stage.show(count, verdict=verdict, latches=latches, refused_resets=1)
    stage.wait(has_text("latches", "gap"))
    stage.take("latched")


def take_crowd(stage: Stage) -> None:
    """More obstacles than can be drawn in full."""
    random, count = np.random.default_rng(0), find(stage.told, "AWARE")
    points = random.uniform((-3.5, -3.5, -0.6), (3.5, 3.5, 1.8), (3 * CROWD, 3))
    points = points[np.hypot(*points[:, :2].T) > 1.1][:CROWD]
    obstacles = ObstacleShapes.pack(
        [f"part{k}" for k in range(len(points))],
        points,
        np.full(len(points), 0.06),
        times=0.3 + 0.35 * np.hypot(*points[:, :2].T),
    )
    pairs = msgspec.structs.replace(stage.told.frames[count - 1].pairs)
    stage.show(count, obstacles=obstacles, pairs=pairs, omitted=260)
    stage.wait(has_text("reasons", "least detail"))
    stage.take("crowd")


def take_silence(stage: Stage) -> None:
    """A monitor that says nothing any more."""
    stage.show(find(stage.told, "AWARE"))
    stage.wait(has_text("level", "AWARE"))
    stage.take("silence")  # all is drawn; and then nothing comes any more
    stage.page.wait_for_function("() => document.getElementById('level').textContent === 'NO DATA'")
    stage.page.wait_for_timeout(1000)
    save(take_screenshot(stage.page), FOLDER / "silence.webp")


def take_beginnings(browser: Browser, told: Collection) -> None:
    """What the page says before there is anything to be seen, in one picture."""
    stage, seen = Stage(browser, told), []
    stage.page.set_viewport_size({"width": 640, "height": 400})

    def keep(element: str, text: str) -> None:
        stage.wait(has_text(element, text))
        stage.page.wait_for_timeout(500)
        seen.append(take_screenshot(stage.page))

    try:
        stage.tell(StatusMessage(text="compiling kernel 12 of about 220 (once; kept for the next)"))
        keep("silence", "12 of")
        verdict = VerdictSummary(
            level="STOP",
            contact_time=0.0,
            stop_time=np.inf,
            reasons=("no joint state yet",),
            effects=("standing",),
        )
        cover = sum(len(link.spheres) for link in told.scenes[-1].cover)
        stage.show(
            1,
            sequence=0,
            verdict=verdict,
            sphere_times=np.zeros(cover, "<f4").tobytes(),
            obstacles=ObstacleShapes(),
            pairs=Pairs(),
            sources=(),
            load=None,
        )
        stage.settle()
        keep("level", "WAITING")
        stage.tell(StatusMessage(text="", version=FEED_VERSION + 1))
        keep("level", "CANNOT READ")
    finally:
        stage.close()
    row = Image.new("RGB", (seen[0].width * len(seen), seen[0].height))
    for place, one in enumerate(seen):
        row.paste(one, (place * one.width, 0))
    save(row, FOLDER / "beginnings.webp")


def take_shield(browser: Browser, told: Collection) -> None:
    """An arm that a shield slows down beside the person, halfway on its way down."""
    told = play_shield()
    slow = [
        (float(np.ptp(np.frombuffer(frame.plan, "<f4").reshape(-1, 7), axis=0).max()), place)
        for place, frame in enumerate(told.frames)
        if frame.command is not None and frame.command.reason and 0.3 < frame.command.scale < 0.8
    ]
    stage = Stage(browser, told)
    try:
        stage.show(max(slow)[1] + 1)
        stage.wait(has_text("slower", "slower"))
        stage.page.locator("#presets").get_by_text("top").click()  # where ways are seen best
        stage.take("shield")
    finally:
        stage.close()


def take_film(browser: Browser, told: Collection) -> None:
    """An exported film, opened from its file."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene.html"
        stage = Stage(browser, told, export=path)
        try:
            stage.show(len(told.frames))
            stage.settle()
        finally:
            stage.close()
        page = open_page(browser)
        page.context.set_offline(True)
        page.goto(f"{path.as_uri()}#pixels=1")
        page.wait_for_function(IS_DRAWN)
        page.get_by_label("jump to the next STOP").click()
        page.wait_for_function("() => document.getElementById('level').textContent === 'STOP'")
        page.wait_for_timeout(5000)
        save(take_screenshot(page), FOLDER / "film.webp")
        page.close()


def main() -> None:
    """Make the pictures that are named, or all."""
    parts: dict[str, Callable[[Stage], None]] = {
        "levels": take_levels,
        "past": take_past,
        "latched": take_latched,
        "crowd": take_crowd,
        "silence": take_silence,
    }
    others = {"beginnings": take_beginnings, "film": take_film, "shield": take_shield}
    wanted = sys.argv[1:] or [*parts, *others]
    FOLDER.mkdir(exist_ok=True)
    told = play()
    with (
        sync_playwright() as playwright,
        playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS) as browser,
    ):
        if set(wanted) & parts.keys():
            stage = Stage(browser, told)
            try:
                for name in parts:
                    if name in wanted:
                        parts[name](stage)
            finally:
                stage.close()
        for name in others:
            if name in wanted:
                others[name](browser, told)


if __name__ == "__main__":
    main()
