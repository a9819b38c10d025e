"""Tests whether a touched arm recedes from the body part on a whole piece of trajectory.

A touched arm may only rest or recede. Judged by centres of spheres alone, a link that turns could
press on with the rest of its surface. So here *no point of the arm inside a sphere* that can touch
the part may ever move in any direction in which the part can lie.

For a sphere with centre c and radius r, and a part that was measured at a hull, let n0 be the
direction of the hull's nearest point, at a distance d. The centre gets no farther than s along n0
on the piece, and the part is off by e. The part lies beyond a plane: n0 . (y - c) >= d for each of
its points y. Those that the sphere can touch are no farther than D, the distance of contact. So
the part lies in directions n whose angle with n0 has a cosine of at least (d - s - e) / D. By joint
velocities w a point p of the arm inside the sphere moves by

    n . sum_j w_j J_j(p) <= max over those n of n . sum_j w_j J_j(c) + r |sum_j w_j a_j|
                            + sum_ij |w_j| S_i (R_max(i, j) + r),

with the columns J_j and axes a_j at the measured positions, joints within S_i of these, and R_j the
levers; `surface_speed` bounds the derivatives of columns alike. The right side is convex and
homogeneous in w. A curve that is cubic between samples has velocities that are mixtures of three
vectors in each interval, and the part is never pressed if the right side is at most 0 for these.
Positions are mixtures of four, so that s is the most that n0 . sum_j J_j(c) x_j is for one of these
displacements x, with sum_ij R_max(i, j) S_i S_j / 2, and the levers times the deviations.

Deviations from the curve are those of an arm that rests, and do not count as motion.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from armguard.bounds.planned.course import PlannedCourse
from armguard.bounds.planned.plan import CheckedPlan
from armguard.contact.gjk import distance_to_hull
from armguard.jit.arrays import BoolArray, FloatArray
from armguard.jit.kernels import kernel
from armguard.jit.numerics import SUM_ROUNDING
from armguard.obstacles.possible_states import possible_states
from armguard.pairs.contact_time import StatePlace, contact_distance, own_place
from armguard.pairs.scene import Scene
from armguard.pairs.touching import NO_LINK, find_touching_link

RESTING = 1e-9
"""What counts as no motion, in [m]/[s]: velocities of a plan are rounded."""


class PieceMotion(NamedTuple):
    """How joints move on what is left of a piece."""

    rates: FloatArray
    """Velocities of which all on the way are mixtures, in [rad]/[s] or [m]/[s]. Shape (m, nv)."""
    places: FloatArray
    """Displacements from the measured positions of which all on the way are mixtures, in [rad] or
    [m]. Shape (k, nv)."""
    deviation: FloatArray
    """How far joints can be off that, in [rad] or [m]. Shape (nv,)."""
    spread: FloatArray
    """How far joints can be from where they were measured, alike."""


def sum_up_motion(
    plan: CheckedPlan, now: float, q: FloatArray, left: PlannedCourse | None
) -> PieceMotion:
    """How joints move on what is left of a piece.

    Args:
        plan: The piece.
        now: Time of the tick, in [s].
        q: Measured joint positions, in [rad] or [m]. Shape (nv,).
        left: Where joints can be that may leave the piece at any moment, each by itself; None where
            they may not.
    """
    is_left = plan.stamp + plan.times[1:] > now
    steps = np.diff(plan.times)[is_left, None]
    before, after = plan.q[:-1][is_left], plan.q[1:][is_left]
    start, end = plan.v[:-1][is_left], plan.v[1:][is_left]
    rates = np.concatenate([start, 3.0 * (after - before) / steps - start - end, end])
    corners = [before, before + steps * start / 3.0, after - steps * end / 3.0, after]
    places = np.concatenate(corners) - q
    if left is None:
        spread = np.abs(places).max(axis=0, initial=0.0) + plan.deviation
        return PieceMotion(rates, places, plan.deviation.copy(), spread)
    # Whatever each joint does by itself is a mixture of its greatest velocities either way.
    most, least = rates.max(axis=0, initial=0.0), rates.min(axis=0, initial=0.0)
    spread = (np.abs(left.middle - q) + left.half).max(axis=0)
    return PieceMotion(
        np.concatenate([np.diag(most), np.diag(least)]), np.zeros((1, len(q))), spread, spread
    )


@kernel
def _find_column(scene: Scene, node: int, j: int) -> tuple[float, float, float]:
    """By how much a joint moves a sphere's centre, in [m] a radian, or a metre of its own."""
    jacobian, center = scene.placement.jacobian[j], scene.arm.centers[node]
    ax, ay, az = jacobian[3], jacobian[4], jacobian[5]
    return (
        jacobian[0] + ay * center[2] - az * center[1],
        jacobian[1] + az * center[0] - ax * center[2],
        jacobian[2] + ax * center[1] - ay * center[0],
    )


