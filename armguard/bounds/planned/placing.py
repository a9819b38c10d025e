"""Places the arm in many configurations at once: joints, Jacobians, and balls around its sweep.

Pinocchio places one configuration a call, which costs more to call than to compute. A course has
some fifty, so the chain of joints is laid out here once, as Pinocchio has it, and followed by
compiled code. That it leads where Pinocchio's does is checked at construction. Most spheres of most
courses are never looked at, so where they are is found when they are (`course.find_center`).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import pinocchio

from armguard.bounds.joint_box import Vector
from armguard.bounds.planned.course import BLOCK, ArmShape, find_center
from armguard.exceptions import ArmguardError
from armguard.jit.arrays import BoolArray, FloatArray, IntArray
from armguard.jit.kernels import kernel, merged_kernel
from armguard.jit.numerics import SUM_ROUNDING
from armguard.robot.kinematics import Kinematics

AGREES = 1e-9
"""How far places may be from where Pinocchio has them, in [m]: rounding is far below, and another
understanding of a joint far above."""


class JointChain(NamedTuple):
    """All joints as a tree, parents before their children; each has one degree of freedom."""

    parent: IntArray
    """Joint that carries each joint; 0 is the world. Shape (J,)."""
    column: IntArray
    """Of each joint in configurations and Jacobians; -1 for the world. Shape (J,)."""
    slides: BoolArray
    """Whether it slides along its axis; else it turns about it. Shape (J,)."""
    terms: FloatArray
    """Its placement in its parent's frame, rotation and translation in [m], is the first of these,
    plus q times the second where it slides. Where it turns it is, by Rodrigues' formula, plus
    sin q times the second and 1 - cos q times the third. Shape (J, 3, 3, 4)."""
    motion: FloatArray
    """Its unit motion in its own frame: linear, then angular. Shape (J, 6)."""


class PlacedArm(NamedTuple):
    """What is placed: joints, and the spheres that they carry."""

    chain: JointChain
    arm: ArmShape


def make_chain(kinematics: Kinematics) -> JointChain:
    """The chain of an arm's joints."""
    model = kinematics.model
    count = model.njoints
    terms, motion = np.zeros((count, 3, 3, 4)), np.zeros((count, 6))
    column = np.full(count, -1, dtype=np.int64)
    for joint in range(1, count):
        kind, place = model.joints[joint], model.jointPlacements[joint]
        data = kind.createData()
        kind.calc(data, pinocchio.neutral(model))
        motion[joint] = np.asarray(data.S).reshape(6)
        across = pinocchio.skew(motion[joint, 3:])
        terms[joint, 0] = place.homogeneous[:3]
        terms[joint, 1, :, :3] = place.rotation @ across
        terms[joint, 1, :, 3] = place.rotation @ motion[joint, :3]
        terms[joint, 2, :, :3] = place.rotation @ across @ across
        column[joint] = kind.idx_v
    slides: BoolArray = np.any(motion[:, :3], axis=1)
    parent = np.array([int(parent) for parent in model.parents], dtype=np.int64)
    return JointChain(parent, column, slides, terms, motion)


def check_chain(handle: Any, kinematics: Kinematics) -> None:
    """Check that an arm is placed where Pinocchio has it.

    Args:
        handle: On its `PlacedArm`.
        kinematics: Of the arm.

    Raises:
        ArmguardError: It is not.
    """
    model = kinematics.model
    random = np.random.default_rng(0)
    for q in random.uniform(-1.0, 1.0, (3, model.nv)):
        kinematics.compute(q, np.zeros(model.nv))
        placement, jacobian, _, _ = place_all(handle, q[None], np.zeros((1, model.nv)))
        expected = np.array([place.homogeneous[:3] for place in kinematics.data.oMi])
        off = max(
            float(np.abs(placement[0] - expected).max()),
            float(np.abs(jacobian[0] - kinematics.data.J.reshape(6, -1)).max(initial=0.0)),
        )
        if not off <= AGREES:
            raise ArmguardError(
                model.name,
                f"has joints that lead {off:.3g} m away from where pinocchio has them",
                expected="joints that turn about or slide along one axis",
            )


