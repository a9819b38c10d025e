"""The data of one tick, and the evaluation of pairs of link and obstacle.

A `TickState` lays out for compiled code what kinematics, motion models and the obstacle table hold;
`evaluate` finds the contact times of any number of pairs. All arrays are flat and belong to others;
nothing here allocates per pair.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from armguard.bounds.arm import ArmMotion
from armguard.jit.arrays import FloatArray, IntArray
from armguard.jit.handle import pack
from armguard.jit.kernels import kernel
from armguard.obstacles.obstacles import Obstacles
from armguard.obstacles.possible_states import is_known
from armguard.obstacles.regions import RegionLimits, make_no_limits
from armguard.obstacles.table import States
from armguard.pairs.contact_time import (
    RESTS,
    arm_reach_time,
    pair_time,
    partner_of,
    rests_in_time,
)
from armguard.pairs.scene import (
    UNKNOWN,
    ArmArrays,
    Scene,
    Settings,
    make_clamp_room,
    prepare_arm,
)
from armguard.robot.kinematics import Kinematics

NO_LIMIT = 2**62
"""A number of evaluations that is never reached."""


class TickState:
    """The numeric state of one tick: arm spheres and obstacles at one `now`.

    Args:
        kinematics: Whose centres and velocities are read.
        motion: Whose bounds are read.
        obstacles: Whose table is read.
        margin: Distance in [m] that counts as contact already.
        contact_limits: What contact is permitted; None: none.

    Attributes:
        scene: Everything as compiled code sees it.
        handle: The same as one argument for it.
        now: Time of this tick on the obstacles' clock, in [s].
        arm_age: Age of the joint state, in [s]; negative where it is newer than `now`.
        refinement_threshold: Nodes that could be touched before this, in [s], are refined.
    """

    scene: Scene
    handle: Any

    def __init__(
        self,
        kinematics: Kinematics,
        motion: ArmMotion,
        obstacles: Obstacles,
        *,
        margin: float,
        contact_limits: RegionLimits | None = None,
    ) -> None:
        self.now = 0.0
        self.arm_age = 0.0
        self.refinement_threshold = 0.0
        self.tree = kinematics.spheres.tree
        self.link_of = kinematics.spheres.link
        self.motion = motion
        isotropic, joint = motion.isotropic, motion.joint
        self.arm = ArmArrays(
            kinematics.centers,
            kinematics.velocities,
            isotropic.accel,
            isotropic.speed,
            isotropic.position_error,
            isotropic.velocity_error,
            joint.lever,
            joint.slope_error,
            motion.reach.link_balls,
            motion.reach.arm_ball,
        )
        self._settings = Settings(float(margin), motion.with_joints)
        self._contact_limits = make_no_limits() if contact_limits is None else contact_limits
        gaps = motion.link_gaps
        self._clamp_room = make_clamp_room(
            motion.joint.lever.shape[1], len(gaps.parts) + len(gaps.base), len(self.tree.radius)
        )
        self._kinematics = kinematics
        count = len(self.tree.radius)
        self.sphere_time = np.full(count, np.inf)
        """Soonest contact time that each sphere was given in this tick, [s]. Shape (n,)."""
        self._node_time = np.zeros(count)
        self._node_bound = np.zeros(count, dtype=np.int64)
        links = len(self.tree.root)
        self._link_time, self._link_bound = np.zeros(links), np.zeros(links, dtype=np.int64)
        self._obstacles = obstacles
        self._accepted: States | None = None
        self.view_table()

    def prepare_arm(self, q: FloatArray, v: FloatArray) -> None:
        """Fill what evaluations need of the arm, whose joints were placed; each of shape (nv,)."""
        _prepare_arm(self.handle, q, v, self.arm_age)

    def view_table(self) -> bool:
        """View the table's arrays, which are replaced whenever it grows; whether they were."""
        table = self._obstacles.table
        if table.accepted is self._accepted:
            return False
        self._accepted = self.bodies = table.accepted
        self.refused_bodies = table.refused_states
        self.marks = table.marks
        motion = self.motion
        self.scene = Scene(
            self.tree,
            self.arm,
            self._kinematics.placement,
            motion.isotropic.velocity_errors,
            motion.joint.limits,
            motion.table,
            motion.braking_table,
            self.bodies,
            self.refused_bodies,
            self.marks,
            table.tethers,
            self._contact_limits,
            motion.link_gaps,
            self._clamp_room,
            table.reference_states,
            self._settings,
            self._node_time,
            self._node_bound,
            self._link_time,
            self._link_bound,
            self.sphere_time,
        )
        self.handle = pack(self.scene)
        return True


