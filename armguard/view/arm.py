"""The drawn arm: its visual meshes, and the pose of each part.

The process of the view opens the meshes; the monitor never needs them. Collada files are sent to
the browser unchanged, which reads their materials. All other geometry is sent as the triangles that
Pinocchio read. If visual meshes cannot be read, the collision geometry replaces them, and a note
says so.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio
from numpy.typing import NDArray

from armguard.exceptions import ArmguardError
from armguard.robot import triangulate
from armguard.robot.description import DESCRIPTION, find_robot, locate_urdf, read_description
from armguard.robot.joints import lock_joints
from armguard.robot.model_file import is_mjcf, read_model
from armguard.view.drawing import Command, draw_collada, draw_triangles
from armguard.view.messages import LinkCover, SceneMessage

PLAIN_COLOUR = (0.82, 0.84, 0.87)


class Arm:
    """The arm of one scene.

    Args:
        scene: The robot, its placement and its cover.

    Attributes:
        notes: Messages about what could not be drawn correctly.
        links: Number of each cover sphere's link, in the order of the scene's cover. Shape (n,).

    Raises:
        ArmguardError: The robot is unknown, or its URDF has no such joints.
    """

    def __init__(self, scene: SceneMessage) -> None:
        self.notes: list[str] = []
        path, package_dirs, rest = _locate(scene)
        urdf = read_model(path, package_dirs)
        names = list(urdf.model.names)[1:]
        covers = [*scene.cover, *(cover for level in scene.levels for cover in level)]
        for joint in (*scene.joints, *(cover.joint for cover in covers)):
            if joint not in names:
                raise ArmguardError(f"joint {joint!r}", f"is not in {path}")
        drawn = None if is_mjcf(path) else self._read_visual_model(urdf.model, path, package_dirs)
        geometry = drawn or urdf.collision_model
        configuration = pinocchio.neutral(urdf.model)
        locked = [name for name in names if name not in scene.joints]
        for name in locked:
            index = urdf.model.joints[urdf.model.getJointId(name)].idx_q
            configuration[index] = rest.get(name, 0.0)
        self._model, self._geometry = lock_joints(urdf.model, geometry, locked, configuration)
        self._data = self._model.createData()
        self._geometry_data = pinocchio.GeometryData(self._geometry)
        self._base = np.array(scene.base, dtype=np.float64).reshape(4, 4)
        self._order = [scene.joints.index(name) for name in list(self._model.names)[1:]]
        self._cover = self._gather(scene.cover)
        self._levels = [self._gather(level) for level in scene.levels]
        self.links = np.repeat(
            np.arange(len(scene.cover)), [len(cover.spheres) for cover in scene.cover]
        )

    def place(self, q: tuple[float, ...]) -> None:
        """Move the arm to joint positions `q`, in the order of the scene's joints.

        Raises:
            ArmguardError: `q` has another length.
        """
        if len(q) != len(self._order):
            raise ArmguardError("q", f"has {len(q)} values", expected=f"{len(self._order)}")
        configuration = np.array(q, dtype=np.float64)[self._order]
        pinocchio.forwardKinematics(self._model, self._data, configuration)
        pinocchio.updateGeometryPlacements(
            self._model, self._data, self._geometry, self._geometry_data
        )

    def compute_cover(self) -> NDArray[np.float64]:
        """Cover spheres in the world, in [m], as last placed: centre, radius. Shape (n, 4)."""
        return self._place(*self._cover)

    def compute_levels(self) -> list[NDArray[np.float64]]:
        """Spheres of each level of the cover's tree in the world, in [m]. Shape (n, 4) each."""
        return [self._place(*level) for level in self._levels]

    def compute_poses(self) -> list[tuple[str, NDArray[np.float64]]]:
        """Path and pose in the world of each mesh, as last placed, its scale included."""
        poses = []
        for geometry, pose in zip(
            self._geometry.geometryObjects, self._geometry_data.oMg, strict=True
        ):
            scale = geometry.meshScale if _is_collada(geometry.meshPath) else np.ones(3)
            poses.append(
                (
                    f"/armguard/arm/{geometry.name}",
                    self._base @ pose.homogeneous @ np.diag([*np.ravel(scale), 1.0]),
                )
            )
        return poses

    def draw(self) -> list[Command]:
        """One command for each mesh; sent once."""
        commands = []
        for geometry in self._geometry.geometryObjects:
            path = f"/armguard/arm/{geometry.name}"
            if _is_collada(geometry.meshPath):
                text = Path(geometry.meshPath).read_text(encoding="utf-8", errors="replace")
                commands.append(draw_collada(path, text))
                continue
            try:
                triangles = triangulate(geometry.name, geometry.geometry)
            except ArmguardError as error:
                self.notes.append(f"not drawn: {error}")
                continue
            commands.append(draw_triangles(path, triangles, PLAIN_COLOUR))
        return commands

    def _gather(self, covers: Sequence[LinkCover]) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
        """All spheres of these links in one array, and the joint of each."""
        spheres = [cover.spheres for cover in covers]
        joints = np.repeat(
            [self._model.getJointId(cover.joint) for cover in covers],
            [len(some) for some in spheres],
        )
        return np.concatenate([np.zeros((0, 4), np.float32), *spheres]), joints.astype(np.int64)

    def _place(
        self, spheres: NDArray[np.float32], joints: NDArray[np.int64]
    ) -> NDArray[np.float64]:
        poses = np.stack([self._base @ pose.homogeneous for pose in self._data.oMi])
        placed = spheres.astype(np.float64)
        placed[:, :3] = np.einsum("nij,nj->ni", poses[joints, :3, :3], placed[:, :3])
        placed[:, :3] += poses[joints, :3, 3]
        return placed

    def _read_visual_model(self, model: Any, path: Path, package_dirs: list[str]) -> Any:
        try:
            root = ElementTree.fromstring(path.read_bytes())
            for mesh in root.iterfind("link/visual/geometry/mesh"):
                name = mesh.get("filename", "")
                if "://" not in name:
                    mesh.set("filename", str(path.resolve().parent / name))
            visual_model = pinocchio.buildGeomFromUrdfString(
                model,
                ElementTree.tostring(root, encoding="unicode"),
                pinocchio.GeometryType.VISUAL,
                package_dirs=package_dirs,
            )
        except (OSError, ValueError, RuntimeError):
            visual_model = None
        if visual_model is None or not visual_model.ngeoms:
            self.notes.append("visual meshes cannot be read: collision geometry is drawn instead")
            return None
        return visual_model


