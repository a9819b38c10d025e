"""Finds obstacles against which an arm on a committed piece can press a body part."""

from __future__ import annotations

from typing import Any

import numpy as np

from armguard.bounds.planned.course import PlannedCourse
from armguard.jit.arrays import FloatArray, IntArray
from armguard.jit.kernels import kernel
from armguard.obstacles.regions import strictest_limit
from armguard.pairs.clamping import is_obstacle_near, is_same_person

NOTHING = -1.0
"""In place of a speed, where there is no such obstacle."""


@kernel
def find_obstacle_speeds(
    handle: Any, course: PlannedCourse, pairs: IntArray, now: float
) -> FloatArray:
    """How fast what each pair's link can press its obstacle against is at most, in [m]/[s].

    That is what gets within the gap of a ball around all that the link sweeps. NOTHING where there
    is none, and of obstacles that may never be touched, or be pressed by any way.

    Args:
        handle: On the `Scene`.
        course: Of the piece.
        pairs: Pair numbers, obstacle row × links + link. Shape (m,).
        now: In [s] on the clock of the obstacles' stamps.
    """
    scene = handle.content
    marks, links = scene.marks, scene.tree.root.shape[0]
    speeds = np.full(pairs.shape[0], NOTHING)
    until = course.end[course.end.shape[0] - 1] - (now - course.epoch)
    for i in range(pairs.shape[0]):
        row, link = pairs[i] // links, pairs[i] % links
        limit = strictest_limit(scene.contact_limits, marks.regions[row])
        if not limit.max_speed > 0.0 or limit.max_way == np.inf:
            continue
        gap = limit.gap + scene.settings.margin
        for other in range(marks.alive.shape[0]):
            if not marks.alive[other] or other == row or is_same_person(marks, row, other):
                continue
            ball = course.arm_ball
            near, speed = is_obstacle_near(
                ball[:3], ball[3] + gap, scene.bodies, marks, other, now, until
            )
            if not near:
                continue
            for block in range(course.block_balls.shape[0]):
                ball = course.block_balls[block, link]
                near, speed = is_obstacle_near(
                    ball[:3], ball[3] + gap, scene.bodies, marks, other, now, until
                )
                if near:
                    speeds[i] = max(speeds[i], speed)
                    break
    return speeds
