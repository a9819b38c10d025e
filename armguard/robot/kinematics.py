"""Positions and velocities of the arm's spheres, from Pinocchio's results read in place.

One call of Pinocchio places all joints and fills the Jacobian; the rest is compiled.
`pinocchio.Data` keeps the placements of all joints in a C++ vector, which a strided NumPy view
covers, so one kernel fills the centres and velocities of every sphere without a copy, an allocation
or a Python loop. The layout behind that view is no promise of Pinocchio's, so it is checked against
the library's own accessors at construction.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pinocchio

from armguard.exceptions import ArmguardError
from armguard.jit.arrays import BoolArray, FloatArray, IntArray
from armguard.jit.kernels import kernel
from armguard.robot.links import is_rotation
from armguard.robot.robot import Robot

PLACEMENT_STRIDE = 96
"""Bytes from one joint placement to the next: rotation (column-major), then translation."""
TRANSLATION_OFFSET = 72


class ArmPlacement(NamedTuple):
    """Where an arm's joints and spheres are, for compiled code; all but the last two are read."""

    rotation: FloatArray
    """Of joint frames, world from joint. Shape (J, 3, 3)."""
    translation: FloatArray
    """Origins of joint frames in the world, in [m]. Shape (J, 3)."""
    jacobian: FloatArray
    """Pinocchio's `data.J`, transposed: each joint's motion at the world's origin, linear part
    first. Shape (nv, 6)."""
    moves: BoolArray
    """Which joints move which joint's frame. Shape (J, nv)."""
    joint: IntArray
    """Pinocchio's index of the joint that carries each sphere. Shape (n,)."""
    local: FloatArray
    """Sphere centres in that joint's frame, in [m]. Shape (n, 3)."""
    centers: FloatArray
    """Sphere centres in the world, in [m]. Shape (n, 3)."""
    velocities: FloatArray
    """Their velocities in the world, in [m]/[s]. Shape (n, 3)."""


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


class ArmSpheres:
    """The sphere trees of all links in one flat set of read-only arrays.

    Links follow each other in the order of `robot.links`, each tree breadth-first with its root
    first, so the children of a sphere are contiguous.

    Attributes:
        link: Index of the link in `robot.links`. Shape (n,).
        joint: Pinocchio's index of the joint that moves the sphere. Shape (n,).
        local: Centres in the frame of that joint, in [m]. Shape (n, 3).
        radius: Radii, in [m]. Shape (n,).
        first_child: Index of the first child, -1 for a leaf. Shape (n,).
        child_count: Number of children, 0 for a leaf. Shape (n,).
        root: Index of each link's root. Shape (L,).
        tree: The same for compiled code.
    """

    def __init__(self, robot: Robot) -> None:
        trees = [robot.cover.tree(link) for link in robot.links]
        counts = np.array([len(tree.spheres) for tree in trees], dtype=np.int64)
        joints = np.array([robot.joint_index(link) for link in robot.links], dtype=np.int64)
        spheres = np.concatenate([tree.spheres for tree in trees])
        roots = np.concatenate([[0], np.cumsum(counts)[:-1]])
        child_count = np.concatenate([tree.child_count for tree in trees])
        first_child = np.concatenate([tree.first_child for tree in trees])
        first_child = np.where(child_count > 0, first_child + np.repeat(roots, counts), -1)

        self.link: IntArray = _frozen(np.repeat(np.arange(len(trees)), counts), np.int64)
        self.joint: IntArray = _frozen(np.repeat(joints, counts), np.int64)
        self.local: FloatArray = _frozen(spheres[:, :3], np.float64)
        self.radius: FloatArray = _frozen(spheres[:, 3], np.float64)
        self.first_child: IntArray = _frozen(first_child, np.int64)
        self.child_count: IntArray = _frozen(child_count, np.int64)
        self.root: IntArray = _frozen(roots, np.int64)
        parent, skip = np.full((2, len(spheres)), -1)
        # Parents stand before their children, so every skip is known before it is handed down.
        for node, first in enumerate(first_child):
            children = range(first, first + child_count[node])
            for child in children:
                parent[child] = node
                skip[child] = skip[node] if child == children[-1] else child + 1
        self.tree = SphereTree(
            self.root,
            self.first_child,
            _frozen(parent, np.int64),
            _frozen(skip, np.int64),
            self.radius,
        )

    def __len__(self) -> int:
        """Number of spheres of the whole arm."""
        return len(self.radius)


