"""Surfaces of links, each in the frame of the joint that carries it.

Links behind a locked joint are placed at its position. If a locked joint can be anywhere in its
travel (fingers, a head), its links count as everything that they can reach: the hull of both ends
of a slide, or of polygons around the arcs of a turn.

`UrdfLinks` are the links of a URDF where only their geometry matters. A cover needs no limits, and
a URDF without them is no `Robot` yet. So every joint counts as one that moves there: fingers have
frames of their own, and nothing is locked or swept.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pinocchio

from armguard.cover.patches import ROUND_UP, drop_nothing, place_patches, swell_nothing
from armguard.cover.triangulation import hull_triangles, make_patches, triangulate
from armguard.exceptions import RobotError
from armguard.jit.arrays import FloatArray
from armguard.robot.description import LimitSources, LockedJoint, RobotDescription
from armguard.robot.model_file import read_model
from armguard.robot.urdf import UrdfModel

STEP = math.radians(10.0)  # a polygon with corners so far apart sticks out of its arc by 0.4 %


class LinkSurface(NamedTuple):
    """One link's surface in the frame of the watched joint that carries it; read-only arrays."""

    joint: str
    """Name of that joint."""
    triangles: FloatArray
    """Its surface, or that of a polyhedron that contains it, in [m]. Shape (n, 3, 3)."""
    pieces: FloatArray
    """What a cover is proved from, as `patches` has it, in [m]."""


def collect_surfaces(
    urdf: UrdfModel, watched: Collection[str], description: RobotDescription
) -> dict[str, LinkSurface]:
    """Surfaces of all links that a watched joint moves.

    Args:
        urdf: The whole robot.
        watched: Names of the joints that move; all others are locked.
        description: Says where, or in which travel.

    Returns:
        By link.

    Raises:
        RobotError: A link has geometry without triangles, or flat geometry on a travelling joint.
    """
    parts: dict[str, list[_Part]] = {}
    for part in _carry_parts(urdf, watched, description):
        if part.joint:
            parts.setdefault(part.link, []).append(part)
    surfaces = {}
    for link, found in parts.items():
        triangles = np.concatenate([part.triangles for part in found])
        pieces = np.concatenate([part.pieces for part in found])
        if any(part.is_swept for part in found):
            triangles = hull_triangles(f"link {link!r}", triangles.reshape(-1, 3))
            pieces = swell_nothing(triangles)
        pieces = drop_nothing(pieces)
        triangles.flags.writeable = pieces.flags.writeable = False
        surfaces[link] = LinkSurface(found[-1].joint, triangles, pieces)
    return surfaces


def collect_fixed_points(
    urdf: UrdfModel, watched: Collection[str], description: RobotDescription
) -> dict[str, FloatArray]:
    """Points whose hull contains each link that no watched joint moves, in the base's frame [m].

    Between it and the base, all joints are locked, at a position or in a travel; what is behind a
    travel is taken as all that it can reach.

    Args:
        urdf: The whole robot.
        watched: Names of the joints that move.
        description: Says which others are locked, and where.

    Returns:
        By link, of those with collision geometry. Shapes (n, 3).
    """
    parts: dict[str, list[FloatArray]] = {}
    for part in _carry_parts(urdf, watched, description):
        if not part.joint and part.is_known:
            parts.setdefault(part.link, []).append(part.triangles.reshape(-1, 3))
    points = {link: np.unique(np.concatenate(found), axis=0) for link, found in parts.items()}
    for corners in points.values():
        corners.flags.writeable = False
    return points


class _Part(NamedTuple):
    """One collision geometry of a link, in the frame of what carries it."""

    link: str
    joint: str
    """The watched joint that carries it; empty: the base."""
    triangles: FloatArray
    pieces: FloatArray
    is_swept: bool
    """Whether the triangles are all that it reaches in the travel of a joint."""
    is_known: bool
    """Whether each joint between it and what carries it is locked by name."""


def _carry_parts(
    urdf: UrdfModel, watched: Collection[str], description: RobotDescription
) -> Iterator[_Part]:
    model = urdf.model
    for geometry in urdf.collision_model.geometryObjects:
        link = str(model.frames[geometry.parentFrame].name)
        motion, triangles = geometry.placement, triangulate(f"link {link!r}", geometry.geometry)
        pieces = make_patches(geometry.geometry, triangles)
        number, is_swept, is_known = geometry.parentJoint, False, True
        while True:
            triangles = place(motion, triangles)
            pieces = place_patches(motion.rotation, motion.translation, pieces)
            joint = str(model.names[number]) if number else ""
            if not joint or joint in watched:
                break
            entry = description.locked.get(joint)
            is_known &= entry is not None
            if entry is not None and entry.travel is not None:
                span = entry.travel[1] - entry.travel[0]
                triangles = _sweep(model.joints[number], span, f"link {link!r}", triangles)
                is_swept = True
            motion = _carry(model, number, get_rest_position(entry))
            number = model.parents[number]
        yield _Part(link, joint, triangles, pieces, is_swept, is_known)