def _locate(scene: SceneMessage) -> tuple[Path, list[str], dict[str, float]]:
    """URDF, package folders, and positions of the locked joints."""
    if scene.urdf:
        return Path(scene.urdf), list(scene.package_dirs), {}
    directory = find_robot(scene.robot)
    description = read_description(directory / DESCRIPTION)
    path, packages = locate_urdf(directory, description)
    rest = {}
    for name, entry in description.locked.items():
        # Fingers that may be anywhere are drawn half open.
        rest[name] = sum(entry.travel) / 2 if entry.travel else float(entry.position or 0.0)
    return path, [str(folder) for folder in packages], rest


def _is_collada(path: str) -> bool:
    """Whether the browser reads the file in the same way as Pinocchio.

    Meshcat's loader ignores units and the up axis, so these must be metres and z.
    """
    if not path.lower().endswith(".dae"):
        return False
    with Path(path).open(encoding="utf-8", errors="replace") as file:
        head = file.read(100_000)
    meter = re.search(r"<unit[^>]*\bmeter=\"([^\"]*)\"", head)
    up_axis = re.search(r"<up_axis>\s*(\w+)", head)
    return bool(
        (meter is None or float(meter[1]) == 1.0) and up_axis is not None and up_axis[1] == "Z_UP"
    )
