"""`armguard show`: shows an arm, its cover and the levels of the cover's tree, without a cell."""

from __future__ import annotations

import contextlib
import tempfile
import time
import webbrowser

import numpy as np
from numpy.typing import NDArray

from armguard.app import cli
from armguard.app.processes import COMPLAINT, complain
from armguard.app.terminal import make_console
from armguard.cover.cover import Cover
from armguard.lab.covers import Target, fit_cover
from armguard.robot.links import UrdfLinks
from armguard.robot.robot import Robot
from armguard.view.messages import FrameMessage, LinkCover, SceneMessage, VerdictSummary
from armguard.view.process import launch
from armguard.view.publisher import FramePublisher

INTERVAL = 0.5
"""Between two frames, in [s]: nothing moves, and pages that come late are told."""


def show_arm(wishes: cli.Show) -> int:
    """Serve a page that shows an arm until Ctrl-C; the exit code.

    Args:
        wishes: What the command line says.

    Raises:
        ArmguardError: There is no such robot, or it cannot be covered or shown.
    """
    target = Target(wishes.robot, None, wishes.package_dirs)
    console = make_console()
    if isinstance(target.robot, UrdfLinks):
        cover = fit_cover(target.robot, None, None)
    else:
        cover = target.robot.cover if target.cover is None else Cover.load(target.cover)
    scene = make_scene(target, cover)
    q = choose_posture(target.robot)
    spheres = sum(len(link.spheres) for link in scene.cover)
    frame = FrameMessage(
        sequence=1,
        now=0.0,
        q=tuple(q.tolist()),
        verdict=VerdictSummary(level="", contact_time=np.inf, stop_time=0.0),
        sphere_times=np.full(spheres, np.inf, dtype="<f4").tobytes(),
    )
    with contextlib.ExitStack() as resources:
        folder = resources.enter_context(tempfile.TemporaryDirectory(prefix="armguard-"))
        publisher = resources.enter_context(FramePublisher(f"ipc://{folder}/frames"))
        page = resources.enter_context(launch(publisher.address, wishes.port))
        console.print(f"see it in the browser: {page.url}", soft_wrap=True)
        if wishes.open:
            webbrowser.open(page.url)
        with contextlib.suppress(KeyboardInterrupt):
            while page.running:
                publisher.publish_scene(scene)
                publisher.publish_frame(frame)
                time.sleep(INTERVAL)
            complain("the process of the view has ended")
            return COMPLAINT
    return 0


def make_scene(target: Target, cover: Cover) -> SceneMessage:
    """What a view is told of an arm that is alone.

    Args:
        target: The arm.
        cover: Its cover.
    """
    robot = target.robot
    depth = max(int(measure_depths(cover, link).max()) for link in robot.links)
    levels = tuple(
        tuple(_pack_level(robot, cover, link, level) for link in robot.links)
        for level in range(depth + 1)
    )
    return SceneMessage(
        robot=robot.name,
        joints=tuple(str(joint) for joint in robot.model.names)[1:],
        cover=levels[-1],
        period=1e-3,
        urdf="" if target.is_known else str(target.urdf.resolve()),
        package_dirs=() if target.is_known else tuple(map(str, target.folders)),
        levels=levels,
    )


def measure_depths(cover: Cover, link: str) -> NDArray[np.int64]:
    """How far below its root each ball of a link's tree is. Shape (n,)."""
    tree = cover.tree(link)
    depths = np.zeros(len(tree.spheres), dtype=np.int64)
    # Parents stand before their children.
    for ball, (first, count) in enumerate(zip(tree.first_child, tree.child_count, strict=True)):
        depths[first : first + count] = depths[ball] + 1
    return depths


def choose_posture(robot: Robot | UrdfLinks) -> NDArray[np.float64]:
    """Joint positions to be shown in, as near to zero as limits allow, in [rad] or [m]. (nv,)."""
    model = robot.model
    if isinstance(robot, Robot):
        lower, upper = robot.lower_position_limit, robot.upper_position_limit
    else:
        lower, upper = model.lowerPositionLimit, model.upperPositionLimit
    q: NDArray[np.float64] = np.clip(np.zeros(model.nv), lower, upper)
    return q


def _pack_level(robot: Robot | UrdfLinks, cover: Cover, link: str, level: int) -> LinkCover:
    """The balls of one level: those at its depth, and leaves above it; they cover the link."""
    tree, depths = cover.tree(link), measure_depths(cover, link)
    chosen = (depths == level) | ((depths < level) & (tree.child_count == 0))
    joint = str(robot.model.names[robot.joint_index(link)])
    return LinkCover.pack(link, joint, tree.spheres[chosen])