def get_rest_position(entry: LockedJoint | None) -> float:
    """Where a locked joint is put in the model, in [rad] or [m]."""
    if entry is None:
        return 0.0
    return entry.travel[0] if entry.travel is not None else float(entry.position or 0.0)


def place(placement: Any, triangles: FloatArray) -> FloatArray:
    """Triangles of one frame in another. Shape (n, 3, 3), in [m]."""
    moved: FloatArray = triangles @ placement.rotation.T + placement.translation
    return moved


def is_rotation(matrix: FloatArray) -> bool:
    """Whether a matrix (3, 3) is orthonormal and right-handed, within rounding."""
    with np.errstate(over="ignore", invalid="ignore"):
        deviation = np.abs(matrix @ matrix.T - np.eye(3)).max()
    return bool(deviation <= 1e-9 and np.linalg.det(matrix) > 0.0)


def _carry(model: Any, number: int, position: float) -> Any:
    """Where the frame of a locked joint stands in that of its parent."""
    joint = model.joints[number]
    data = joint.createData()
    joint.calc(data, np.full(model.nq, position))
    return model.jointPlacements[number] * data.M


def _sweep(joint: Any, span: float, name: str, triangles: FloatArray) -> FloatArray:
    """Triangles whose hull contains all that they reach when a joint moves from 0 to `span`."""
    motion = joint.createData().S
    slide, axis = motion[:3].ravel(), motion[3:].ravel()
    if np.any(slide):
        return np.concatenate([triangles, triangles + span * slide])
    # What is inside stays inside, so only corners of the hull need turn.
    corners = np.unique(hull_triangles(name, triangles.reshape(-1, 3)).reshape(-1, 3), axis=0)
    return hull_triangles(name, _turn(corners, axis / np.linalg.norm(axis), span))


def _turn(points: FloatArray, axis: FloatArray, angle: float) -> FloatArray:
    """Points whose hull contains all that `points` reach by turning from 0 to `angle` [rad]."""
    count = math.ceil(angle / STEP)
    step = angle / count
    along = np.outer(points @ axis, axis)
    across = points - along
    aside = np.cross(axis, across)
    # Tangents at both ends of each piece of arc meet over its middle.
    out = ROUND_UP / math.cos(0.5 * step)
    turned = [
        along + size * (math.cos(turn) * across + math.sin(turn) * aside)
        for size, turn in [
            (ROUND_UP, 0.0),
            *((out, (k + 0.5) * step) for k in range(count)),
            (ROUND_UP, angle),
        ]
    ]
    return np.concatenate(turned)


class UrdfLinks:
    """What `Cover` and the interchange of spheres need to know of a robot.

    Args:
        path: A URDF, or an MJCF.
        package_dirs: Folders in which `package://` mesh names are looked up.

    Attributes:
        name: Its file name.
        model: `pinocchio.Model` of all its joints.
        links: Names of the bodies with collision geometry that a joint moves.
        bare: Names of those that are drawn and moved, but have none, so are not covered.

    Raises:
        RobotError: The URDF or its meshes are unusable, or no joint moves any geometry.
    """

    def __init__(self, path: str | Path, package_dirs: Sequence[str | Path] = ()) -> None:
        urdf = read_model(path, package_dirs)
        self.name = Path(path).stem
        self.model = urdf.model
        nothing = RobotDescription(sources=LimitSources(), joints={})
        joints = [str(name) for name in urdf.model.names][1:]
        self._surfaces = collect_surfaces(urdf, joints, nothing)
        if not self._surfaces:
            raise RobotError(self.name, "no joint moves a link with collision geometry")
        self.links = tuple(sorted(self._surfaces, key=self.joint_index))
        frames = {link: urdf.model.getFrameId(link, pinocchio.FrameType.BODY) for link in urdf.bare}
        self.bare = tuple(link for link in urdf.bare if urdf.model.frames[frames[link]].parentJoint)

    def triangles(self, link: str) -> FloatArray:
        """Surface of a link in the frame of its parent joint, in [m]. Shape (n, 3, 3)."""
        return self._surfaces[link].triangles

    def surface(self, link: str) -> FloatArray:
        """Pieces of a link's surface, as `patches` has them, in its parent joint's frame [m]."""
        return self._surfaces[link].pieces

    def joint_index(self, link: str) -> int:
        """Index in `model.joints` of the joint that moves a link."""
        return int(self.model.getJointId(self._surfaces[link].joint))
