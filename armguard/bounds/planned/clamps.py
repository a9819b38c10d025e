"""How far an arm on a course can still close a gap between two of its links.

A body part that is between two links is pressed by what their distance still falls. That depends on
the joints between the two alone: by a radian of one of these it changes by no more than a point of
the link that this joint moves can be away from its axis.
"""

from __future__ import annotations

import math

import numpy as np

from armguard.bounds.link_gaps import find_closing_lever
from armguard.bounds.planned.course import (
    BLOCK,
    ArmShape,
    PlannedCourse,
    find_center,
    find_frame,
)
from armguard.jit.arrays import FloatArray
from armguard.jit.kernels import kernel
from armguard.jit.numerics import SUM_ROUNDING


@kernel
def place_parts(arm: ArmShape, placement: FloatArray) -> FloatArray:
    """Centres of the spheres that stand for links, in the middle of each block, in [m].

    Args:
        arm: Its shape.
        placement: Of its joints in each slab of a course. Shape (slabs, J, 3, 4).

    Returns:
        Shape (blocks, parts, 3).
    """
    slabs, parts = placement.shape[0], arm.gaps.parts
    blocks = (slabs + BLOCK - 1) // BLOCK
    centers = np.empty((blocks, parts.shape[0], 3))
    for block in range(blocks):
        place = placement[find_frame(block, slabs)]
        for c in range(parts.shape[0]):
            centers[block, c, 0], centers[block, c, 1], centers[block, c, 2] = find_center(
                arm, place, parts[c]
            )
    return centers


@kernel
def _close(arm: ArmShape, node: int, part: int, ways: FloatArray) -> float:
    """By how much the distance of two spheres can change while joints go so far, (nv,), in [m]."""
    mine, theirs = arm.moves[arm.carrier[node]], arm.moves[arm.carrier[part]]
    closes = 0.0
    for j in range(ways.shape[0]):
        if mine[j] != theirs[j]:
            one = node if mine[j] else part
            closes += (
                find_closing_lever(arm.lever, arm.tree.radius, arm.box.turning, one, j) * ways[j]
            )
    return closes * (1.0 + SUM_ROUNDING)


@kernel
def _close_base(arm: ArmShape, node: int, ways: FloatArray) -> float:
    """By how much the distance of a sphere and the base can change while joints go so far."""
    moves = arm.moves[arm.carrier[node]]
    closes = 0.0
    for j in range(ways.shape[0]):
        if moves[j]:
            closes += (
                find_closing_lever(arm.lever, arm.tree.radius, arm.box.turning, node, j) * ways[j]
            )
    return closes * (1.0 + SUM_ROUNDING)


@kernel
def find_closing_way(
    node: int, slab: int, gap: float, thickness: float, course: PlannedCourse, arm: ArmShape
) -> float:
    """How far any link can still close in on a sphere of another one that it is near to, in [m].

    Args:
        node: The sphere.
        slab: From when on.
        gap: How near is near, in [m].
        thickness: By how much the distance from a neighbouring link must be able to vary, in [m].
        course: With velocities.
        arm: Its shape, with `gaps`.

    Returns:
        0 where no other link comes near from then on; what is no number counts as near.
    """
    speeds = course.speeds.content
    slabs = course.start.shape[0]
    closing = 0.0
    joints = speeds.block_half.shape[1]
    for block in range(slab // BLOCK, (slabs + BLOCK - 1) // BLOCK):
        half = speeds.block_half[block]
        # No pair of spheres comes nearer by more than this within the block.
        most = 0.0
        for j in range(joints):
            most += arm.gaps.weight[j] * half[j]
        x, y, z = find_center(arm, course.placement[find_frame(block, slabs)], node)
        for c in range(arm.gaps.parts.shape[0]):
            if arm.gaps.variation[node, c] <= thickness:
                continue
            part = arm.gaps.parts[c]
            center = speeds.part_centers[block, c]
            dx, dy, dz = x - center[0], y - center[1], z - center[2]
            distance = math.sqrt(dx * dx + dy * dy + dz * dz) * (1.0 - SUM_ROUNDING)
            distance -= arm.tree.radius[node] + arm.tree.radius[part] + gap
            if distance > most or distance > _close(arm, node, part, half):
                continue
            way = _close(arm, node, part, speeds.whole[slab])
            if not way <= closing:
                closing = way
        closes = _close_base(arm, node, half)
        for c in range(arm.gaps.base.shape[0]):
            ball = arm.gaps.base[c]
            dx, dy, dz = x - ball[0], y - ball[1], z - ball[2]
            distance = math.sqrt(dx * dx + dy * dy + dz * dz) * (1.0 - SUM_ROUNDING)
            distance -= arm.tree.radius[node] + ball[3] + gap
            if distance > closes:
                continue
            way = _close_base(arm, node, speeds.whole[slab])
            if not way <= closing:
                closing = way
            break  # it closes in on all of the base alike
    return closing
