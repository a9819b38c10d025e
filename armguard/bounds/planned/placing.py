"""The arm in many configurations at once: joints, Jacobians, and the balls around what it sweeps.

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
    rotation: FloatArray
    """Of its frame at zero, in the parent's frame. Shape (J, 3, 3)."""
    translation: FloatArray
    """Of its frame at zero, in the parent's frame, in [m]. Shape (J, 3)."""
    axis: FloatArray
    """About which it turns, or along which it slides; a unit vector. Shape (J, 3)."""
    slides: BoolArray
    """Whether it slides; else it turns. Shape (J,)."""


class PlacedArm(NamedTuple):
    """What is placed: joints, and the spheres that they carry."""

    chain: JointChain
    arm: ArmShape


def make_chain(kinematics: Kinematics) -> JointChain:
    """The chain of an arm's joints."""
    model = kinematics.model
    count = model.njoints
    axis, slides = np.zeros((count, 3)), np.zeros(count, dtype=np.bool_)
    column = np.full(count, -1, dtype=np.int64)
    for joint in range(1, count):
        kind = model.joints[joint]
        data = kind.createData()
        kind.calc(data, pinocchio.neutral(model))
        motion = np.asarray(data.S, dtype=np.float64).reshape(6)
        slides[joint] = bool(np.any(motion[:3]))
        axis[joint] = motion[:3] if slides[joint] else motion[3:]
        column[joint] = kind.idx_v
    return JointChain(
        parent=np.array([int(parent) for parent in model.parents], dtype=np.int64),
        column=column,
        rotation=np.array([place.rotation for place in model.jointPlacements]),
        translation=np.array([place.translation for place in model.jointPlacements]),
        axis=axis,
        slides=slides,
    )


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
        centers = place_spheres(handle, placement)
        off = max(
            float(np.abs(centers[0] - kinematics.centers).max(initial=0.0)),
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
def place_spheres(handle: Any, placement: FloatArray) -> FloatArray:
    """Centres of all spheres in the world, in [m], (k, n, 3).

    Args:
        handle: On the `PlacedArm`.
        placement: As in a `PlannedCourse`. Shape (k, J, 3, 4).
    """
    arm = handle.content.arm
    centers = np.empty((placement.shape[0], arm.carrier.shape[0], 3))
    for k in range(centers.shape[0]):
        for node in range(centers.shape[1]):
            x, y, z = find_center(arm, placement[k], node)
            centers[k, node, 0], centers[k, node, 1], centers[k, node, 2] = x, y, z
    return centers


@kernel
def _place_joints(chain: JointChain, configurations: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Placements of all joints, (k, J, 3, 4), and Pinocchio's `data.J`, (k, 6, nv).

    Args:
        chain: Of the arm's joints.
        configurations: Joint positions, in [rad] or [m]. Shape (k, nv).
    """
    count, joints = configurations.shape
    placement = np.empty((count, chain.parent.shape[0], 3, 4))
    jacobian = np.zeros((count, 6, joints))
    turned = np.empty((3, 3))
    for k in range(count):
        world = placement[k]
        for a in range(3):
            for b in range(4):
                world[0, a, b] = 1.0 if a == b else 0.0
        for i in range(1, chain.parent.shape[0]):
            _place_joint(chain, i, configurations[k, chain.column[i]], world, turned)
            # Its column: the motion that it gives whatever is at the world's origin.
            x, y, z = chain.axis[i, 0], chain.axis[i, 1], chain.axis[i, 2]
            ax = world[i, 0, 0] * x + world[i, 0, 1] * y + world[i, 0, 2] * z
            ay = world[i, 1, 0] * x + world[i, 1, 1] * y + world[i, 1, 2] * z
            az = world[i, 2, 0] * x + world[i, 2, 1] * y + world[i, 2, 2] * z
            j = chain.column[i]
            if chain.slides[i]:
                jacobian[k, 0, j], jacobian[k, 1, j], jacobian[k, 2, j] = ax, ay, az
            else:
                px, py, pz = world[i, 0, 3], world[i, 1, 3], world[i, 2, 3]
                jacobian[k, 0, j] = py * az - pz * ay
                jacobian[k, 1, j] = pz * ax - px * az
                jacobian[k, 2, j] = px * ay - py * ax
                jacobian[k, 3, j], jacobian[k, 4, j], jacobian[k, 5, j] = ax, ay, az
    return placement, jacobian


@merged_kernel
def _place_joint(
    chain: JointChain, i: int, position: float, world: FloatArray, turned: FloatArray
) -> None:
    """Place joint i in the world, its parent being placed; `turned`, (3, 3), is room to work in."""
    parent = chain.parent[i]
    x, y, z = chain.axis[i, 0], chain.axis[i, 1], chain.axis[i, 2]
    sine, cosine, slid = 0.0, 1.0, 0.0
    if chain.slides[i]:
        slid = position
    else:
        sine, cosine = math.sin(position), math.cos(position)
    # Rodrigues' formula.
    rest = 1.0 - cosine
    turned[0, 0], turned[0, 1], turned[0, 2] = (
        cosine + rest * x * x, rest * x * y - sine * z, rest * x * z + sine * y,
    )  # fmt: skip
    turned[1, 0], turned[1, 1], turned[1, 2] = (
        rest * x * y + sine * z, cosine + rest * y * y, rest * y * z - sine * x,
    )  # fmt: skip
    turned[2, 0], turned[2, 1], turned[2, 2] = (
        rest * x * z - sine * y, rest * y * z + sine * x, cosine + rest * z * z,
    )  # fmt: skip
    fixed, place = chain.rotation[i], chain.translation[i]
    for a in range(3):
        r0, r1, r2 = world[parent, a, 0], world[parent, a, 1], world[parent, a, 2]
        # The frame at zero, then what the joint does.
        s0 = r0 * fixed[0, 0] + r1 * fixed[1, 0] + r2 * fixed[2, 0]
        s1 = r0 * fixed[0, 1] + r1 * fixed[1, 1] + r2 * fixed[2, 1]
        s2 = r0 * fixed[0, 2] + r1 * fixed[1, 2] + r2 * fixed[2, 2]
        world[i, a, 3] = world[parent, a, 3] + r0 * place[0] + r1 * place[1] + r2 * place[2]
        world[i, a, 3] += slid * (s0 * x + s1 * y + s2 * z)
        for b in range(3):
            world[i, a, b] = s0 * turned[0, b] + s1 * turned[1, b] + s2 * turned[2, b]


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
    blocks = (half.shape[0] + BLOCK - 1) // BLOCK
    balls, ball = np.empty((blocks, arm.tree.root.shape[0], 4)), np.empty(4)
    lowest, highest = np.full(3, np.inf), np.full(3, -np.inf)
    low, high = np.empty(3), np.empty(3)
    centers = np.empty((BLOCK, 3))
    for block in range(balls.shape[0]):
        first, last = block * BLOCK, min((block + 1) * BLOCK, half.shape[0])
        for link in range(balls.shape[1]):
            root = arm.tree.root[link]
            low[:], high[:] = np.inf, -np.inf
            for slab in range(first, last):
                center = centers[slab - first]
                center[0], center[1], center[2] = find_center(arm, placement[slab], root)
                for a in range(3):
                    low[a] = min(low[a], center[a])
                    high[a] = max(high[a], center[a])
            for a in range(3):
                balls[block, link, a] = 0.5 * (low[a] + high[a])
                lowest[a], highest[a] = min(lowest[a], low[a]), max(highest[a], high[a])
            radius = checked = 0.0
            for slab in range(first, last):
                square = reach = 0.0
                for a in range(3):
                    off = centers[slab - first, a] - balls[block, link, a]
                    square += off * off
                for j in range(half.shape[1]):
                    reach += half[slab, j] * arm.lever[root, j]
                radius = max(radius, math.sqrt(square) + reach)
                checked += math.sqrt(square) + reach
            # The greatest of some numbers may pass over one that is none.
            radius = radius if checked < math.inf else math.inf
            balls[block, link, 3] = radius + arm.tree.radius[root]
            _widen(balls[block, link])
    for a in range(3):
        ball[a] = 0.5 * (lowest[a] + highest[a])
    ball[3] = 0.0
    for block in range(balls.shape[0]):
        for link in range(balls.shape[1]):
            square = 0.0
            for a in range(3):
                off = balls[block, link, a] - ball[a]
                square += off * off
            ball[3] = max(ball[3], math.sqrt(square) + balls[block, link, 3])
    _widen(ball)
    return balls, ball


@kernel
def _widen(ball: FloatArray) -> None:
    """Give a ball, (4,), room for the rounding of what it was made from."""
    ball[3] += SUM_ROUNDING * (abs(ball[0]) + abs(ball[1]) + abs(ball[2]) + abs(ball[3]))
