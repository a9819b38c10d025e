"""`UrdfLinks`: the links of a URDF where only their geometry matters.

A cover needs no limits, and a URDF without them is no `Robot` yet. So every joint counts as one
that moves here: fingers have frames of their own, and nothing is locked or swept.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pinocchio
from numpy.typing import NDArray

from armguard.exceptions import RobotError
from armguard.link_surfaces import collect_surfaces
from armguard.robot_description import LimitSources, RobotDescription
from armguard.urdf import read_urdf

Array = NDArray[np.float64]


class UrdfLinks:
    """What `Cover` and the interchange of spheres need to know of a robot.

    Args:
        path: A URDF.
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
        urdf = read_urdf(path, package_dirs)
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

    def triangles(self, link: str) -> Array:
        """Surface of a link in the frame of its parent joint, in [m]. Shape (n, 3, 3)."""
        return self._surfaces[link].triangles

    def surface(self, link: str) -> Array:
        """Pieces of a link's surface, as `patches` has them, in its parent joint's frame [m]."""
        return self._surfaces[link].pieces

    def joint_index(self, link: str) -> int:
        """Index in `model.joints` of the joint that moves a link."""
        return int(self.model.getJointId(self._surfaces[link].joint))
