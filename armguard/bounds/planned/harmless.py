"""The time from which a sphere on a course stays harmless: slow enough until it is at rest.

`surface_speed` bounds the speed of a sphere's points in a slab by its boxes of positions and
velocities. What holds from a slab on is the greatest of these bounds. `BLOCK` slabs at a time are
bounded by one box first, with velocities and positions of them all, about the middle one's frame.
Only where that is too fast, from the end of the course back, does each slab count by itself.

The way left is bounded alike, with the ways of the joints in place of their velocities.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from armguard.bounds.planned.clamps import find_closing_way
from armguard.bounds.planned.course import (
    BLOCK,
    ArmShape,
    PlannedCourse,
    find_center,
    find_frame,
)
from armguard.bounds.surface_speed import set_joints, speed_in_box
from armguard.bounds.table_time import ArmSphere
from armguard.jit.arrays import FloatArray
from armguard.jit.handle import pack
from armguard.jit.kernels import kernel
from armguard.jit.numerics import SUM_ROUNDING
from armguard.obstacles.regions import ContactLimit


class CourseSpeeds(NamedTuple):
    """How fast joints can be in each slab of a course, and how far they can still go."""

    slowest: FloatArray
    """Least velocities, in [rad]/[s] or [m]/[s]. Shape (slabs, nv)."""
    fastest: FloatArray
    """Greatest velocities, alike."""
    ways: FloatArray
    """How far joints go forth from the start of each slab on, how far back, and how far in all if
    in each slab they go the way in which they may be faster, in [rad] or [m], >= 0.
    Shape (3, slabs, nv)."""
    away: FloatArray
    """How far they can be from the middle of the last slab from then on. Shape (slabs, nv)."""
    block_slowest: FloatArray
    """Least velocities in `BLOCK` slabs. Shape (blocks, nv)."""
    block_fastest: FloatArray
    """Greatest velocities, alike."""
    block_half: FloatArray
    """How far joints can be from the middle of the middle slab of a block. Shape (blocks, nv)."""
    bound: FloatArray
    """Filled when it is asked for: bound on the speed of a sphere from a block on, in [m]/[s];
    NaN until then. Shape (n, blocks)."""
    part_centers: FloatArray
    """Where the spheres are that stand for links, in the middle of each block, in [m].
    Shape (blocks, parts, 3)."""


def _make_no_speeds() -> Any:
    empty = {"ways": np.zeros((3, 0, 1)), "part_centers": np.zeros((0, 1, 3))}
    return pack(CourseSpeeds(**{name: np.zeros((0, 1)) for name in CourseSpeeds._fields} | empty))


NO_SPEEDS = _make_no_speeds()
"""The speeds of a course that was laid out without velocities."""


@kernel
def sum_up_speeds(
    times: FloatArray,
    middle: FloatArray,
    half: FloatArray,
    slowest: FloatArray,
    fastest: FloatArray,
    spheres: int,
) -> tuple[
    FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray,
]:  # fmt: skip
    """The fields of `CourseSpeeds`, but for the last.

    Args:
        times: When slabs start and end, in [s]. Shape (2, slabs).
        middle: Joint positions that their boxes are around, in [rad] or [m]. Shape (slabs, nv).
        half: How far from there joints can be, in [rad] or [m]. Shape (slabs, nv).
        slowest: Least velocities, in [rad]/[s] or [m]/[s]. Shape (slabs, nv).
        fastest: Greatest velocities, alike.
        spheres: How many the arm has.
    """
    slabs, joints = middle.shape
    last = slabs - 1
    ways, away = np.empty((3, slabs, joints)), np.empty_like(middle)
    for j in range(joints):
        up = down = whole = wide = 0.0
        for k in range(last, -1, -1):
            if not slowest[k, j] <= fastest[k, j]:
                # Nothing is known of it.
                slowest[k, j], fastest[k, j] = -math.inf, math.inf
            duration = (times[1, k] - times[0, k]) * (1.0 + SUM_ROUNDING)
            rise, fall = max(fastest[k, j], 0.0), max(-slowest[k, j], 0.0)
            up += rise * duration
            down += fall * duration
            whole += max(rise, fall) * duration
            wide = max(wide, abs(middle[k, j] - middle[last, j]) + half[k, j])
            ways[0, k, j], ways[1, k, j], ways[2, k, j] = up, down, whole
            away[k, j] = wide
    blocks = (slabs + BLOCK - 1) // BLOCK
    shape = blocks, joints
    block_slowest, block_fastest, block_half = np.empty(shape), np.empty(shape), np.zeros(shape)
    for block in range(blocks):
        first, end = block * BLOCK, min((block + 1) * BLOCK, slabs)
        frame = find_frame(block, slabs)
        for j in range(joints):
            block_slowest[block, j], block_fastest[block, j] = math.inf, -math.inf
            for k in range(first, end):
                block_slowest[block, j] = min(block_slowest[block, j], slowest[k, j])
                block_fastest[block, j] = max(block_fastest[block, j], fastest[k, j])
                wide = abs(middle[k, j] - middle[frame, j]) + half[k, j]
                block_half[block, j] = max(block_half[block, j], wide)
    bound = np.full((spheres, blocks), np.nan)
    return (
        slowest, fastest, ways, away, block_slowest, block_fastest, block_half, bound,
    )  # fmt: skip


@kernel
def _set_frame(
    node: int, frame: int, half: FloatArray, course: PlannedCourse, arm: ArmShape
) -> int:
    """Fill `arm.box` for a sphere while joints are so near to the middle of a slab, (nv,).

    Returns what `set_joints` does.
    """
    x, y, z = find_center(arm, course.placement[frame], node)
    span = arm.box.span
    for j in range(half.shape[0]):
        span[0, j], span[1, j], span[2, j] = half[j], -half[j], half[j]
    sphere = ArmSphere(x, y, z, course.jacobian[frame], arm.lever[node], arm.exact)
    return set_joints(sphere, arm.moves[arm.carrier[node]], arm.box)


@kernel
def _bound_speed(
    node: int,
    frame: int,
    half: FloatArray,
    slowest: FloatArray,
    fastest: FloatArray,
    enough: float,
    course: PlannedCourse,
    arm: ArmShape,
) -> float:
    """Bound on the speed of a sphere while joints are so near to the middle of a slab, in [m]/[s].

    The arrays have the shape (nv,). A bound above `enough` may be returned as inf.
    """
    count = _set_frame(node, frame, half, course, arm)
    if count < 0:
        return math.inf
    speed: float = speed_in_box(arm.tree.radius[node], count, slowest, fastest, arm.box, enough)
    return speed


@kernel
def _bound_from_block(
    node: int, block: int, later: float, course: PlannedCourse, arm: ArmShape
) -> float:
    """Bound on the speed of a sphere from a block on; `later` is that from the next one on."""
    speeds = course.speeds.content
    known = speeds.bound[node, block]
    if known >= 0.0:
        return known
    frame = find_frame(block, course.start.shape[0])
    speed = _bound_speed(
        node, frame, speeds.block_half[block], speeds.block_slowest[block],
        speeds.block_fastest[block], math.inf, course, arm,
    )  # fmt: skip
    # Written so that what is no number is no bound.
    if not speed <= later:
        later = speed if speed > later else math.inf
    speeds.bound[node, block] = later
    return later


@kernel
def _bound_slab(node: int, slab: int, enough: float, course: PlannedCourse, arm: ArmShape) -> float:
    """Bound on the speed of a sphere in one slab, in [m]/[s]; inf where it is above `enough`."""
    speeds = course.speeds.content
    speed: float = _bound_speed(
        node, slab, course.half[slab], speeds.slowest[slab], speeds.fastest[slab], enough, course,
        arm,
    )  # fmt: skip
    return speed


@kernel
def find_speed_from(
    node: int, slab: int, most: float, course: PlannedCourse, arm: ArmShape
) -> float:
    """Bound on the speed of all points of a sphere from a slab on until the arm rests, in [m]/[s].

    Args:
        node: The sphere.
        slab: The slab.
        most: What is faster than this, in [m]/[s], need not be known any better.
        course: With velocities.
        arm: Its shape.

    Returns:
        inf where it may be faster than `most`.
    """
    slabs, block = course.start.shape[0], slab // BLOCK
    # Invariant: from the block `slow` on it is no faster than `speed`, nor is that above `most`.
    slow, speed = (slabs + BLOCK - 1) // BLOCK, 0.0
    while slow > block:
        faster = _bound_from_block(node, slow - 1, speed, course, arm)
        if not faster <= most:
            break
        slow, speed = slow - 1, faster
    if slow == block:
        return speed
    # One that is too fast is so at once, as a rule.
    if not _bound_slab(node, slab, most, course, arm) <= most:
        return math.inf
    for k in range(min(slow * BLOCK, slabs) - 1, slab - 1, -1):
        faster = _bound_slab(node, k, most, course, arm)
        if not faster <= most:
            return math.inf
        speed = max(speed, faster)
    return speed


@kernel
def find_way_from(node: int, slab: int, course: PlannedCourse, arm: ArmShape) -> float:
    """Bound on how far any point of a sphere can go from a slab on until the arm rests, in [m]."""
    speeds = course.speeds.content
    count = _set_frame(node, course.start.shape[0] - 1, speeds.away[slab], course, arm)
    if count < 0:
        return math.inf
    forth, back = arm.box.forth, arm.box.back
    turn = 0.0
    for j in range(count):
        up, down, whole = speeds.ways[0, slab, j], speeds.ways[1, slab, j], speeds.ways[2, slab, j]
        # One that goes forth and back goes farther in all than to either side.
        forth[j], back[j] = (whole, -down) if up >= down else (up, -whole)
        turn += arm.box.joints[j, 8] * whole
    way: float = speed_in_box(0.0, count, back, forth, arm.box, math.inf)
    # Turns about different axes do not add up like vectors.
    return way + arm.tree.radius[node] * turn * (1.0 + SUM_ROUNDING)


@kernel
def find_harmless_speed(
    node: int,
    slab: int,
    limit: ContactLimit,
    obstacle_speed: float,
    course: PlannedCourse,
    arm: ArmShape,
) -> float:
    """How fast a sphere that is harmless from a slab on is at most from then on, in [m]/[s].

    Args:
        node: The sphere.
        slab: The slab.
        limit: Of the obstacle: what contact is permitted.
        obstacle_speed: How fast something is at most that the sphere's link may press the obstacle
            against, in [m]/[s]; negative where there is nothing but the arm's own links.
        course: Where the arm can be, and how fast.
        arm: Its shape.

    Returns:
        inf where it is not known to be harmless, and where the course has no velocities.
    """
    if not limit.max_speed > 0.0 or course.speeds.content.slowest.shape[0] == 0:
        return math.inf
    speed = find_speed_from(node, slab, limit.max_speed, course, arm)
    if not speed <= limit.max_speed:
        return math.inf
    if limit.max_way == math.inf:
        return speed
    if obstacle_speed >= 0.0:
        # What moves by itself goes on until the arm rests.
        left = course.end[course.end.shape[0] - 1] - course.start[slab]
        way = find_way_from(node, slab, course, arm) + obstacle_speed * left
        if not way <= limit.max_way:
            return math.inf
    way = find_closing_way(node, slab, limit, course, arm)
    return speed if way <= limit.max_way else math.inf