class Kinematics:
    """Centres and velocities of every sphere of the arm, in the world, for one state at a time.

    Attributes:
        model: Pinocchio's model of the arm, its base placed in the world; `robot.model` stays
            untouched.
        data: The results of the last `compute`; `data.oMi` are placements in the world.
        placement: All of it as arrays for compiled code; the views do not keep `data` alive.
        spheres: The arm's spheres, in the order of the arrays below.
        centers: Sphere centres in the world, in [m]; rewritten in place. Shape (n, 3).
        velocities: Their velocities in the world, in [m]/[s]; rewritten in place. Shape (n, 3).
    """

    def __init__(self, robot: Robot, base_placement: pinocchio.SE3 | None = None) -> None:
        """Prepare views and arrays; both are NaN until the first `compute`.

        Args:
            robot: The arm.
            base_placement: Placement of the robot's base in the world; None: they coincide.

        Raises:
            ArmguardError: The placement is no rigid motion, or this version of Pinocchio lays its
                memory out differently.
        """
        self.model = _place_model(robot.model, base_placement)
        self.data = self.model.createData()
        self.spheres = ArmSpheres(robot)
        count = len(self.spheres)
        self._centers: FloatArray = np.full((count, 3), np.nan)
        self._velocities: FloatArray = np.full((count, 3), np.nan)
        self.centers = _read_only(self._centers)
        self.velocities = _read_only(self._velocities)
        moves = np.zeros((self.model.njoints, self.model.nv), dtype=np.bool_)
        for carried in range(1, self.model.njoints):
            for joint in self.model.supports[carried]:
                if joint > 0:
                    moves[carried, self.model.idx_vs[joint]] = True
        pinocchio.computeJointJacobians(self.model, self.data, pinocchio.neutral(self.model))
        # Its views do not keep `data` alive: what uses it must hold on to this object.
        self.placement = ArmPlacement(
            *_view_data(self.data, self.model.njoints),
            # Pinocchio shows that of a single joint without its second axis. Transposed, it is laid
            # out alike for one joint and for many, and kernels are compiled once for both.
            self.data.J.reshape(6, -1).T,
            moves,
            self.spheres.joint,
            self.spheres.local,
            self._centers,
            self._velocities,
        )

    def compute(self, q: FloatArray, v: FloatArray) -> None:
        """Fill `centers` and `velocities` from one joint state.

        A non-finite joint value is not refused: it makes the spheres behind it NaN, which every
        contact kernel answers with "contact now".

        Args:
            q: Joint positions, in [rad] or [m]. Shape (nv,).
            v: Joint velocities, in [rad]/[s] or [m]/[s]. Shape (nv,).

        Raises:
            ArmguardError: A vector has the wrong length.
        """
        if not (np.shape(q) == (self.model.nq,) and np.shape(v) == (self.model.nv,)):
            raise ArmguardError(
                "joint state",
                f"q has shape {np.shape(q)} and v has shape {np.shape(v)}",
                expected=f"({self.model.nq},) for both",
                remedy="give one value for each watched joint, in the order of robot.joints",
            )
        self.place(q)
        move_spheres(self.placement, v)

    def place(self, q: FloatArray) -> None:
        """Place the joints only; `move_spheres` on `placement` then does the rest.

        Args:
            q: Joint positions, in [rad] or [m]. Shape (nv,), not checked.
        """
        pinocchio.computeJointJacobians(self.model, self.data, q)


