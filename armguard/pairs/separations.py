"""The directions of a proof, which separate each part of a link from an obstacle.

What decides a tick keeps no directions. Here they are looked for once more, for one link and one
state of an obstacle, and written down: down the link's tree of spheres, each by the longest
intervals of a table that one direction proves, from halves of what is left.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from armguard.bounds.joint_box import set_columns
from armguard.bounds.joint_table import JointTable, fill_table
from armguard.bounds.surface_speed import find_harmless_node
from armguard.bounds.table_time import ArmSphere, aim, is_interval_free, is_usable
from armguard.contact.bodies import Bounds, Hull
from armguard.jit.arrays import FloatArray, IntArray
from armguard.jit.kernels import kernel
from armguard.jit.numerics import SUM_ROUNDING, TERM_ROUNDING
from armguard.pairs.contact_time import (
    contact_distance,
    hull_of,
    limit_of,
    moves_of,
    own_place,
)
from armguard.pairs.scene import Scene, sphere_of

FAILED = -1
"""In place of a number of separations, where a sphere cannot be kept apart."""

REACH = -1
"""In place of a sphere: the ball that a link cannot leave."""


class Separations(NamedTuple):
    """What keeps spheres of a link apart from a state of an obstacle, and room to find it."""

    sphere: IntArray
    """Which spheres; together they hold the link. REACH stands for the ball that the whole link
    cannot leave. Shape (n,)."""
    steps: IntArray
    """How many directions each of them takes. Shape (n,)."""
    end: IntArray
    """The node of the table up to which each direction separates, from the one before it on, or
    from the first node. Shape (n × nodes,)."""
    normal: FloatArray
    """The directions, unit vectors from the arm to the obstacle. Shape (n × nodes, 3)."""


class ProofScene(NamedTuple):
    """A tick, and a table of its own, which a proof is made by."""

    scene: Scene
    table: JointTable
    found: Separations
    still: FloatArray
    """Zeros: the Jacobian, transposed, of what no joint moves. Shape (nv, 6)."""


def make_separations(spheres: int, nodes: int) -> Separations:
    """Room for those of a link of so many spheres, by a table of so many nodes."""
    most = spheres * nodes
    counts = np.zeros((2, spheres), dtype=np.int64)
    return Separations(counts[0], counts[1], np.zeros(most, dtype=np.int64), np.zeros((most, 3)))


@kernel
def _separate(
    sphere: ArmSphere,
    table: JointTable,
    hull: Hull,
    distance: float,
    goal: int,
    found: Separations,
    begin: int,
) -> int:
    """Fill directions from `begin` on that separate up to a node; how many, or FAILED."""
    are_finite = set_columns(sphere.x, sphere.y, sphere.z, sphere.jacobian, table.box)
    if not (are_finite and is_usable(hull, distance)):
        return FAILED
    # One that passes by is better seen from where it is headed than from where it could turn.
    accel, _, error, age = hull.bounds
    bounds = Bounds(accel, np.inf, error, age)
    headed = Hull(hull.points, hull.velocities, hull.size, bounds)
    first, place = 0, begin
    while first < goal:
        last = goal
        while last > first:
            normal = aim(sphere, table, last, hull)
            if is_interval_free(sphere, table, hull, distance, normal, (first, last, 1.0)):
                break
            normal = aim(sphere, table, last, headed)
            if is_interval_free(sphere, table, hull, distance, normal, (first, last, 1.0)):
                break
            last = first + (last - first) // 2
        if last == first:
            return FAILED
        found.end[place] = last
        found.normal[place, 0], found.normal[place, 1], found.normal[place, 2] = normal
        first, place = last, place + 1
    return place - begin


@kernel
def find_separations(
    handle: Any, link: int, row: int, number: int, now: float, brakes: bool
) -> int:
    """Find what keeps a link apart from one state of an obstacle until the table ends.

    With a table of an arm that brakes, a sphere need not be kept apart from when on it is slow
    enough for a contact that is permitted.

    Args:
        handle: On a `ProofScene`, its arm placed.
        link: Of the arm.
        row: Of the obstacle, of which something is known.
        number: Of its state, as in `possible_states`.
        now: Time of the tick on the obstacles' clock, in [s].
        brakes: Whether the table is of an arm that brakes.

    Returns:
        How many spheres take part; FAILED where one cannot be kept apart.
    """
    proof = handle.content
    scene, table, found, still = proof.scene, proof.table, proof.found, proof.still
    tree = scene.tree
    state = own_place(scene, row, number, now)
    bodies = scene.refused if state.is_refused else scene.bodies
    hull, limit = hull_of(bodies, state.place, state.age), limit_of(scene, row).max_speed
    goal = table.time.shape[0] - 1
    # What the link cannot leave proves most where the obstacle is far off.
    ball, lever = scene.arm.link_balls[link], still[:, 0]
    whole = ArmSphere(ball[0], ball[1], ball[2], still.T, lever, lever)
    distance = ball[3] + state.radius + scene.settings.margin + bodies.position_error[state.place]
    found.steps[0] = _separate(whole, table, hull, distance * (1.0 + TERM_ROUNDING), goal, found, 0)
    if found.steps[0] != FAILED:
        found.sphere[0] = REACH
        return 1
    node, count, step = tree.root[link], 0, 0
    while node >= 0:
        sphere = sphere_of(scene, node)
        distance = contact_distance(scene, node, bodies, state)
        taken = _separate(sphere, table, hull, distance, goal, found, step)
        if taken == FAILED and brakes and limit > 0.0 and tree.first_child[node] < 0:
            slow, _ = find_harmless_node(
                sphere, tree.radius[node], moves_of(scene, node), table, limit
            )
            taken = _separate(sphere, table, hull, distance, slow, found, step)
        if taken != FAILED:
            found.sphere[count], found.steps[count] = node, taken
            count, step, node = count + 1, step + taken, tree.skip[node]
        elif tree.first_child[node] >= 0:
            node = tree.first_child[node]
        else:
            return FAILED
    return count


@kernel
def tabulate(handle: Any, q: FloatArray, v: FloatArray, age: float, free: float) -> None:
    """Fill the table of a `ProofScene`, and widen it by what rounding can have taken.

    Joints are free for `free` [s] from their stamp, and brake then; inf: they never do.
    """
    table = handle.content.table
    fill_table(q, v, age, free, handle.content.scene.limits, table)
    for j in range(table.highest.shape[0]):
        for k in range(table.time.shape[0]):
            high = min(table.high[k, j], table.highest[j])
            low = max(table.low[k, j], table.lowest[j])
            slack = SUM_ROUNDING * (1.0 + abs(high) + abs(low) + abs(q[j]))
            table.high[k, j], table.low[k, j] = high + slack, low - slack
        table.highest[j], table.lowest[j] = np.inf, -np.inf
