"""`Robot`: the arm that is watched, as Pinocchio's model, limits with sources, links and cover.

Pink and mink take the model as it was loaded; here it is reduced to the watched joints, one
number each, so that nq = nv and public arrays have one value a joint. Whatever is not watched is
locked, by name, and fingers that may be anywhere in their travel are taken as all they can reach.
A robot that lacks a limit, a mesh or a link's geometry is refused: nothing vanishes quietly.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio
from numpy.typing import NDArray

from armguard.cover import Cover
from armguard.exceptions import CoverError, RobotError
from armguard.robot_description import (
    LIMITS,
    LockedJoint,
    RobotDescription,
    find_example_urdf,
    find_robot,
    read_description,
)
from armguard.surfaces import hull_triangles, triangulate
from armguard.urdf import UrdfModel, read_urdf

Array = NDArray[np.float64]


class Robot:
    """An arm and what is known about it; made by `Robot.load` or `Robot.from_urdf`.

    All limits are read-only arrays of shape (nv,), in the order of `joints`.

    Attributes:
        name: Its name in `robots/`, or the file name of its URDF.
        model: `pinocchio.Model` reduced to the watched joints: nq = nv.
        collision_model: `pinocchio.GeometryModel` of it, geometry as read.
        joints: Names of the watched joints, in model order.
        cover: A tree of spheres for each link, proved to contain it.
        links: Names of the URDF bodies with collision geometry that a watched joint moves.
        velocity_limit: In [rad]/[s] or [m]/[s].
        acceleration_limit: Holds in every mode, emergency brakes included, in [rad]/[s²] or
            [m]/[s²].
        braking_deceleration: Guaranteed under load, in [rad]/[s²] or [m]/[s²].
        lower_position_limit: In [rad] or [m]; -inf for a continuous joint.
        upper_position_limit: In [rad] or [m]; inf for a continuous joint.
        position_error: What a measured position may be off by, in [rad] or [m].
        velocity_error: What a measured velocity may be off by, in [rad]/[s] or [m]/[s].
    """

    cover: Cover

    def __init__(
        self, name: str, urdf: UrdfModel, description: RobotDescription, joints: Sequence[str]
    ) -> None:
        self.name = name
        locked = _check_joints(urdf, description, joints)
        self.model, self.collision_model = _reduce(urdf, description, locked)
        self.joints = tuple(str(joint) for joint in self.model.names)[1:]
        entries = [description.joints[joint] for joint in self.joints]
        positions = [entry.position or (-np.inf, np.inf) for entry in entries]
        self.lower_position_limit = _read_only(lower for lower, _ in positions)
        self.upper_position_limit = _read_only(upper for _, upper in positions)
        self.velocity_limit = _read_only(entry.velocity for entry in entries)
        self.acceleration_limit = _read_only(entry.acceleration for entry in entries)
        self.braking_deceleration = _read_only(entry.braking for entry in entries)
        self.position_error = _read_only(entry.position_error for entry in entries)
        self.velocity_error = _read_only(entry.velocity_error for entry in entries)
        self.model.lowerPositionLimit = self.lower_position_limit
        self.model.upperPositionLimit = self.upper_position_limit
        self.model.velocityLimit = self.velocity_limit
        self._sources = {
            joint: {limit: description.source(joint, limit) for limit in LIMITS}
            for joint in self.joints
        }
        self._triangles, self._joint_index = _moving_links(urdf, self, description)
        self.links = tuple(self._triangles)

    @classmethod
    def load(cls, name: str) -> Robot:
        """Load a robot that armguard knows, with the cover that was proved for it.

        Raises:
            RobotError: There is no such robot, or its files are unusable.
            CoverError: Its cover is damaged, or was made for other geometry.
        """
        directory = find_robot(name)
        description = read_description(directory / "robot.toml")
        path, packages = find_example_urdf(description.urdf)
        urdf = read_urdf(path, [packages])
        robot = cls(name, urdf, description, list(description.joints))
        robot.cover = Cover.load(directory / "cover.json")
        robot.cover.verify(robot)
        return robot

    @classmethod
    def from_urdf(
        cls,
        path: str | Path,
        *,
        limits: str | Path | Mapping[str, Any],
        joints: Sequence[str] | None = None,
        package_dirs: Sequence[str | Path] = (),
        cover: str | Path | None = None,
    ) -> Robot:
        """Load anybody's robot.

        Args:
            path: Its URDF.
            limits: A robot.toml, or a mapping of the same form.
            joints: The joints to watch; None: all that `limits` names.
            package_dirs: Folders in which `package://` mesh names are looked up.
            cover: A file that `Cover.save` wrote, which is proved again; None: one is fitted,
                which takes seconds a link.

        Raises:
            RobotError: A joint, a limit or a mesh is missing or unusable; the message names it.
            CoverError: The cover is for other geometry, or does not cover it.
        """
        description = read_description(limits)
        urdf = read_urdf(path, package_dirs)
        watched = list(description.joints) if joints is None else list(joints)
        robot = cls(Path(path).stem, urdf, description, watched)
        if cover is None:
            robot.cover = Cover.fit(robot)
            return robot
        robot.cover = Cover.load(cover)
        robot.cover.verify(robot)
        for link, report in robot.cover.check(robot).links.items():
            if not report.proved:
                raise CoverError(f"link {link!r}", f"is not inside its spheres in {cover}")
        return robot

    def source(self, joint: str, limit: str) -> str:
        """Where a limit comes from: `position`, `velocity`, `acceleration` or `braking`."""
        return self._sources[joint][limit]

    def triangles(self, link: str) -> Array:
        """The surface of a link, or of a polyhedron that contains it.

        Args:
            link: One of `links`.

        Returns:
            Triangles in the frame of the link's parent joint, in [m]. Shape (n, 3, 3).

        Raises:
            RobotError: No watched joint moves such a link, or it has no collision geometry.
        """
        self._check_link(link)
        return self._triangles[link]

    def joint_index(self, link: str) -> int:
        """Index in `model.joints` of the joint that moves a link."""
        self._check_link(link)
        return self._joint_index[link]

    def hull(self, link: str) -> Array:
        """Points whose convex hull contains a link.

        Returns:
            Vertices of its surface in the frame of its parent joint, in [m]. Shape (n, 3).
        """
        return np.unique(self.triangles(link).reshape(-1, 3), axis=0)

    def _check_link(self, link: str) -> None:
        if link in self._triangles:
            return
        if any(frame.name == link for frame in self.model.frames):
            problem = "has no collision geometry that a watched joint moves"
        else:
            problem = f"is not a link of {self.name}"
        raise RobotError(f"link {link!r}", problem, expected=f"one of {', '.join(self.links)}")


def _read_only(values: Iterable[float]) -> Array:
    array = np.array(list(values), dtype=np.float64)
    array.flags.writeable = False
    return array


def _check_joints(
    urdf: UrdfModel, description: RobotDescription, watched: Sequence[str]
) -> list[str]:
    """Refuse joints that are unknown, unlimited or coupled; return the others, to be locked."""
    model, names = urdf.model, list(urdf.model.names)[1:]
    for joint in [*watched, *description.locked]:
        if joint not in names:
            raise RobotError(
                f"joint {joint!r}", "is not in the URDF", expected=f"one of {', '.join(names)}"
            )
    if not watched:
        raise RobotError(model.name, "no joint is to be watched")
    for joint in watched:
        if joint not in description.joints:
            raise RobotError(f"joint {joint!r}", "has no limits", remedy="give them in [joints]")
        continuous = joint in urdf.continuous
        if continuous != (description.joints[joint].position is None):
            raise RobotError(
                f"joint {joint!r}",
                "is continuous and has no range" if continuous else "has no position limit",
                expected="no position" if continuous else "position = [lower, upper]",
            )
    for joint, leader in urdf.mimics.items():
        if joint in watched or leader in watched:
            raise RobotError(
                f"joint {joint!r}",
                f"mimics joint {leader!r}",
                expected="joints that move independently",
                remedy="lock both, or remove the mimic element",
            )
    watched_ids = {model.getJointId(joint) for joint in watched}
    carriers = {ancestor for joint in watched_ids for ancestor in model.supports[joint]}
    for joint in names:
        if joint in watched or joint in description.locked:
            continue
        number = model.getJointId(joint)
        if number in carriers or watched_ids & set(model.supports[number]):
            raise RobotError(
                f"joint {joint!r}",
                "is not watched, but carries or is carried by a watched joint",
                remedy="watch it, or give its position or travel in [locked]",
            )
    for joint, entry in description.locked.items():
        number = model.getJointId(joint)
        prismatic = np.any(model.joints[number].createData().S[:3])
        if entry.travel is not None and (number in carriers or not prismatic):
            raise RobotError(
                f"joint {joint!r}",
                "cannot be anywhere in its travel",
                expected="a prismatic joint that carries no watched one",
                remedy="lock it at a position",
            )
    return [joint for joint in names if joint not in watched]


def _rest_position(entry: LockedJoint | None) -> float:
    if entry is None:
        return 0.0
    return entry.travel[0] if entry.travel is not None else float(entry.position or 0.0)


def _reduce(
    urdf: UrdfModel, description: RobotDescription, locked: Sequence[str]
) -> tuple[Any, Any]:
    """Lock joints; a travelling one at the start of its travel."""
    configuration = pinocchio.neutral(urdf.model)
    numbers = [urdf.model.getJointId(joint) for joint in locked]
    for joint, number in zip(locked, numbers, strict=True):
        index = urdf.model.joints[number].idx_q
        configuration[index] = _rest_position(description.locked.get(joint))
    model, collision_model = pinocchio.buildReducedModel(
        urdf.model, urdf.collision_model, numbers, configuration
    )
    return model, collision_model


def _moving_links(
    urdf: UrdfModel, robot: Robot, description: RobotDescription
) -> tuple[dict[str, Array], dict[str, int]]:
    """Triangles and parent joint of every link that a watched joint moves.

    Of a link that travels, they are those of the hull of both ends: all that it can reach.
    """
    travelling: set[str] = set()
    pieces: dict[str, list[Array]] = {}
    joint_index: dict[str, int] = {}
    for geometry in urdf.collision_model.geometryObjects:
        link = str(urdf.model.frames[geometry.parentFrame].name)
        triangles = _place(geometry.placement, triangulate(f"link {link!r}", geometry.geometry))
        number = geometry.parentJoint
        while number and str(urdf.model.names[number]) not in robot.joints:
            name = str(urdf.model.names[number])
            entry = description.locked.get(name)
            joint = urdf.model.joints[number]
            data = joint.createData()
            joint.calc(data, np.full(urdf.model.nq, _rest_position(entry)))
            if entry is not None and entry.travel is not None:
                end = data.S[:3].ravel() * (entry.travel[1] - entry.travel[0])
                triangles = np.concatenate([triangles, triangles + end])
                travelling.add(link)
            triangles = _place(urdf.model.jointPlacements[number] * data.M, triangles)
            number = urdf.model.parents[number]
        if number:
            pieces.setdefault(link, []).append(triangles)
            joint_index[link] = robot.model.getJointId(str(urdf.model.names[number]))
    if not pieces:
        raise RobotError(robot.name, "no watched joint moves a link with collision geometry")
    in_model_order = sorted(pieces, key=lambda link: joint_index[link])
    surfaces = {link: np.concatenate(pieces[link]) for link in in_model_order}
    for link in travelling & set(surfaces):
        surfaces[link] = hull_triangles(f"link {link!r}", surfaces[link].reshape(-1, 3))
    for surface in surfaces.values():
        surface.flags.writeable = False
    return surfaces, joint_index


def _place(placement: Any, triangles: Array) -> Array:
    moved: Array = triangles @ placement.rotation.T + placement.translation
    return moved
