"""The course of an arm on a plan: a box of joint positions for each slab of time."""

from __future__ import annotations

from typing import Any, NamedTuple

from armguard.bounds.closing import Arms
from armguard.bounds.joint_box import JointBox, Vector, set_columns
from armguard.bounds.link_gaps import LinkGaps
from armguard.jit.arrays import BoolArray, FloatArray, IntArray
from armguard.jit.kernels import kernel
from armguard.robot.kinematics import SphereTree

BLOCK = 8
"""Slabs that are evaluated together first."""


class ArmShape(NamedTuple):
    """The arm's spheres, whatever it does."""

    tree: SphereTree
    lever: FloatArray
    """R_j in [m], 1 for a prismatic joint, 0 for one that does not move it. Shape (n, nv)."""
    box: JointBox
    """The box of the slab at hand."""
    carrier: IntArray
    """Joint that carries each sphere. Shape (n,)."""
    local: FloatArray
    """Their centres in that joint's frame, in [m]. Shape (n, 3)."""
    exact: FloatArray
    """Errors of the columns of the Jacobian in the middle of a box: none. Shape (nv,)."""
    moves: BoolArray
    """Which joints move what each joint carries. Shape (J, nv)."""
    gaps: LinkGaps
    """How distances between links can vary; without parts nothing is clamped between links."""
    arms: Arms
    """Room to work in: how gaps between links close."""


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
    speeds: Any
    """Handle on its `CourseSpeeds`; without slabs where no contact limits are stated."""


@kernel
def find_frame(block: int, slabs: int) -> int:
    """The slab in the middle of a block."""
    return (block * BLOCK + min((block + 1) * BLOCK, slabs) - 1) // 2


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
def set_slab(arm: ArmShape, course: PlannedCourse, slab: int, place: Vector) -> bool:
    """Fill `arm.box` with a slab's box, for a point in the world, in [m]; whether all is finite."""
    half, box = course.half[slab], arm.box
    for j in range(half.shape[0]):
        box.span[0, j], box.span[1, j], box.span[2, j] = half[j], -half[j], half[j]
    return set_columns(place[0], place[1], place[2], course.jacobian[slab], box)
