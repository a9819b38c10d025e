"""Bounds on distances between spheres of different links of an arm.

Where something is between two links, it matters how near they can come. The distance of two
spheres depends on the joints between their links alone. With one revolute joint between them its
square is a + b cos x + c sin x in that joint's angle x: its least and greatest are known exactly.

Fixed links, such as the arm's base, have no spheres. Balls around their boxes represent them.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import pinocchio

from armguard.jit.arrays import BoolArray, FloatArray, IntArray
from armguard.jit.numerics import SUM_ROUNDING, VARIATION_SLACK
from armguard.robot.kinematics import Kinematics, SphereTree

FEWEST_PARTS = 6
"""Number of spheres that represent a link, unless it has fewer."""


class LinkGaps(NamedTuple):
    """How distances between spheres of links can vary; empty where no contact limits are stated."""

    parts: IntArray
    """Spheres that stand for links, between them all of the arm. Shape (c,)."""
    variation: FloatArray
    """How much the distance of a sphere, or of any below it, from such a part can vary, in [m]; 0
    where it cannot, inf where more than one joint lies between them, or one that slides.
    Shape (n, c)."""
    weight: FloatArray
    """How far any point of the arm can be from the axis of each joint, in [m]; 1: it slides.
    Shape (nv,)."""
    base: FloatArray
    """Balls around what no joint moves, in the world: centre and radius, in [m]. Shape (b, 4)."""


def make_no_gaps() -> LinkGaps:
    """The gaps of an arm for which no contact limits are stated."""
    return LinkGaps(np.zeros(0, dtype=np.int64), np.zeros((0, 0)), np.zeros(0), np.zeros((0, 4)))


def make_link_gaps(
    kinematics: Kinematics,
    lever: FloatArray,
    turning: BoolArray,
    lower: FloatArray,
    upper: FloatArray,
    base: FloatArray,
) -> LinkGaps:
    """How distances between the spheres of an arm can vary.

    Args:
        kinematics: Of the arm; placed anew.
        lever: R_j of its spheres, in [m]. Shape (n, nv).
        turning: Which joints are revolute. Shape (nv,).
        lower: Least joint positions, in [rad] or [m]; -inf for a continuous joint. Shape (nv,).
        upper: Greatest joint positions, alike.
        base: What `cover_base` returned.
    """
    home = np.clip(np.zeros(len(lower)), lower, upper)
    tree, placement = kinematics.spheres.tree, kinematics.placement
    parts = np.concatenate([_find_parts(tree, root) for root in tree.root.tolist()])
    moves = placement.moves[placement.joint]
    between = moves[:, None, :] ^ moves[parts][None]
    count = between.sum(axis=2)
    variation = np.where(count > 0, np.inf, 0.0)
    leaves_of = [_find_leaves(tree, part) for part in parts.tolist()]
    is_leaf = tree.first_child < 0
    for joint in np.flatnonzero(turning).tolist():
        pairs = (count == 1) & between[:, :, joint]
        low, high = lower[joint], upper[joint]
        if not high - low < 2.0 * np.pi:
            low, high = -np.pi, np.pi
        varies = _find_variation(kinematics, home, joint, low, high)
        for c, leaves in enumerate(leaves_of):
            rows = np.flatnonzero(pairs[:, c] & is_leaf)
            variation[rows, c] = varies[np.ix_(rows, leaves)].max(axis=1, initial=0.0)
            variation[pairs[:, c] & ~is_leaf, c] = 0.0
    # What holds for all spheres below a node holds for the node.
    for node in range(len(is_leaf) - 1, -1, -1):
        parent = tree.parent[node]
        if parent >= 0:
            variation[parent] = np.maximum(variation[parent], variation[node])
    reach = lever + np.where(turning, tree.radius[:, None], 0.0) * moves
    return LinkGaps(parts, variation, reach.max(axis=0), base)


def cover_base(
    fixed_points: Iterable[FloatArray], placement: pinocchio.SE3 | None = None
) -> FloatArray:
    """Balls around what no joint moves, eight to a link, in the world.

    The box of each link, along the axes of the base, is cut in half along each of them. A ball
    around such a part holds all of it.

    Args:
        fixed_points: By link, points whose hull contains it, in the base's frame, in [m].
        placement: Of the base in the world; None: they coincide.

    Returns:
        Centre and radius, in [m]. Shape (b, 4).
    """
    base = pinocchio.SE3.Identity() if placement is None else placement
    sides = np.stack(np.meshgrid(*[[0.25, 0.75]] * 3), axis=-1).reshape(-1, 3)
    balls = []
    for points in fixed_points:
        low, high = points.min(axis=0), points.max(axis=0)
        centers = (low + sides * (high - low)) @ base.rotation.T + base.translation
        size = np.abs(low).max() + np.abs(high).max() + np.abs(base.translation).max()
        radius = 0.25 * np.linalg.norm(high - low) + SUM_ROUNDING * size
        balls.append(np.column_stack([centers, np.full(len(centers), radius)]))
    return np.concatenate(balls) if balls else np.zeros((0, 4))


def _find_variation(
    kinematics: Kinematics, home: FloatArray, joint: int, low: float, high: float
) -> FloatArray:
    """How much distances between spheres vary while one joint turns within a range, in [m].

    With all other joints at rest the square of a distance is a + b cos x + c sin x, which three
    positions determine. Right for spheres of which this joint alone moves one. Shape (n, n).
    """
    squares = []
    for angle in (0.0, 0.5 * np.pi, np.pi):
        q = home.copy()
        q[joint] = angle
        kinematics.compute(q, np.zeros(len(home)))
        centers = kinematics.centers
        squares.append(((centers[:, None] - centers[None]) ** 2).sum(axis=2))
    mean = 0.5 * (squares[0] + squares[2])
    cosine, sine = 0.5 * (squares[0] - squares[2]), squares[1] - mean
    ends = [mean + cosine * np.cos(angle) + sine * np.sin(angle) for angle in (low, high)]
    least, most = np.minimum(*ends), np.maximum(*ends)
    swing = np.hypot(cosine, sine)
    farthest = np.arctan2(sine, cosine)
    # The next turn at which the distance is greatest, or least, from the lower end on.
    for shift, sign in ((0.0, 1.0), (np.pi, -1.0)):
        is_passed = (farthest + shift - low) % (2.0 * np.pi) <= high - low
        extreme = mean + sign * swing
        least = np.where(is_passed, np.minimum(least, extreme), least)
        most = np.where(is_passed, np.maximum(most, extreme), most)
    varies: FloatArray = np.sqrt(np.maximum(most, 0.0)) - np.sqrt(np.maximum(least, 0.0))
    return varies + VARIATION_SLACK


def _find_parts(tree: SphereTree, root: int) -> IntArray:
    """Nodes below a root that own between them all that it owns."""
    level = [root]
    while len(level) < FEWEST_PARTS:
        opened = [node for node in level if tree.first_child[node] >= 0]
        if not opened:
            break
        level = [node for node in level if tree.first_child[node] < 0]
        for node in opened:
            level += _find_children(tree, node)
    return np.array(level, dtype=np.int64)


def _find_children(tree: SphereTree, node: int) -> list[int]:
    first = int(tree.first_child[node])
    if first < 0:
        return []
    last = first
    while last < len(tree.parent) and tree.parent[last] == node:
        last += 1
    return list(range(first, last))


def _find_leaves(tree: SphereTree, node: int) -> IntArray:
    """The leaves below a node, or the node itself where it is one."""
    found, left = [], [node]
    while left:
        node = left.pop()
        children = _find_children(tree, node)
        if children:
            left += children
        else:
            found.append(node)
    return np.array(sorted(found), dtype=np.int64)
