"""Bounds on how fast a gap between two spheres of an arm closes, by each joint between them.

A body part that rests between two links is pressed by two forces. They balance, so both act along
the line from a point x of one link to a point y of the other, and what the part takes up is the
force times how far |x - y| falls. With n the direction of that line and a joint that turns about an
axis a through o, |x - y| changes by the *arm* a . ((p - o) x n) of the line with each radian,
whichever point p of it is taken: in the frame of x, the joint moves y, or in that of y it moves x.

So let c be the centre of either sphere, u the direction from one to the other, J = a x (c - o), and
x and y anywhere within R and R' of the centres. Then n is within an angle of u whose sine is
(R + R') / D, with D the distance of the centres, and the arm differs from J . n by no more than
R |a x n|. The greatest of both over all such n bounds it, for each way of turning. Nor is it more
than how far the sphere's points can be from the axis, which is all that is left where the balls
meet, for n can be anything there. Both spheres give a bound, and the lesser one counts.

In a frame of the joint's axis, where a centre is depends on the joints between the two. So R is the
sphere's radius and what these can bring the centre off by in the box at hand, the nearest to the
sphere first. Of one sphere it depends on the joint itself as well, which turns it about the axis.
Of which one is a choice of the frame, so it counts for the one that it brings off by less.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from armguard.bounds.joint_box import JointBox, Vector
from armguard.bounds.table_time import ArmSphere
from armguard.jit.arrays import BoolArray, FloatArray
from armguard.jit.kernels import kernel
from armguard.jit.numerics import SUM_ROUNDING


class Arms(NamedTuple):
    """By how much the gap between two spheres closes at most with each joint."""

    forth: FloatArray
    """By a radian, or a metre, of a joint that moves forth, in [m]. Shape (nv,)."""
    back: FloatArray
    """The same of one that moves back. Shape (nv,)."""
    off: FloatArray
    """Room to work in: how far the spheres' centres can be from where they are at hand, in the
    frame of each joint's axis, in [m]. Shape (2, nv)."""
    ways: FloatArray
    """Room for how far joints go forth, how far back, and how far in all if in each moment they go
    the way in which they may be faster, in [rad] or [m], >= 0. Shape (3, nv)."""


def make_arms(joints: int) -> Arms:
    """For so many joints."""
    return Arms(np.zeros(joints), np.zeros(joints), np.zeros((2, joints)), np.zeros((3, joints)))


@kernel
def fill_arms(
    one: ArmSphere,
    radius: float,
    moves: BoolArray,
    other: ArmSphere,
    other_radius: float,
    other_moves: BoolArray,
    box: JointBox,
    arms: Arms,
) -> None:
    """Fill by how much the distance of any points of two spheres falls with each joint.

    Args:
        one: A sphere of the arm.
        radius: Its radius, in [m].
        moves: Which joints move it. Shape (nv,).
        other: Another one of the same arm at the same time.
        other_radius: Its radius, in [m].
        other_moves: Which joints move that. Shape (nv,).
        box: Where joints are, by their greatest displacements from the columns at hand.
        arms: Filled: 0 for joints that move both or none.
    """
    _fill_off(one, moves, other_moves, box, arms.off[0])
    _fill_off(other, other_moves, moves, box, arms.off[1])
    ux, uy, uz = other.x - one.x, other.y - one.y, other.z - one.z
    apart = math.sqrt(ux * ux + uy * uy + uz * uz)
    ux, uy, uz = ux / apart, uy / apart, uz / apart
    for j in range(moves.shape[0]):
        arms.forth[j] = arms.back[j] = 0.0
        if moves[j] == other_moves[j]:
            continue
        arms.forth[j] = arms.back[j] = 1.0
        if not box.turning[j]:
            continue
        size = box.span[2, j] + box.position_error[j]
        near, far = radius + arms.off[0, j], other_radius + arms.off[1, j]
        turned = (_find_length(one, j) + arms.off[0, j]) * size
        other_turned = (_find_length(other, j) + arms.off[1, j]) * size
        mine, theirs = near, far
        if turned < other_turned:
            mine += turned
        else:
            theirs += other_turned
        # Rounded up by far more than the cosine is wrong by.
        sine = (mine + theirs) / apart * (1.0 + SUM_ROUNDING)
        cosine = 0.0
        if sine < 1.0:
            cosine = math.sqrt(1.0 - sine * sine)
        else:
            sine = math.inf
        u = ux, uy, uz
        forth, back = _find_arm(one, near, mine, j, u, sine, cosine)
        other_forth, other_back = _find_arm(other, far, theirs, j, u, sine, cosine)
        # One that is no number never counts: levers are numbers.
        most = one.lever[j] + radius if moves[j] else other.lever[j] + other_radius
        forth = min(most, forth, other_forth)
        back = min(most, back, other_back)
        # Turning forth, a joint takes what it moves along J, so towards the other sphere by J . n.
        arms.forth[j], arms.back[j] = (forth, back) if moves[j] else (back, forth)


