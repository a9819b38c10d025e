"""The data of one tick for compiled code: arm, motion bounds and obstacles, as flat arrays.

Everything here is a view on what others own and fill. A `Scene` holds for as long as none of these
arrays is replaced, which only a growing obstacle table does.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from armguard.bounds.closing import Arms, make_arms
from armguard.bounds.isotropic import VelocityErrors, fill_velocity_errors
from armguard.bounds.joint_table import JointTable, fill_table
from armguard.bounds.limits import JointLimits
from armguard.bounds.link_gaps import LinkGaps
from armguard.bounds.table_time import ArmSphere
from armguard.jit.arrays import FloatArray, IntArray
from armguard.jit.kernels import kernel, separate_kernel
from armguard.obstacles.regions import RegionLimits
from armguard.obstacles.table import Marks, States
from armguard.obstacles.tethers import Tethers
from armguard.robot.kinematics import ArmPlacement, SphereTree, move_spheres

UNKNOWN, REACH, ISOTROPIC, JOINT = range(4)
"""What a contact time rests on: nothing (the obstacle's whereabouts are unknown), or a bound on the
arm's motion."""

BOUND_NAMES = ("unknown", "reach", "isotropic", "joint")
"""How these are called where users see them."""

ADVANCES = 8
"""Steps of conservative advancement in an evaluation, at most. Any number is safe; nearly every
pair has converged by then, and no verdict was seen to change with more."""


class ArmArrays(NamedTuple):
    """The arm's spheres in this tick, and how each can move."""

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
    lever: FloatArray
    """R_j, [m]. Shape (n, nv)."""
    slope_error: FloatArray
    """What columns of the Jacobian may be off by, [m]. Shape (n, nv)."""
    link_balls: FloatArray
    """What each link cannot leave: centre and radius, [m]. Shape (links, 4)."""
    arm_ball: FloatArray
    """What the arm cannot leave: centre and radius, [m]. Shape (4,)."""


MOST_NEAR = 32
"""Obstacles near one link that are looked at one by one; more of them count as one that is near."""


class ClampRoom(NamedTuple):
    """Room to work in for `clamping`."""

    pair: Arms
    """By how much the gap between two spheres closes with each joint."""
    closing: FloatArray
    """Those of the gaps between a sphere and the parts near it, by radians forth and back, in [m].
    Shape (parts, 2, nv)."""
    near: IntArray
    """Rows of obstacles near one link. Shape (MOST_NEAR,)."""
    nearest: IntArray
    """Which part was found near a sphere last: it is asked first. Shape (n,)."""


def make_clamp_room(joints: int, parts: int, spheres: int) -> ClampRoom:
    """Room for an arm with so many joints, spheres that stand for its links, and spheres in all."""
    closing, near = np.zeros((parts, 2, joints)), np.zeros(MOST_NEAR, dtype=np.int64)
    return ClampRoom(make_arms(joints), closing, near, np.zeros(spheres, dtype=np.int64))


class Settings(NamedTuple):
    """What does not change while a monitor lives."""

    margin: float
    """Distance that counts as contact already, [m]."""
    with_joints: bool
    """Whether joint bounds are used."""


class Scene(NamedTuple):
    """All that the evaluation of pairs reads, and the room that it works in."""

    tree: SphereTree
    arm: ArmArrays
    placement: ArmPlacement
    velocity_errors: VelocityErrors
    limits: JointLimits
    table: JointTable
    """Joint displacements from this tick's state."""
    braking: JointTable
    """The same for an arm that brakes after the next tick, until it rests."""
    bodies: States
    """Accepted states of obstacles."""
    refused: States
    """Refused ones that may be true as well; see `obstacles.possible_states`."""
    marks: Marks
    tethers: Tethers
    """Between obstacles; see `obstacles.partners`."""
    contact_limits: RegionLimits
    """What contact is permitted, by region."""
    link_gaps: LinkGaps
    """How distances between links can vary, for what can be clamped between them."""
    clamp_room: ClampRoom
    references: States
    """States of obstacles that all later ones are compared with."""
    settings: Settings
    node_time: FloatArray
    """Room to work in: contact time of each sphere in the present evaluation. Shape (n,)."""
    node_bound: IntArray
    """Room to work in: what that rests on. Shape (n,)."""
    link_time: FloatArray
    """Room to work in: times that links were given, [s]. Shape (links,)."""
    link_bound: IntArray
    """Room to work in: what those rest on. Shape (links,)."""
    sphere_time: FloatArray
    """Soonest contact time that each sphere was given in this tick, [s]. Shape (n,)."""


@kernel
def sphere_of(scene: Scene, node: int) -> ArmSphere:
    """A sphere of the arm whose joints are bounded."""
    arm = scene.arm
    return ArmSphere(
        arm.centers[node, 0], arm.centers[node, 1], arm.centers[node, 2],
        scene.placement.jacobian.T, arm.lever[node], arm.slope_error[node],
    )  # fmt: skip


@separate_kernel
def prepare_arm(scene: Scene, q: FloatArray, v: FloatArray, age: float) -> None:
    """Fill all that evaluations need to know of the arm, whose joints are placed already.

    Args:
        scene: The tick.
        q: Joint positions, [rad] or [m]. Shape (nv,).
        v: Joint velocities, [rad/s] or [m/s]. Shape (nv,).
        age: Of the joint state, in [s]; negative where it is newer than the tick.
    """
    move_spheres(scene.placement, v)
    fill_velocity_errors(v, scene.velocity_errors)
    if scene.settings.with_joints:
        fill_table(q, v, age, np.inf, scene.limits, scene.table)