@kernel
def _prepare_arm(handle: Any, q: FloatArray, v: FloatArray, age: float) -> None:
    prepare_arm(handle.content, q, v, age)


@kernel
def evaluate_handle(
    handle: Any,
    pairs: IntArray,
    now: float,
    arm_age: float,
    refinement_threshold: float,
    contact_times: FloatArray,
    nodes: IntArray,
    bounds: NDArray[np.int8],
) -> int:
    """`evaluate` on the handle of a scene; times in [s]."""
    scene = handle.content
    links = scene.tree.root.shape[0]
    evaluations = 0
    last_row, lower_bound = -1, 0.0
    for index in range(pairs.shape[0]):
        row, link = pairs[index] // links, pairs[index] % links
        contact_times[index] = 0.0
        nodes[index] = scene.tree.root[link]
        bounds[index] = UNKNOWN
        if not is_known(scene.marks, row):
            continue
        if row != last_row:
            last_row = row
            lower_bound, spent = arm_reach_time(scene, row, now)
            evaluations += spent
        time, node, bound, spent = pair_time(
            handle, link, row, now, arm_age, lower_bound, refinement_threshold, np.inf
        )
        evaluations += spent
        contact_times[index] = time
        nodes[index] = node
        bounds[index] = bound
    return evaluations


def evaluate(
    state: TickState,
    pairs: IntArray,
    contact_times: FloatArray,
    nodes: IntArray,
    bounds: NDArray[np.int8],
) -> int:
    """Earliest possible contact of each pair, in [s] from the state's `now`.

    Args:
        state: The tick's numbers.
        pairs: Pair numbers, obstacle row × links + link. Shape (m,).
        contact_times: Filled with the answers; 0 where an obstacle's whereabouts are unknown.
            Shape (m,) or longer.
        nodes: Filled with the sphere that decided each pair. Shape (m,) or longer.
        bounds: Filled with what each time rests on, an index of `BOUND_NAMES`. Shape (m,) or
            longer.

    Returns:
        Kernel evaluations spent.
    """
    spent: int = evaluate_handle(
        state.handle,
        pairs,
        state.now,
        state.arm_age,
        state.refinement_threshold,
        contact_times,
        nodes,
        bounds,
    )
    return spent


@kernel
def _find_partner_row(handle: Any, row: int, now: float, horizon: float) -> int:
    partner: int = partner_of(handle.content, row, now, horizon).row
    return partner


def find_partner_row(state: TickState, row: int) -> int:
    """Row of the obstacle by which another one, that is tethered to it, is judged; or NO_PARTNER.

    Args:
        state: The tick's numbers.
        row: Of the other one.
    """
    horizon = state.refinement_threshold
    found: int = _find_partner_row(state.handle, row, state.now, horizon)
    return found


@kernel
def _find_unsafe(handle: Any, pairs: IntArray, now: float) -> tuple[int, int]:
    links = handle.content.tree.root.shape[0]
    evaluations = 0
    for pair in pairs:
        answer, spent, _, _ = rests_in_time(handle, pair % links, pair // links, now, NO_LIMIT)
        evaluations += spent
        if answer != RESTS:
            return pair, evaluations
    return -1, evaluations


def find_unsafe_pair(state: TickState, pairs: IntArray) -> tuple[int, int]:
    """The first of the pairs (m,) that might touch before the arm rests; -1 if there is none.

    Judged by the scene's table of braking. Returns the evaluations as well.
    """
    unsafe: tuple[int, int] = _find_unsafe(state.handle, pairs, state.now)
    return unsafe
