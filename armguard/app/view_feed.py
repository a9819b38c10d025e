"""From the monitor's loop to the view's feed: thirty times a second, what there is to see.

Called after each verdict was published. Most calls only look at the time; the others copy a
bounded amount, whatever the number of obstacles, and publish without waiting.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from armguard.app.loop import Durations
from armguard.monitor.monitor import Monitor
from armguard.obstacles.table import MOST_REFUSED
from armguard.verdict import Verdict
from armguard.view.buckets import compute_buckets
from armguard.view.messages import (
    FrameMessage,
    LinkCover,
    Load,
    ObstacleShapes,
    Pairs,
    SceneMessage,
    VerdictSummary,
)
from armguard.view.publisher import FramePublisher

INTERVAL = 1.0 / 30.0
"""Between two frames, in [s]."""

PAIR_LIMIT = 32
"""Lines drawn at most."""

ROW_LIMIT = 500
"""Obstacles drawn at most, the most imminent ones."""


class MonitorFeed:
    """Publishes what a monitor sees.

    Args:
        monitor: The monitor.
        publisher: Where its frames go.
        urdf: The robot's URDF, where it is not one that armguard knows.
        package_dirs: Folders in which that URDF's meshes are looked up.
    """

    def __init__(
        self,
        monitor: Monitor,
        publisher: FramePublisher,
        *,
        urdf: str = "",
        package_dirs: Sequence[str] = (),
    ) -> None:
        self._monitor = monitor
        self._publisher = publisher
        self._next = -math.inf
        self._urdf, self._package_dirs = urdf, package_dirs
        self._publish_scene()

    def observe(self, verdict: Verdict, now: float, durations: Durations, late: int) -> None:
        """Publish a frame if one is due.

        Args:
            verdict: The newest.
            now: Time of the monitor's clock, in [s].
            durations: How long ticks took so far.
            late: How many came late.
        """
        if now < self._next:
            return
        self._next = max(self._next + INTERVAL, now)
        if self._monitor.robot.revision != self._revision:
            self._publish_scene()
        load = Load(
            ticks=durations.count,
            late=late,
            evaluated=verdict.evaluated,
            p50=durations.percentile(50.0),
            p99=durations.percentile(99.0),
        )
        self._publisher.publish_frame(self._make_frame(verdict, now, load))

    def _publish_scene(self) -> None:
        self._revision = self._monitor.robot.revision
        scene = _make_scene(self._monitor, self._urdf, self._package_dirs)
        self._publisher.publish_scene(scene)

    def _make_frame(self, verdict: Verdict, now: float, load: Load) -> FrameMessage:
        monitor = self._monitor
        snapshot = monitor.snapshot(pair_limit=PAIR_LIMIT, row_limit=ROW_LIMIT)
        period = monitor.period
        sphere_times = snapshot.sphere_times
        if verdict.link is None and verdict.contact_time == 0.0:
            # Nothing is known about the arm, so everything may be about to touch it.
            sphere_times = np.zeros_like(sphere_times)
        table, rows = monitor.obstacles.table, snapshot.rows
        # A body that was never believed is shown where it was refused, if that is anywhere.
        accepted, refused, places = table.accepted, table.refused_states, rows * MOST_REFUSED
        believed = table.has_state[rows]
        points = np.where(believed[:, None, None], accepted.points[rows], refused.points[places])
        points[~believed & (table.refused_count[rows] == 0)] = np.nan
        return FrameMessage(
            sequence=verdict.sequence,
            now=now,
            q=tuple(snapshot.q.tolist()),
            verdict=VerdictSummary(
                level=verdict.level.name,
                contact_time=verdict.contact_time,
                stop_time=verdict.stop_time,
                speed_scale=verdict.speed_scale,
                link=verdict.link or "",
                obstacle=verdict.obstacle or "",
                complete=verdict.complete,
                reasons=tuple(str(reason) for reason in verdict.reasons[:4]),
            ),
            load=load,
            sphere_buckets=compute_buckets(sphere_times, period).tobytes(),
            obstacles=ObstacleShapes.pack(
                [monitor.obstacles.ids[row] for row in rows],
                points,
                np.where(believed, accepted.radius[rows], refused.radius[places]),
                counts=np.where(believed, accepted.point_count[rows], refused.point_count[places]),
                refused=table.refused[rows],
                buckets=compute_buckets(snapshot.row_times, period),
            ),
            pairs=Pairs.pack(snapshot.segments, compute_buckets(snapshot.pair_times, period)),
        )


def _make_scene(monitor: Monitor, urdf: str, package_dirs: Sequence[str]) -> SceneMessage:
    robot = monitor.robot
    covers = []
    for link in robot.links:
        tree = robot.cover.tree(link)
        leaves = tree.spheres[tree.child_count == 0]
        joint = robot.model.names[robot.joint_index(link)]
        covers.append(LinkCover.pack(link, joint, leaves))
    return SceneMessage(
        robot=robot.name,
        joints=tuple(robot.joints),
        cover=tuple(covers),
        period=monitor.period,
        base=tuple(monitor.base_placement.homogeneous.ravel().tolist()),
        urdf=urdf,
        package_dirs=tuple(package_dirs),
    )
