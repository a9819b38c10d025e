"""Where an arm that follows a plan can be, laid out in slabs of time.

Within a slab of time the joints are within a box around some configuration. With h_j half its
widths, and J_j and R_j column and lever of joint j for the centre p of a sphere, p is off its place
at that configuration, along any unit vector n, by at most

    min( sum_j |n.J_j| h_j + sum_ij R_max(i, j) h_i h_j / 2,  sum_j R_j h_j ),

the first being Taylor's bound, the second what the reaches about the joints say.

Taylor's bound to third order is closer, and dearer. For a revolute joint i and one at or beyond it,
j, the second derivative of p is a_i x J_j, with a_i the axis; where i is prismatic it is 0. A third
one is no longer than the lever of the most distal of its joints. So with c_j = n.J_j and H_ij =
n.(a_i x J_j), p moves along n, its joints by d_j within +-h_j, by at most

    sum_j c_j d_j + sum_ij H_ij d_i d_j / 2 + sum_ijk R_max(i, j, k) h_i h_j h_k / 6.

Where |c_j| >= sum_i |H_ij| h_i, the first two sums are greatest with d_j at that end of its range
that c_j points to, whatever the others do; of other joints each term counts as the most that it can
be.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from armguard.jit.arrays import BoolArray, FloatArray, IntArray
from armguard.jit.kernels import kernel
from armguard.jit.numerics import SUM_ROUNDING

Vector = tuple[float, float, float]

BLOCK = 8
"""Slabs that are evaluated together first."""


class ArmShape(NamedTuple):
    """The arm's spheres, whatever it does."""

    radius: FloatArray
    """[m]. Shape (n,)."""
    first_child: IntArray
    """Index of the first child, -1 for a leaf; children are contiguous. Shape (n,)."""
    child_count: IntArray
    """0 for a leaf. Shape (n,)."""
    root: IntArray
    """Index of each link's root. Shape (links,)."""
    lever: FloatArray
    """R_j in [m], 1 for a prismatic joint, 0 for one that does not move it. Shape (n, nv)."""
    turning: BoolArray
    """Which joints are revolute. Shape (nv,)."""
    carrier: IntArray
    """Joint that carries each sphere. Shape (n,)."""
    local: FloatArray
    """Their centres in that joint's frame, in [m]. Shape (n, 3)."""
    stack: IntArray
    """Room to work in. Shape (n,)."""


class PlannedCourse(NamedTuple):
    """Where the arm can be while it follows one plan and brakes: slabs of time, one by one."""

    epoch: float
    """What times below are counted from, in [s]."""
    start: FloatArray
    """Of each slab, in [s]. Shape (slabs,)."""
    end: FloatArray
    """Of each slab, in [s]: the next one's start. After the last, the arm rests. Shape (slabs,)."""
    middle: FloatArray
    """Joint positions that each slab's box is around, in [rad] or [m]. Shape (slabs, nv)."""
    half: FloatArray
    """How far from there joints can be, in [rad] or [m]. Shape (slabs, nv)."""
    placement: FloatArray
    """Of all joints in those positions: rotation, and translation in [m]; `find_center` has the
    spheres. Shape (slabs, J, 3, 4)."""
    jacobian: FloatArray
    """Pinocchio's `data.J` there. Shape (slabs, 6, nv)."""
    block_balls: FloatArray
    """Balls around all that links sweep in `BLOCK` slabs, in [m]. Shape (blocks, links, 4)."""
    arm_ball: FloatArray
    """A ball around those. Shape (4,)."""


@kernel
def find_center(arm: ArmShape, placement: FloatArray, node: int) -> Vector:
    """Centre of a sphere of an arm whose joints are placed, (J, 3, 4), in the world, in [m]."""
    place = placement[arm.carrier[node]]
    x, y, z = arm.local[node, 0], arm.local[node, 1], arm.local[node, 2]
    return (
        place[0, 0] * x + place[0, 1] * y + place[0, 2] * z + place[0, 3],
        place[1, 0] * x + place[1, 1] * y + place[1, 2] * z + place[1, 3],
        place[2, 0] * x + place[2, 1] * y + place[2, 2] * z + place[2, 3],
    )


