"""Bounds on how far an arm on a course can still close a gap between two of its links.

A body part that is between two links is pressed by what the gap between them still closes.
"""

from __future__ import annotations

import math

import numpy as np

from armguard.bounds.closing import fill_arms, find_approach, find_closing
from armguard.bounds.planned.course import (
    BLOCK,
    ArmShape,
    PlannedCourse,
    find_center,
    find_frame,
)
from armguard.bounds.table_time import ArmSphere
from armguard.jit.arrays import FloatArray
from armguard.jit.kernels import kernel
from armguard.jit.numerics import SUM_ROUNDING
from armguard.obstacles.regions import ContactLimit


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
def find_closing_way(
    node: int, slab: int, limit: ContactLimit, course: PlannedCourse, arm: ArmShape
) -> float:
    """By how much gaps between a sphere and other links close from a slab on, in [m].

    What is pressed may slip from one link to another, so what counts in each block of slabs is the
    gap that closes most there, of those that are near.

    Args:
        node: The sphere.
        slab: From when on.
        limit: Of what is pressed: how near is near, which neighbours count, and beyond which way
            nothing is permitted, so that it need not be known any better.
        course: With velocities.
        arm: Its shape, with `gaps`.

    Returns:
        0 where no other link comes near from then on; what is no number counts as near.
    """
    speeds, arms, span = course.speeds.content, arm.arms, arm.box.span
    slabs, joints = course.start.shape[0], course.half.shape[1]
    mine, radius = arm.moves[arm.carrier[node]], arm.tree.radius[node]
    gaps, parts = arm.gaps, arm.gaps.parts.shape[0]
    total = 0.0
    for block in range(slab // BLOCK, (slabs + BLOCK - 1) // BLOCK):
        half, frame = speeds.block_half[block], find_frame(block, slabs)
        begin, end = max(slab, block * BLOCK), (block + 1) * BLOCK
        # No pair of spheres comes nearer by more than this within the block.
        most = 0.0
        for j in range(joints):
            most += arm.gaps.weight[j] * half[j]
            span[0, j], span[1, j], span[2, j] = half[j], -half[j], half[j]
            for k in range(3):
                arms.ways[k, j] = speeds.ways[k, begin, j] * (1.0 + SUM_ROUNDING)
                if end < slabs:
                    arms.ways[k, j] -= speeds.ways[k, end, j]
        x, y, z = find_center(arm, course.placement[frame], node)
        lever, jacobian = arm.lever[node], course.jacobian[frame]
        sphere = ArmSphere(x, y, z, jacobian, lever, arm.exact)
        closing = 0.0
        for c in range(parts + gaps.base.shape[0]):
            # The base has no levers, nor are any asked for: nothing moves it.
            other_radius, theirs = 0.0, arm.moves[0]
            if c < parts:
                if gaps.variation[node, c] <= limit.thickness:
                    continue
                part, center = gaps.parts[c], speeds.part_centers[block, c]
                lever, theirs = arm.lever[part], arm.moves[arm.carrier[part]]
                other_radius = arm.tree.radius[part]
            else:
                center = gaps.base[c - parts]
                other_radius = center[3]
            other = ArmSphere(center[0], center[1], center[2], jacobian, lever, arm.exact)
            dx, dy, dz = x - other.x, y - other.y, z - other.z
            distance = math.sqrt(dx * dx + dy * dy + dz * dz) * (1.0 - SUM_ROUNDING)
            distance -= radius + other_radius + limit.gap
            if distance > most:
                continue
            fill_arms(sphere, radius, mine, other, other_radius, theirs, arm.box, arms)
            if distance > find_approach(arms, arm.box):
                continue
            way = find_closing(arms)
            if not way <= closing:
                closing = way
        total += closing
        if not total <= limit.max_way:
            return math.inf
    return total
