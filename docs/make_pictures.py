"""Pictures for the documentation: `python docs/make_pictures.py [ROBOT …]`.

Each robot that armguard knows is drawn by the project's own view, its cover over its meshes, in a
browser without a screen (Debian's Chromium, driven by Playwright, both from the extra `test`).
`docs/make_view_pictures.py` makes those of the page.
"""

from __future__ import annotations

import io
import itertools
import sys
import time
from pathlib import Path

import numpy as np
from PIL import Image
from playwright.sync_api import Page, sync_playwright

from armguard.exceptions import ArmguardError
from armguard.robot import Kinematics, Robot
from armguard.robot.description import list_robots
from armguard.view import (
    FrameMessage,
    FramePublisher,
    LinkCover,
    SceneMessage,
    VerdictSummary,
    launch,
)
from armguard.view.arm import Arm

FOLDER = Path(__file__).resolve().parent / "covers"
CHROMIUM = "/usr/bin/chromium"
FLAGS = [
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
]
# Nothing but the robot, and not greyed out while drawing takes longer than a feed may be silent.
STYLE = """
body { display: block !important }
body > :not(#stage), #presets { display: none !important }
#stage { width: 100vw; height: 100vh }
#pane { filter: none !important }
"""
PERIOD = 1e-3
COLOURS = 200  # in the file: keeps it small
DIRECTION = np.array([0.8, -0.5, 0.35])  # from the robot to the camera
PATIENCE = 300.0  # [s]: drawing by software may take minutes
VISIBLE = 0.79, 0.69  # width and height of what is seen at a distance of 1

# Whether the page has the cover and so many meshes, each with triangles; and: until both are drawn.
IS_THERE = """(meshes) => {
    const find = (...path) => viewer.scene_tree.find(["armguard", ...path]);
    const isThere = (node) => {
        let found = false;
        node.children["<object>"]?.object.traverse((part) => { found ||= part.isMesh === true; });
        return found;
    };
    const parts = Object.values(find("arm").children).filter(isThere);
    return parts.length === meshes && isThere(find("cover"));
}"""
# Until a picture that is begun from now on is on the screen, or nothing is to be drawn.
SETTLE = """() => new Promise((done) => {
    const wanted = pace.begun + 1;
    const look = () => {
        const isDrawn = pace.finished >= wanted || !(viewer.needs_render || pace.fence);
        requestAnimationFrame(isDrawn ? () => requestAnimationFrame(done) : look);
    };
    requestAnimationFrame(look);
})"""

# Postures in which an arm does not hide itself, in [rad] or [m]; others are drawn at rest.
POSTURES = {
    "panda": (0.0, -0.4, 0.0, -2.0, 0.0, 1.7, 0.8),
    "xarm7": (0.0, -0.4, 0.0, 1.2, 0.0, 1.4, 0.0),
    "ur5": (0.0, -1.2, 1.5, -0.4, 1.57, 0.0),
    "ur10": (0.0, -1.2, 1.5, -0.4, 1.57, 0.0),
    "kinova": (0.0, 2.6, 1.6, 0.0, 1.2, 0.0),
}


def choose_posture(robot: Robot) -> np.ndarray:
    """Joint positions to be drawn in, in [rad] or [m]. Shape (nv,)."""
    wanted = np.array(POSTURES.get(robot.name, np.zeros(len(robot.joints))))
    return np.clip(wanted, robot.lower_position_limit, robot.upper_position_limit)


def take_picture(page: Page, name: str) -> None:
    """Draw one robot and save its picture."""
    robot = Robot.load(name)
    q = choose_posture(robot)
    kinematics = Kinematics(robot)
    kinematics.compute(q, np.zeros_like(q))
    lower = np.minimum(kinematics.centers.min(axis=0), 0.0) - 0.1
    upper = np.maximum(kinematics.centers.max(axis=0), 0.0) + 0.1
    width, height = float(np.hypot(*(upper - lower)[:2])), float((upper - lower)[2])
    middle = 0.5 * (lower + upper)
    distance = 1.2 * max(height / VISIBLE[1], width / VISIBLE[0])
    camera = middle + DIRECTION / np.linalg.norm(DIRECTION) * distance
    covers = [
        LinkCover.pack(
            link, str(robot.model.names[robot.joint_index(link)]), robot.cover.spheres(link)
        )
        for link in robot.links
    ]
    count = sum(len(robot.cover.spheres(link)) for link in robot.links)
    scene = SceneMessage(robot=name, joints=robot.joints, cover=tuple(covers), period=PERIOD)
    times = np.full(count, 0.3, dtype="<f4").tobytes()
    verdict = VerdictSummary(level="CLEAR", contact_time=np.inf, stop_time=0.1)
    publisher = FramePublisher("tcp://127.0.0.1:*")
    try:
        with launch(publisher.address) as view:
            page.goto(view.url + "#pixels=1")
            page.add_style_tag(content=STYLE)
            page.evaluate(
                "([camera, middle]) => {"
                " viewer.camera.position.set(camera[0], camera[2], -camera[1]);"
                " viewer.controls.target.set(middle[0], middle[2], -middle[1]);"
                " viewer.controls.update(); viewer.set_dirty(); }",
                [camera.tolist(), middle.tolist()],
            )
            meshes, end = len(Arm(scene).draw()), time.monotonic() + PATIENCE
            for sequence in itertools.count():
                if time.monotonic() > end:
                    raise ArmguardError(name, f"is not drawn in full within {PATIENCE:g} s")
                publisher.publish_scene(scene)
                publisher.publish_frame(
                    FrameMessage(
                        sequence=sequence,
                        now=0.2 * sequence,
                        q=tuple(q.tolist()),
                        verdict=verdict,
                        sphere_times=times,
                    )
                )
                page.wait_for_timeout(200)
                if page.evaluate(IS_THERE, meshes):
                    break
            page.evaluate(SETTLE)
            picture = Image.open(io.BytesIO(page.screenshot()))
    finally:
        publisher.close()
    FOLDER.mkdir(exist_ok=True)
    save(picture, FOLDER / f"{name}.png")


def save(picture: Image.Image, path: Path) -> None:
    """Write a picture with few colours, so that its file is small."""
    small = picture.convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE)
    small.save(path, optimize=True)


def main() -> None:
    """Make the pictures that are named, or those of all robots."""
    with (
        sync_playwright() as playwright,
        playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS) as browser,
    ):
        for name in sys.argv[1:] or list_robots():
            page = browser.new_page(viewport={"width": 640, "height": 560})
            page.set_default_timeout(120_000)
            take_picture(page, name)
            page.close()


if __name__ == "__main__":
    main()
