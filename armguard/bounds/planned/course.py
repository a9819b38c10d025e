"""Where an arm that follows a plan can be, laid out in slabs of time.

Within a slab of time the joints are within a box around some configuration. With h_j half its
widths, and J_j and R_j column and lever of joint j for the centre p of a sphere, p is off its place
at that configuration, along any unit vector n, by at most

    min( sum_j |n.J_j| h_j + sum_ij R_max(i, j) h_i h_j / 2,  sum_j R_j h_j ),

the first being Taylor's bound, the second what the reaches about the joints say.
"""

from __future__ import annotations

from typing import NamedTuple

from armguard.jit.arrays import BoolArray, FloatArray, IntArray
from armguard.jit.kernels import kernel
from armguard.jit.numerics import SUM_ROUNDING

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
    centers: FloatArray
    """Of all spheres in those positions, in the world, in [m]. Shape (slabs, n, 3)."""
    jacobian: FloatArray
    """Pinocchio's `data.J` there. Shape (slabs, 6, nv)."""
    block_balls: FloatArray
    """Balls around all that links sweep in `BLOCK` slabs, in [m]. Shape (blocks, links, 4)."""
    arm_ball: FloatArray
    """A ball around those. Shape (4,)."""


@kernel
def deviation_along(
    nx: float,
    ny: float,
    nz: float,
    px: float,
    py: float,
    pz: float,
    jacobian: FloatArray,
    half: FloatArray,
    lever: FloatArray,
    turning: BoolArray,
) -> float:
    """How far along n a point can be off p while joints stay within a box.

    Args:
        nx: Of a unit vector in the world.
        ny: As nx.
        nz: As nx.
        px: Where the point is in the middle of the box, in the world, in [m].
        py: As px.
        pz: As px.
        jacobian: Pinocchio's `data.J` there. Shape (6, nv).
        half: Half the widths of the box, in [rad] or [m]. Shape (nv,).
        lever: The point's reaches about the joints. Shape (nv,).
        turning: Which joints are revolute. Shape (nv,).
    """
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