@kernel
def _find_advance(
    scene: Scene, node: int, direction: tuple[float, float, float], motion: PieceMotion
) -> float:
    """How far a sphere's centre gets at most in a direction, in [m], at least 0."""
    moves, lever = scene.placement.moves[scene.placement.joint[node]], scene.arm.lever[node]
    joints = moves.shape[0]
    nx, ny, nz = direction
    most = off = size = 0.0
    for k in range(motion.places.shape[0]):
        along = 0.0
        for j in range(joints):
            if moves[j]:
                x, y, z = _find_column(scene, node, j)
                along += (x * nx + y * ny + z * nz) * motion.places[k, j]
        most = max(most, along)
    for j in range(joints):
        if moves[j]:
            off += lever[j] * motion.deviation[j]
            # With all joints before it, and itself.
            off += lever[j] * motion.spread[j] * (size + 0.5 * motion.spread[j])
            size += motion.spread[j]
    return most + off * (1.0 + SUM_ROUNDING)


@kernel
def _recedes(
    scene: Scene,
    node: int,
    direction: tuple[float, float, float],
    cosine: float,
    motion: PieceMotion,
) -> bool:
    """Whether no point of a sphere moves in any direction of a cone."""
    moves = scene.placement.moves[scene.placement.joint[node]]
    jacobian, lever, turning = (
        scene.placement.jacobian,
        scene.arm.lever[node],
        scene.table.box.turning,
    )
    radius, joints = scene.tree.radius[node], moves.shape[0]
    nx, ny, nz = direction
    # What is no number stands for all directions.
    cosine = min(cosine, 1.0) if cosine > 0.0 else 0.0
    sine = math.sqrt(1.0 - cosine * cosine)
    for k in range(motion.rates.shape[0]):
        vx = vy = vz = wx = wy = wz = bend = 0.0
        for j in range(joints):
            rate = motion.rates[k, j]
            if not moves[j] or rate == 0.0:
                continue
            x, y, z = _find_column(scene, node, j)
            vx, vy, vz = vx + rate * x, vy + rate * y, vz + rate * z
            wx, wy, wz = (
                wx + rate * jacobian[j, 3], wy + rate * jacobian[j, 4], wz + rate * jacobian[j, 5]
            )  # fmt: skip
            for i in range(joints):
                if moves[i]:
                    far = max(i, j)
                    arm = lever[far] + (radius if turning[far] else 0.0)
                    bend += abs(rate) * motion.spread[i] * arm
        along = vx * nx + vy * ny + vz * nz
        size = math.sqrt(vx * vx + vy * vy + vz * vz)
        across = math.sqrt(max(size * size - along * along, 0.0))
        towards = size if along >= size * cosine else along * cosine + across * sine
        towards += radius * math.sqrt(wx * wx + wy * wy + wz * wz) + bend
        if not towards <= RESTING:
            return False
    return True


@kernel
def _presses(scene: Scene, node: int, state: StatePlace, motion: PieceMotion) -> tuple[bool, bool]:
    """Whether a sphere can touch a body as it was measured, and whether it may press it then.

    Of a sphere with children only the first is asked.
    """
    bodies = scene.refused if state.is_refused else scene.bodies
    center, place = scene.arm.centers[node], state.place
    distance, x, y, z = distance_to_hull(
        center[0], center[1], center[2], bodies.points[place], bodies.velocities[place],
        bodies.point_count[place],
    )  # fmt: skip
    size = math.sqrt(x * x + y * y + z * z)
    reach = contact_distance(scene, node, bodies, state)
    direction, room = (1.0, 0.0, 0.0), 0.0
    if size > 0.0:
        direction = x / size, y / size, z / size
        advance = _find_advance(scene, node, direction, motion)
        room = distance - advance - bodies.position_error[place]
    if room > reach:
        return False, False
    if scene.tree.first_child[node] >= 0:
        return True, True
    return True, not _recedes(scene, node, direction, room / reach * (1.0 - SUM_ROUNDING), motion)


@kernel
def find_pressing_link(
    handle: Any, row: int, watched: BoolArray, motion: PieceMotion, now: float
) -> int:
    """A link that may press an obstacle that is touched, where that was measured.

    NO_LINK where there is none, and of an obstacle that is not touched.

    Args:
        handle: On the tick's `Scene`, its arm prepared.
        row: Of the obstacle.
        watched: Which links are watched against it. Shape (links,).
        motion: What the arm does.
        now: Time of the tick on the obstacles' clock, in [s].
    """
    scene = handle.content
    marks, tree = scene.marks, scene.tree
    if find_touching_link(handle, row, watched, now) == NO_LINK:
        return NO_LINK
    for number in possible_states(marks, row):
        state = own_place(scene, row, number, now)
        for link in range(tree.root.shape[0]):
            if not watched[link]:
                continue
            # Invariant: no sphere that was passed so far can touch it and press it.
            node = tree.root[link]
            while node >= 0:
                can_touch, presses = _presses(scene, node, state, motion)
                if can_touch and tree.first_child[node] >= 0:
                    node = tree.first_child[node]
                elif presses:
                    return link
                else:
                    node = tree.skip[node]
    return NO_LINK