def _place_model(model: Any, base_placement: pinocchio.SE3 | None) -> Any:
    """A copy of the model whose base stands at `base_placement` in the world."""
    placed = model.copy()
    if base_placement is None:
        return placed
    rotation, translation = base_placement.rotation, base_placement.translation
    if not (is_rotation(rotation) and np.isfinite(translation).all()):
        raise ArmguardError(
            "base placement",
            f"not a rigid motion: rotation {rotation.tolist()}, translation {translation.tolist()}",
            expected="an orthonormal right-handed rotation and a finite translation",
        )
    for joint in range(1, placed.njoints):
        if placed.parents[joint] == 0:
            placed.jointPlacements[joint] = base_placement * placed.jointPlacements[joint]
    return placed


def _view_data(data: Any, joint_count: int) -> tuple[FloatArray, FloatArray]:
    """Views on the rotations (J, 3, 3) and translations (J, 3) of all joints' placements."""
    placement = data.oMi[0]
    placements = _address(placement.rotation)
    for joint in range(joint_count):
        start = placements + joint * PLACEMENT_STRIDE
        found = data.oMi[joint]
        if not (
            _address(found.rotation) == start
            and found.rotation.strides == (8, 24)
            and _address(found.translation) == start + TRANSLATION_OFFSET
        ):
            raise ArmguardError(
                f"pinocchio {pinocchio.__version__}",
                f"keeps joint {joint}'s placement elsewhere in memory",
                expected=f"placements {PLACEMENT_STRIDE} bytes apart, as in pinocchio 4.1",
                remedy="install a version of pin that armguard's requirements allow",
            )
    strided = np.lib.stride_tricks.as_strided
    return (
        strided(
            placement.rotation, (joint_count, 3, 3), (PLACEMENT_STRIDE, 8, 24), writeable=False
        ),
        strided(placement.translation, (joint_count, 3), (PLACEMENT_STRIDE, 8), writeable=False),
    )


@kernel
def move_spheres(placement: ArmPlacement, v: FloatArray) -> None:
    """Fill centres and velocities of all spheres, after Pinocchio has placed the joints.

    A centre p is carried into the world as R p + t; the joints that move it add up to a linear
    velocity l at the world's origin and an angular one w, and it moves at l + w x p.

    Args:
        placement: Its last two arrays are filled.
        v: Joint velocities, in [rad]/[s] or [m]/[s]. Shape (nv,).
    """
    jacobian, centers, velocities = placement.jacobian, placement.centers, placement.velocities
    carried = -1
    lx = ly = lz = wx = wy = wz = 0.0
    for i in range(placement.joint.shape[0]):
        if placement.joint[i] != carried:
            carried = placement.joint[i]
            lx = ly = lz = wx = wy = wz = 0.0
            for j in range(v.shape[0]):
                if placement.moves[carried, j]:
                    lx += jacobian[j, 0] * v[j]
                    ly += jacobian[j, 1] * v[j]
                    lz += jacobian[j, 2] * v[j]
                    wx += jacobian[j, 3] * v[j]
                    wy += jacobian[j, 4] * v[j]
                    wz += jacobian[j, 5] * v[j]
        px, py, pz = placement.local[i, 0], placement.local[i, 1], placement.local[i, 2]
        rotation, translation = placement.rotation[carried], placement.translation[carried]
        x = rotation[0, 0] * px + rotation[0, 1] * py + rotation[0, 2] * pz + translation[0]
        y = rotation[1, 0] * px + rotation[1, 1] * py + rotation[1, 2] * pz + translation[1]
        z = rotation[2, 0] * px + rotation[2, 1] * py + rotation[2, 2] * pz + translation[2]
        centers[i, 0], centers[i, 1], centers[i, 2] = x, y, z
        velocities[i, 0] = lx + wy * z - wz * y
        velocities[i, 1] = ly + wz * x - wx * z
        velocities[i, 2] = lz + wx * y - wy * x


def _address(array: npt.NDArray[Any]) -> int:
    """Memory address of an array's first element."""
    return int(array.__array_interface__["data"][0])


def _frozen(values: npt.ArrayLike, dtype: type) -> Any:
    """A contiguous copy that cannot be written to."""
    array: npt.NDArray[Any] = np.array(values, dtype=dtype, order="C")
    array.flags.writeable = False
    return array


def _read_only(array: FloatArray) -> FloatArray:
    """A view of the same memory that cannot be written through."""
    view = array.view()
    view.flags.writeable = False
    return view
