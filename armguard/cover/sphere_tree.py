"""A tree of balls over pieces of a surface: each ball holds all pieces of the leaves below it.

Built from the leaves up: the two balls whose smallest common ball is smallest are joined, and so
on until one is left; then children are replaced by theirs while a ball has few. Two to four
children a ball let a descent stop early without many steps.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from armguard.cover.miniball import enclose_points
from armguard.jit.arrays import FloatArray, IntArray

GRID = 1e-6
"""Centres and radii are multiples of this, and geometry is known to this, in [m]."""
MARGIN = 2e-6
"""What a ball reaches beyond its pieces, in [m]: more than the diagonal of a grid cell."""

MOST_CHILDREN = 4


class SphereTree(NamedTuple):
    """Balls in breadth-first order, root first; the children of each lie side by side."""

    spheres: FloatArray
    """Centre and radius in [m]. Shape (n, 4)."""
    first_child: IntArray
    """Index of the first child; 0 for a leaf. Shape (n,)."""
    child_count: IntArray
    """Shape (n,)."""


class Node(NamedTuple):
    """A ball, the corners of the pieces that it owns, and what it is made of."""

    sphere: FloatArray
    corners: FloatArray
    children: list[Node]


def enclose(center: FloatArray, corners: FloatArray) -> FloatArray:
    """A ball on the grid whose radius clears the corners by the margin. Shape (4,)."""
    rounded = np.round(center / GRID) * GRID
    reach = float(np.sqrt(((corners - rounded) ** 2).sum(axis=1)).max()) + MARGIN
    # As decimals, so that a file that names them in full is short.
    return np.round(np.append(rounded, math.ceil(reach / GRID + 0.01) * GRID), 6)


def _join(first: Node, second: Node) -> Node:
    corners = np.concatenate([first.corners, second.corners])
    return Node(enclose(enclose_points(corners)[0], corners), corners, [first, second])


def build_tree(leaves: list[Node]) -> SphereTree:
    """Join the pair with the smallest common ball until one is left; then widen the tree."""
    nodes = list(leaves)
    joined = {(i, j): _join(nodes[i], nodes[j]) for j in range(len(nodes)) for i in range(j)}
    alive = set(range(len(nodes)))
    while len(alive) > 1:
        pair = min(joined, key=lambda key: (joined[key].sphere[3], key))
        nodes.append(joined[pair])
        alive -= set(pair)
        joined = {key: node for key, node in joined.items() if alive.issuperset(key)}
        joined |= {(i, len(nodes) - 1): _join(nodes[i], nodes[-1]) for i in sorted(alive)}
        alive.add(len(nodes) - 1)
    order, spheres, first_child, child_count = [nodes[-1]], [], [], []
    for node in order:  # grows while it is walked: breadth first
        children = _widen(node)
        spheres.append(node.sphere)
        first_child.append(len(order) if children else 0)
        child_count.append(len(children))
        order.extend(children)
    return SphereTree(
        np.array(spheres),
        np.array(first_child, dtype=np.int64),
        np.array(child_count, dtype=np.int64),
    )


def _widen(node: Node) -> list[Node]:
    """Replace the largest child by its own two children while there are few."""
    children = list(node.children)
    while len(children) < MOST_CHILDREN:
        inner = [i for i, child in enumerate(children) if child.children]
        if not inner:
            break
        largest = max(inner, key=lambda i: children[i].sphere[3])
        children[largest : largest + 1] = children[largest].children
    return children


def compute_parents(tree: SphereTree) -> IntArray:
    """Index of each node's parent, the root's own for the root."""
    return np.concatenate([[0], np.repeat(np.arange(len(tree.spheres)), tree.child_count)])
