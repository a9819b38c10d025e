"""Links' surfaces, each in the frame of the joint that carries it.

Links behind a locked joint are carried along at its position. Where a locked joint may be anywhere
in its travel (fingers, a head), its links are taken as all that they can reach: the hull of both
ends of a slide, and of polygons drawn around the arcs of a turn.

`UrdfLinks` are the links of a URDF where only their geometry matters. A cover needs no limits, and
a URDF without them is no `Robot` yet. So every joint counts as one that moves there: fingers have
frames of their own, and nothing is locked or swept.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
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
    parts: dict[str, list[FloatArray]] = {}
    patches: dict[str, list[FloatArray]] = {}
    carriers: dict[str, str] = {}
    travelling: set[str] = set()
    for geometry in urdf.collision_model.geometryObjects:
        link = str(urdf.model.frames[geometry.parentFrame].name)
        motion, triangles = geometry.placement, triangulate(f"link {link!r}", geometry.geometry)
        pieces = make_patches(geometry.geometry, triangles)
        pieces = place_patches(motion.rotation, motion.translation, pieces)
        triangles = place(motion, triangles)
        number = geometry.parentJoint
        while number and str(urdf.model.names[number]) not in watched:
            entry = description.locked.get(str(urdf.model.names[number]))
            if entry is not None and entry.travel is not None:
                span = entry.travel[1] - entry.travel[0]
                triangles = _sweep(urdf.model.joints[number], span, f"link {link!r}", triangles)
                travelling.add(link)
            motion = _carry(urdf.model, number, get_rest_position(entry))
            triangles = place(motion, triangles)
            pieces = place_patches(motion.rotation, motion.translation, pieces)
            number = urdf.model.parents[number]
        if number:
            parts.setdefault(link, []).append(triangles)
            patches.setdefault(link, []).append(pieces)
            carriers[link] = str(urdf.model.names[number])
    surfaces = {}
    for link, joint in carriers.items():
        triangles, pieces = np.concatenate(parts[link]), np.concatenate(patches[link])
        if link in travelling:
            triangles = hull_triangles(f"link {link!r}", triangles.reshape(-1, 3))
            pieces = swell_nothing(triangles)
        pieces = drop_nothing(pieces)
        triangles.flags.writeable = pieces.flags.writeable = False
        surfaces[link] = LinkSurface(joint, triangles, pieces)
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
    for geometry in urdf.collision_model.geometryObjects:
        number = geometry.parentJoint
        between = []
        while number:
            between.append(str(urdf.model.names[number]))
            number = urdf.model.parents[number]
        if any(joint in watched or joint not in description.locked for joint in between):
            continue
        link = str(urdf.model.frames[geometry.parentFrame].name)
        triangles = triangulate(f"link {link!r}", geometry.geometry)
        triangles = place(geometry.placement, triangles)
        for joint in between:
            number, entry = urdf.model.getJointId(joint), description.locked[joint]
            if entry.travel is not None:
                span = entry.travel[1] - entry.travel[0]
                triangles = _sweep(urdf.model.joints[number], span, f"link {link!r}", triangles)
            triangles = place(_carry(urdf.model, number, get_rest_position(entry)), triangles)
        parts.setdefault(link, []).append(triangles.reshape(-1, 3))
    points = {link: np.unique(np.concatenate(found), axis=0) for link, found in parts.items()}
    for corners in points.values():
        corners.flags.writeable = False
    return points


def get_rest_position(entry: LockedJoint | None) -> float:
    """Where a locked joint is put in the model, in [rad] or [m]."""
    if entry is None:
        return 0.0
    return entry.travel[0] if entry.travel is not None else float(entry.position or 0.0)


def place(placement: Any, triangles: FloatArray) -> FloatArray:
    """Triangles of one frame in another. Shape (n, 3, 3), in [m]."""
    moved: FloatArray = triangles @ placement.rotation.T + placement.translation
    return moved


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