@kernel
def _fill_off(
    sphere: ArmSphere, mine: BoolArray, theirs: BoolArray, box: JointBox, off: FloatArray
) -> None:
    """Fill a row of `Arms.off` for a sphere."""
    joints = off.shape[0]
    # From the sphere on, joints that move it come first, the last one in front, then those that
    # move the other. Invariant: joints passed so far bring the centre off by no more than `moved`.
    moved = 0.0
    for k in range(2 * joints):
        j = joints - 1 - k if k < joints else k - joints
        if mine[j] == theirs[j] or mine[j] != (k < joints):
            continue
        off[j] = moved
        size = box.span[2, j] + box.position_error[j]
        if not box.turning[j]:
            moved += size
            continue
        distance = _find_length(sphere, j) + moved
        if mine[j] and not distance <= sphere.lever[j]:
            distance = sphere.lever[j]
        moved += distance * size


@kernel
def _find_column(sphere: ArmSphere, j: int) -> tuple[float, float, float]:
    """A joint's column of the Jacobian of a sphere's centre, or where that would be moved by it."""
    jacobian = sphere.jacobian
    ax, ay, az = jacobian[3, j], jacobian[4, j], jacobian[5, j]
    return (
        jacobian[0, j] + ay * sphere.z - az * sphere.y,
        jacobian[1, j] + az * sphere.x - ax * sphere.z,
        jacobian[2, j] + ax * sphere.y - ay * sphere.x,
    )


@kernel
def _find_length(sphere: ArmSphere, j: int) -> float:
    """How far a sphere's centre is from the axis of a joint, in [m]."""
    x, y, z = _find_column(sphere, j)
    return math.sqrt(x * x + y * y + z * z)


@kernel
def _find_arm(
    sphere: ArmSphere, beyond: float, radius: float, j: int, u: Vector, sine: float, cosine: float
) -> tuple[float, float]:
    """Greatest J . n + R |a x n|, and that of -J, over all directions within an angle of u.

    At least 0, and no more than how far points can be from the axis.

    Args:
        sphere: A sphere.
        beyond: How far points can be farther from the axis than its centre, in [m].
        radius: R, in [m].
        j: The joint.
        u: From one sphere to the other.
        sine: Of the angle; inf: all directions count.
        cosine: Of the angle.
    """
    x, y, z = _find_column(sphere, j)
    length = math.sqrt(x * x + y * y + z * z)
    # The columns of a point far from the origin were rounded as its place was.
    place = abs(sphere.x) + abs(sphere.y) + abs(sphere.z)
    rounding = SUM_ROUNDING * (place + length + radius)
    most = length + beyond + rounding
    if sine == math.inf:
        return most, most
    along, across = _split(x, y, z, u)
    jacobian = sphere.jacobian
    axial, around = _split(jacobian[3, j], jacobian[4, j], jacobian[5, j], u)
    axial = abs(axial)
    around = around * cosine + axial * sine if axial > sine else 1.0
    towards = length if along >= length * cosine else along * cosine + across * sine
    away = length if -along >= length * cosine else across * sine - along * cosine
    beside = radius * around + rounding
    return min(max(towards + beside, 0.0), most), min(max(away + beside, 0.0), most)


@kernel
def _split(x: float, y: float, z: float, u: Vector) -> tuple[float, float]:
    """How long a vector is along a unit vector, and across it."""
    ux, uy, uz = u
    cx, cy, cz = y * uz - z * uy, z * ux - x * uz, x * uy - y * ux
    return x * ux + y * uy + z * uz, math.sqrt(cx * cx + cy * cy + cz * cz)


@kernel
def find_approach(arms: Arms, box: JointBox) -> float:
    """By how much two spheres come nearer at most anywhere in a box, in [m].

    Args:
        arms: What `fill_arms` filled for that box.
        box: Where joints are, by `span`.
    """
    nearer = 0.0
    for j in range(arms.forth.shape[0]):
        forth, back, error = arms.forth[j], arms.back[j], box.position_error[j]
        most = 0.0
        # What closes nothing may go anywhere.
        if forth > 0.0:
            most = forth * (max(box.span[0, j], 0.0) + error)
        if back > 0.0:
            most = max(most, back * (max(-box.span[1, j], 0.0) + error))
        nearer += most
    return nearer * (1.0 + SUM_ROUNDING)


@kernel
def find_closing(arms: Arms) -> float:
    """By how much a gap closes at most while joints go as far as `arms.ways` says, in [m]."""
    closing = 0.0
    for j in range(arms.forth.shape[0]):
        forth, back, way = arms.forth[j], arms.back[j], 0.0
        # What closes nothing may go anywhere.
        if forth > 0.0:
            way = forth * arms.ways[0, j]
        if back > 0.0:
            way += back * arms.ways[1, j]
        most = max(forth, back)
        if most > 0.0:
            # It does not go forth and back at once.
            way = min(way, most * arms.ways[2, j])
        closing += way
    return closing * (1.0 + SUM_ROUNDING)
