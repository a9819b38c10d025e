"""Where the arm's spheres are and how fast they move: Pinocchio's results, read in place.

`pinocchio.Data` keeps the placements and the spatial velocities of all joints in two C++ vectors.
Strided NumPy views cover both, so one compiled kernel fills the centres and velocities of every
sphere without a copy, an allocation or a Python loop. The layout behind those views is no promise
of Pinocchio's, so it is checked against the library's own accessors at construction.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pinocchio

from armguard.compilation import kernel
from armguard.exceptions import ArmguardError
from armguard.robot import Robot

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

PLACEMENT_STRIDE = 96
"""Bytes from one joint placement to the next: rotation (column-major), then translation."""
TRANSLATION_OFFSET = 72
VELOCITY_STRIDE = 48
"""Bytes from one spatial velocity to the next: linear, then angular."""
ANGULAR_OFFSET = 24


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

        self.link: Integers = _frozen(np.repeat(np.arange(len(trees)), counts), np.int64)
        self.joint: Integers = _frozen(np.repeat(joints, counts), np.int64)
        self.local: Floats = _frozen(spheres[:, :3], np.float64)
        self.radius: Floats = _frozen(spheres[:, 3], np.float64)
        self.first_child: Integers = _frozen(first_child, np.int64)
        self.child_count: Integers = _frozen(child_count, np.int64)
        self.root: Integers = _frozen(roots, np.int64)

    def __len__(self) -> int:
        """Number of spheres of the whole arm."""
        return len(self.radius)


class Kinematics:
    """Centres and velocities of every sphere of the arm, in the world, for one state at a time.

    Attributes:
        model: Pinocchio's model of the arm, its base placed in the world; `robot.model` stays
            untouched.
        data: The results of the last `compute`; `data.oMi` are placements in the world.
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
        self._centers: Floats = np.full((count, 3), np.nan)
        self._velocities: Floats = np.full((count, 3), np.nan)
        self.centers = _read_only(self._centers)
        self.velocities = _read_only(self._velocities)
        # The views do not keep `data` alive: they must never leave this object.
        self._views = _view_data(self.data, self.model.njoints)

    def compute(self, q: Floats, v: Floats) -> None:
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
        pinocchio.forwardKinematics(self.model, self.data, q, v)
        spheres = self.spheres
        _move_spheres(*self._views, spheres.joint, spheres.local, self._centers, self._velocities)


def _place_model(model: Any, base_placement: pinocchio.SE3 | None) -> Any:
    """A copy of the model whose base stands at `base_placement` in the world."""
    placed = model.copy()
    if base_placement is None:
        return placed
    rotation, translation = base_placement.rotation, base_placement.translation
    error = np.abs(rotation @ rotation.T - np.eye(3)).max()
    if not (error <= 1e-9 and np.linalg.det(rotation) > 0.0 and np.isfinite(translation).all()):
        raise ArmguardError(
            "base placement",
            f"not a rigid motion: rotation {rotation.tolist()}, translation {translation.tolist()}",
            expected="an orthonormal right-handed rotation and a finite translation",
        )
    for joint in range(1, placed.njoints):
        if placed.parents[joint] == 0:
            placed.jointPlacements[joint] = base_placement * placed.jointPlacements[joint]
    return placed


def _view_data(data: Any, joint_count: int) -> tuple[Floats, Floats, Floats, Floats]:
    """Views on all rotations (J, 3, 3), translations, linear and angular velocities (J, 3)."""
    placement, velocity = data.oMi[0], data.v[0]
    placements, velocities = _address(placement.rotation), _address(velocity.linear)
    for joint in range(joint_count):
        start = placements + joint * PLACEMENT_STRIDE
        spatial = velocities + joint * VELOCITY_STRIDE
        found = data.oMi[joint], data.v[joint]
        if not (
            _address(found[0].rotation) == start
            and found[0].rotation.strides == (8, 24)
            and _address(found[0].translation) == start + TRANSLATION_OFFSET
            and _address(found[1].linear) == spatial
            and _address(found[1].angular) == spatial + ANGULAR_OFFSET
        ):
            raise ArmguardError(
                f"pinocchio {pinocchio.__version__}",
                f"keeps joint {joint}'s placement or velocity elsewhere in memory",
                expected=f"placements {PLACEMENT_STRIDE} and velocities {VELOCITY_STRIDE} bytes "
                "apart, as in pinocchio 4.1",
                remedy="install a version of pin that armguard's requirements allow",
            )
    rows = (joint_count, 3)
    strided = np.lib.stride_tricks.as_strided
    return (
        strided(placement.rotation, (*rows, 3), (PLACEMENT_STRIDE, 8, 24), writeable=False),
        strided(placement.translation, rows, (PLACEMENT_STRIDE, 8), writeable=False),
        strided(velocity.linear, rows, (VELOCITY_STRIDE, 8), writeable=False),
        strided(velocity.angular, rows, (VELOCITY_STRIDE, 8), writeable=False),
    )


@kernel
def _move_spheres(
    rotation: Floats,
    translation: Floats,
    linear: Floats,
    angular: Floats,
    joint: Integers,
    local: Floats,
    centers: Floats,
    velocities: Floats,
) -> None:
    """Carry each local centre p into the world: R p + t, and R (v + w x p), v and w being local."""
    for i in range(joint.shape[0]):
        j = joint[i]
        x, y, z = local[i, 0], local[i, 1], local[i, 2]
        wx, wy, wz = angular[j, 0], angular[j, 1], angular[j, 2]
        vx = linear[j, 0] + wy * z - wz * y
        vy = linear[j, 1] + wz * x - wx * z
        vz = linear[j, 2] + wx * y - wy * x
        for row in range(3):
            a, b, c = rotation[j, row, 0], rotation[j, row, 1], rotation[j, row, 2]
            centers[i, row] = a * x + b * y + c * z + translation[j, row]
            velocities[i, row] = a * vx + b * vy + c * vz


def _address(array: npt.NDArray[Any]) -> int:
    """Memory address of an array's first element."""
    return int(array.__array_interface__["data"][0])


def _frozen(values: npt.ArrayLike, dtype: type) -> Any:
    """A contiguous copy that nobody can write to."""
    array: npt.NDArray[Any] = np.array(values, dtype=dtype, order="C")
    array.flags.writeable = False
    return array


def _read_only(array: Floats) -> Floats:
    """A view of the same memory that cannot be written through."""
    view = array.view()
    view.flags.writeable = False
    return view
