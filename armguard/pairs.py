"""The numbers of one tick, and the evaluation of pairs of link and obstacle on them.

A `TickState` exists only once kinematics and bounds have run for its tick, so whoever holds one
cannot look too early. `evaluate` descends the link's tree of spheres: a node's bound holds for
everything it owns, and its children are opened only while a closer look could matter to the
verdict. Every node on the way is a proof by itself, so the sharper of a node's and its parent's
answers is taken. All arrays are flat and belong to others; nothing here allocates per pair.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from armguard.bounds import IsotropicMotion
from armguard.compilation import kernel
from armguard.contact import pair_distance_time, row_contact_time
from armguard.kinematics import ArmSpheres, Kinematics
from armguard.obstacle_table import Marks, States
from armguard.obstacles import Obstacles

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

ROUNDING = 1e-14
"""Relative widening of a sum of a few contact distances, far above its rounding error."""


class SphereTree(NamedTuple):
    """All links' sphere trees in one, threaded so that it can be walked without a stack."""

    root: IntArray
    """First node of each link. Shape (links,)."""
    first_child: IntArray
    """First child of each node, -1 for a leaf. Shape (n,)."""
    parent: IntArray
    """Parent of each node, -1 for a root. Shape (n,)."""
    skip: IntArray
    """Where to go on when a node is not opened; -1 at the end of its link. Shape (n,)."""
    radius: FloatArray
    """[m]. Shape (n,)."""


class ArmArrays(NamedTuple):
    """The arm's spheres in this tick."""

    centers: FloatArray
    """[m], world. Shape (n, 3)."""
    velocities: FloatArray
    """[m/s], world. Shape (n, 3)."""
    accel: FloatArray
    """Bound on acceleration, [m/s²]. Shape (n,)."""
    speed: FloatArray
    """Bound on speed, [m/s]. Shape (n,)."""
    position_error: FloatArray
    """[m]. Shape (n,)."""
    velocity_error: FloatArray
    """[m/s]. Shape (n,)."""


class TickState:
    """The numeric state of one tick: arm spheres and obstacles at one `now`.

    Args:
        kinematics: Whose centres and velocities are read.
        motion: Whose bounds are read.
        obstacles: Whose table is read.
        margin: Distance in [m] that counts as contact already.
        advances: Tangent advances per evaluation; any number is safe.
        by_distance: Evaluate distance over closing-speed bound instead of contact time.
    """

    def __init__(
        self,
        kinematics: Kinematics,
        motion: IsotropicMotion,
        obstacles: Obstacles,
        *,
        margin: float,
        advances: int,
        by_distance: bool,
    ) -> None:
        self.margin = margin
        self.advances = advances
        self.by_distance = by_distance
        self.now = 0.0
        self.arm_age = 0.0
        self.opening_time = 0.0
        self.tree = thread_tree(kinematics.spheres)
        self.link_of = kinematics.spheres.link
        self.arm = ArmArrays(
            kinematics.centers,
            kinematics.velocities,
            motion.accel,
            motion.speed,
            motion.position_error,
            motion.velocity_error,
        )
        self._obstacles = obstacles
        self.sphere_time = np.full(len(self.tree.radius), np.inf)
        """Soonest contact time that each sphere was given in this tick, [s]. Shape (n,)."""
        self._node_time = np.zeros(len(self.tree.radius))
        self._view_table()

    def begin(self, now: float, arm_age: float, opening_time: float) -> None:
        """Start a tick, after kinematics and bounds were computed for it.

        Args:
            now: Time of this tick on the obstacles' clock, in [s].
            arm_age: Age of the joint state, in [s]; negative where it is newer than `now`.
            opening_time: Nodes that could be touched before this, in [s], are looked at closer.
        """
        self.now = now
        self.arm_age = arm_age
        self.opening_time = opening_time
        self.sphere_time.fill(np.inf)
        self._view_table()

    def _view_table(self) -> None:
        """Look at the table's arrays, which are replaced whenever it grows."""
        table = self._obstacles.table
        self.bodies = table.accepted
        self.refused_bodies = table.refused_states
        self.marks = table.marks
        self.arrays = (*self.tree, *self.arm, *self.bodies, *self.refused_bodies, *self.marks)


def thread_tree(spheres: ArmSpheres) -> SphereTree:
    """Add parents and skips to the sphere trees, so that kernels walk them without a stack."""
    count = len(spheres.radius)
    parent = np.full(count, -1, dtype=np.int64)
    skip = np.full(count, -1, dtype=np.int64)
    first_child = np.where(spheres.child_count > 0, spheres.first_child, -1).astype(np.int64)
    # Parents stand before their children, so every skip is known before it is handed down.
    for node in range(count):
        first = first_child[node]
        for child in range(first, first + int(spheres.child_count[node]) if first >= 0 else first):
            last = child == first + spheres.child_count[node] - 1
            parent[child] = node
            skip[child] = skip[node] if last else child + 1
    return SphereTree(spheres.root, first_child, parent, skip, spheres.radius)