@kernel
def place_all(
    handle: Any, middle: FloatArray, half: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Joints, Jacobians, and balls around what the arm sweeps, of all slabs of a course.

    Args:
        handle: On the `PlacedArm`.
        middle: Joint positions, in [rad] or [m]. Shape (slabs, nv).
        half: How far joints can be from there, in [rad] or [m]. Shape (slabs, nv).

    Returns:
        The fields of a `PlannedCourse` from `placement` on.
    """
    placement, jacobian = _place_joints(handle.content.chain, middle)
    block_balls, arm_ball = _enclose(handle.content.arm, placement, half)
    return placement, jacobian, block_balls, arm_ball


@kernel
def _place_joints(chain: JointChain, configurations: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Placements of all joints, (k, J, 3, 4), and Pinocchio's `data.J`, (k, 6, nv).

    Args:
        chain: Of the arm's joints.
        configurations: Joint positions, in [rad] or [m]. Shape (k, nv).
    """
    count, joints = configurations.shape
    placement = np.empty((count, chain.parent.shape[0], 3, 4))
    jacobian = np.empty((count, 6, joints))
    own = np.empty((3, 4))
    for k in range(count):
        world = placement[k]
        for a in range(3):
            for b in range(4):
                world[0, a, b] = 1.0 if a == b else 0.0
        for i in range(1, chain.parent.shape[0]):
            j = chain.column[i]
            _place_joint(chain, i, configurations[k, j], world, own)
            # Its column: the motion that it gives whatever is at the world's origin.
            lx, ly, lz = _turn(world[i], chain.motion[i, :3])
            ax, ay, az = _turn(world[i], chain.motion[i, 3:])
            px, py, pz = world[i, 0, 3], world[i, 1, 3], world[i, 2, 3]
            jacobian[k, 0, j] = lx + py * az - pz * ay
            jacobian[k, 1, j] = ly + pz * ax - px * az
            jacobian[k, 2, j] = lz + px * ay - py * ax
            jacobian[k, 3, j], jacobian[k, 4, j], jacobian[k, 5, j] = ax, ay, az
    return placement, jacobian


@merged_kernel
def _turn(place: FloatArray, vector: FloatArray) -> Vector:
    """A vector in the frame of a joint that is placed so, (3, 4), in the world."""
    x, y, z = vector[0], vector[1], vector[2]
    return (
        place[0, 0] * x + place[0, 1] * y + place[0, 2] * z,
        place[1, 0] * x + place[1, 1] * y + place[1, 2] * z,
        place[2, 0] * x + place[2, 1] * y + place[2, 2] * z,
    )


@merged_kernel
def _place_joint(
    chain: JointChain, i: int, position: float, world: FloatArray, own: FloatArray
) -> None:
    """Place joint i in the world, its parent being placed; `own`, (3, 4), is room to work in."""
    parent, terms = world[chain.parent[i]], chain.terms[i]
    first, second = position, 0.0
    if not chain.slides[i]:
        first, second = math.sin(position), 1.0 - math.cos(position)
    for a in range(3):
        for b in range(4):
            own[a, b] = terms[0, a, b] + first * terms[1, a, b] + second * terms[2, a, b]
    for a in range(3):
        for b in range(4):
            moved = parent[a, 0] * own[0, b] + parent[a, 1] * own[1, b] + parent[a, 2] * own[2, b]
            world[i, a, b] = moved + (parent[a, 3] if b == 3 else 0.0)


@kernel
def _enclose(
    arm: ArmShape, placement: FloatArray, half: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Balls around what links sweep, and one around those.

    Args:
        arm: Its spheres.
        placement: Of its joints in each slab of a course. Shape (slabs, J, 3, 4).
        half: How far joints can be from there, in [rad] or [m]. Shape (slabs, nv).

    Returns:
        Middles and radii, in [m]: of each link in each `BLOCK` slabs, (blocks, links, 4), and of
        the whole arm, (4,).
    """
    blocks, links = (half.shape[0] + BLOCK - 1) // BLOCK, arm.tree.root.shape[0]
    balls, ball = np.empty((blocks, links, 4)), np.empty(4)
    swept = np.empty((BLOCK, 4))
    for block in range(blocks):
        first, last = block * BLOCK, min((block + 1) * BLOCK, half.shape[0])
        for link in range(links):
            root = arm.tree.root[link]
            for slab in range(first, last):
                one = swept[slab - first]
                one[0], one[1], one[2] = find_center(arm, placement[slab], root)
                one[3] = arm.tree.radius[root]
                for j in range(half.shape[1]):
                    one[3] += half[slab, j] * arm.lever[root, j]
            _enclose_balls(swept[: last - first], balls[block, link])
    _enclose_balls(balls.reshape((blocks * links, 4)), ball)
    return balls, ball


@kernel
def _enclose_balls(balls: FloatArray, ball: FloatArray) -> None:
    """Fill a ball, (4,), around balls, (n, 4), with room for the rounding of what they are."""
    for a in range(3):
        low, high = math.inf, -math.inf
        for k in range(balls.shape[0]):
            low, high = min(low, balls[k, a]), max(high, balls[k, a])
        ball[a] = 0.5 * (low + high)
    radius = checked = 0.0
    for k in range(balls.shape[0]):
        x, y, z = balls[k, 0] - ball[0], balls[k, 1] - ball[1], balls[k, 2] - ball[2]
        reach = math.sqrt(x * x + y * y + z * z) + balls[k, 3]
        radius = max(radius, reach)
        checked += reach
    # `max` may pass over a NaN; the sum does not.
    ball[3] = radius if checked < math.inf else math.inf
    ball[3] += SUM_ROUNDING * (abs(ball[0]) + abs(ball[1]) + abs(ball[2]) + abs(ball[3]))