@kernel
def deviation_along(
    normal: Vector,
    place: Vector,
    jacobian: FloatArray,
    half: FloatArray,
    lever: FloatArray,
    turning: BoolArray,
) -> float:
    """How far along n a point can be off p while joints stay within a box.

    Args:
        normal: A unit vector n in the world.
        place: Where the point is in the middle of the box, in the world, in [m].
        jacobian: Pinocchio's `data.J` there. Shape (6, nv).
        half: Half the widths of the box, in [rad] or [m]. Shape (nv,).
        lever: The point's reaches about the joints. Shape (nv,).
        turning: Which joints are revolute. Shape (nv,).
    """
    (nx, ny, nz), (px, py, pz) = normal, place
    straight = 0.0
    bent = 0.0
    most = 0.0
    # The angles of the joints nearer to the base, which bend the path that this one gives the
    # point.
    before = 0.0
    for j in range(lever.shape[0]):
        radius = lever[j]
        if not radius > 0.0:
            continue
        ax, ay, az = jacobian[3, j], jacobian[4, j], jacobian[5, j]
        slope = nx * (jacobian[0, j] + ay * pz - az * py)
        slope += ny * (jacobian[1, j] + az * px - ax * pz)
        slope += nz * (jacobian[2, j] + ax * py - ay * px)
        straight += min(abs(slope), radius) * half[j]
        most += radius * half[j]
        if turning[j]:
            bent += radius * half[j] * (before + 0.5 * half[j])
            before += half[j]
        else:
            bent += radius * half[j] * before
    size = most + (abs(px) + abs(py) + abs(pz)) * (1.0 + before)
    return min(straight + bent, most) + SUM_ROUNDING * size


@kernel
def close_deviation_along(
    normal: Vector,
    place: Vector,
    jacobian: FloatArray,
    half: FloatArray,
    lever: FloatArray,
    turning: BoolArray,
) -> float:
    """The same to third order: closer for wide boxes. Arguments are those of `deviation_along`."""
    (nx, ny, nz), (px, py, pz) = normal, place
    count = lever.shape[0]
    column, bend = np.empty((count, 3)), np.zeros((count, count))
    slope, turn = np.empty(count), np.zeros(count)
    straight = remainder = most = before = 0.0
    for j in range(count):
        slope[j] = 0.0
        radius = lever[j]
        if not radius > 0.0:
            continue
        ax, ay, az = jacobian[3, j], jacobian[4, j], jacobian[5, j]
        column[j, 0] = jacobian[0, j] + ay * pz - az * py
        column[j, 1] = jacobian[1, j] + az * px - ax * pz
        column[j, 2] = jacobian[2, j] + ax * py - ay * px
        slope[j] = nx * column[j, 0] + ny * column[j, 1] + nz * column[j, 2]
        straight += min(abs(slope[j]), radius) * half[j]
        most += radius * half[j]
        if turning[j]:
            remainder += radius * half[j] * (before * (before + half[j]) / 2.0 + half[j] ** 2 / 6.0)
            before += half[j]
        else:
            remainder += radius * half[j] * before * before / 2.0
        for i in range(j + 1):
            if not (lever[i] > 0.0 and turning[i]):
                continue
            # n.(a x s) is (n x a).s.
            ax, ay, az = jacobian[3, i], jacobian[4, i], jacobian[5, i]
            mixed = (ny * az - nz * ay) * column[j, 0]
            mixed += (nz * ax - nx * az) * column[j, 1]
            mixed += (nx * ay - ny * ax) * column[j, 2]
            bend[i, j] = bend[j, i] = mixed
            turn[i] += abs(mixed) * half[j]
            if i != j:
                turn[j] += abs(mixed) * half[i]
    bent = 0.0
    for i in range(count):
        for j in range(i + 1):
            weight = half[i] * half[j] * (0.5 if i == j else 1.0)
            if abs(slope[i]) >= turn[i] and abs(slope[j]) >= turn[j]:
                sign = 1.0 if (slope[i] >= 0.0) == (slope[j] >= 0.0) else -1.0
                bent += weight * sign * bend[i, j]
            elif i == j:
                bent += weight * max(bend[i, i], 0.0)
            else:
                bent += weight * abs(bend[i, j])
    size = (most + (abs(px) + abs(py) + abs(pz)) * (1.0 + before)) * (1.0 + before)
    return min(straight + bent + remainder, most) + SUM_ROUNDING * size