@kernel
def _link_time(
    link: int,
    row: int,
    tree: SphereTree,
    arm: ArmArrays,
    bodies: States,
    arm_age: float,
    body_age: float,
    margin: float,
    opening_time: float,
    advances: int,
    by_distance: bool,
    node_time: FloatArray,
    sphere_time: FloatArray,
) -> tuple[float, int, int]:
    """Contact time of one link and one body, the node that decided, and evaluations spent."""
    best = np.inf
    best_node = tree.root[link]
    evaluations = 0
    node = tree.root[link]
    while node >= 0:
        reach = tree.radius[node] + bodies.radius[row] + margin
        reach += arm.position_error[node] + bodies.position_error[row]
        reach *= 1.0 + ROUNDING
        if by_distance:
            time = pair_distance_time(
                arm.centers[node, 0],
                arm.centers[node, 1],
                arm.centers[node, 2],
                arm.velocities[node, 0],
                arm.velocities[node, 1],
                arm.velocities[node, 2],
                arm.accel[node],
                arm.speed[node],
                arm.velocity_error[node],
                arm_age,
                bodies.points[row],
                bodies.velocities[row],
                bodies.point_count[row],
                bodies.accel[row],
                bodies.speed[row],
                bodies.velocity_error[row],
                body_age,
                reach,
            )
        else:
            time = row_contact_time(
                arm.centers[node, 0],
                arm.centers[node, 1],
                arm.centers[node, 2],
                arm.velocities[node, 0],
                arm.velocities[node, 1],
                arm.velocities[node, 2],
                arm.accel[node],
                arm.speed[node],
                arm.velocity_error[node],
                arm_age,
                bodies.points,
                bodies.velocities,
                row,
                bodies.point_count[row],
                bodies.accel[row],
                bodies.speed[row],
                bodies.velocity_error[row],
                body_age,
                reach,
                advances,
            )
        evaluations += 1
        if not time >= 0.0:
            time = 0.0
        # The parent's bound holds for all that this node owns, so the later of the two stands.
        if tree.parent[node] >= 0:
            time = max(time, node_time[tree.parent[node]])
        node_time[node] = time
        sphere_time[node] = min(sphere_time[node], time)
        opens = tree.first_child[node] >= 0 and time < opening_time and time < best
        if opens:
            node = tree.first_child[node]
            continue
        if time < best:
            best = time
            best_node = node
        node = tree.skip[node]
    return best, best_node, evaluations


@kernel
def _evaluate(
    pairs: IntArray,
    now: float,
    arm_age: float,
    margin: float,
    opening_time: float,
    advances: int,
    by_distance: bool,
    node_time: FloatArray,
    sphere_time: FloatArray,
    contact_times: FloatArray,
    nodes: IntArray,
    *arrays: Any,
) -> int:
    """Fill contact times and deciding nodes of `pairs`; evaluations spent.

    `arrays` are the fields of tree, arm, accepted and refused bodies, and marks, in that order:
    one by one they cross into compiled code three times faster than in tuples.
    """
    tree = SphereTree(*arrays[0:5])
    arm = ArmArrays(*arrays[5:11])
    bodies = States(*arrays[11:20])
    refused_bodies = States(*arrays[20:29])
    marks = Marks(*arrays[29:37])
    links = tree.root.shape[0]
    evaluations = 0
    for index in range(pairs.shape[0]):
        row = pairs[index] // links
        link = pairs[index] % links
        best = np.inf
        best_node = tree.root[link]
        if marks.has_state[row]:
            age = 0.0 if marks.static[row] else now - bodies.stamp[row]
            best, best_node, spent = _link_time(
                link,
                row,
                tree,
                arm,
                bodies,
                arm_age,
                age,
                margin,
                opening_time,
                advances,
                by_distance,
                node_time,
                sphere_time,
            )
            evaluations += spent
        if marks.refused[row] and not marks.refused_finite[row]:
            best = 0.0
        elif marks.refused[row]:
            # Both tracks are possible until one of them is confirmed.
            other, other_node, spent = _link_time(
                link,
                row,
                tree,
                arm,
                refused_bodies,
                arm_age,
                now - refused_bodies.stamp[row],
                margin,
                opening_time,
                advances,
                by_distance,
                node_time,
                sphere_time,
            )
            evaluations += spent
            if other < best:
                best, best_node = other, other_node
        elif not marks.has_state[row]:
            best = 0.0
        contact_times[index] = best
        nodes[index] = best_node
    return evaluations


def evaluate(state: TickState, pairs: IntArray, contact_times: FloatArray, nodes: IntArray) -> int:
    """Earliest possible contact of each pair, in [s] from the state's `now`.

    Args:
        state: The tick's numbers.
        pairs: Pair numbers, obstacle row × links + link. Shape (m,).
        contact_times: Filled with the answers; 0 where an obstacle's whereabouts are unknown.
            Shape (m,) or longer.
        nodes: Filled with the sphere that decided each pair. Shape (m,) or longer.

    Returns:
        Kernel evaluations spent.
    """
    spent: int = _evaluate(
        pairs,
        state.now,
        state.arm_age,
        state.margin,
        state.opening_time,
        state.advances,
        state.by_distance,
        state._node_time,
        state.sphere_time,
        contact_times,
        nodes,
        *state.arrays,
    )
    return spent
