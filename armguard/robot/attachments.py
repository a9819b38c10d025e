"""Tools and held parts: geometry that a user fixes to a link, as triangles in its joint's frame.

They come from programs and cell files instead of a checked URDF. So this module checks kind, sizes,
placement, and that sizes are plausible in metres.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import coal
import numpy as np
import pinocchio
from numpy.typing import ArrayLike

from armguard.cover.cover import Cover
from armguard.cover.patches import drop_nothing, place_patches, swell_nothing
from armguard.cover.triangulation import make_patches, triangulate
from armguard.exceptions import RobotError
from armguard.jit.arrays import FloatArray
from armguard.robot.links import is_rotation, place

FARTHEST = 10.0  # [m] from the joint: beyond it, millimetres are the likelier reading


class AttachedBody:
    """One attached body, as something with links and surfaces that a cover can be fitted to.

    Args:
        name: Name of the body.
        geometry: A Coal shape or mesh, or triangles in [m] of shape (n, 3, 3).
        placement: In the frame of the joint that moves it: `pinocchio.SE3` or a homogeneous matrix
            of shape (4, 4); None: the frame itself.

    Raises:
        RobotError: Any of them is unusable.
    """

    def __init__(
        self, name: str, geometry: Any, placement: pinocchio.SE3 | ArrayLike | None
    ) -> None:
        if not (isinstance(name, str) and name.strip()):
            raise RobotError(f"attached body {name!r}", "has no name", expected="a string")
        offender = f"attached body {name!r}"
        self.links = (name,)
        motion = _read_placement(offender, placement)
        triangles, pieces = _read_geometry(offender, geometry)
        with np.errstate(over="ignore", invalid="ignore"):  # what overflows is refused below
            triangles = place(motion, triangles)
            pieces = drop_nothing(place_patches(motion.rotation, motion.translation, pieces))
        farthest = float(np.abs(triangles).max())
        if not farthest <= FARTHEST:
            raise RobotError(
                offender,
                f"reaches {farthest:.4g} m from its joint",
                expected=f"at most {FARTHEST:g} m",
                remedy="give sizes in metres",
            )
        triangles.flags.writeable = pieces.flags.writeable = False
        self._triangles, self._pieces = triangles, pieces

    def triangles(self, link: str) -> FloatArray:
        """Its surface, or a polyhedron that contains it, in its joint's frame [m]. (n, 3, 3)."""
        assert link in self.links
        return self._triangles

    def surface(self, link: str) -> FloatArray:
        """Pieces of its surface, as `patches` has them, in the frame of its joint, in [m]."""
        assert link in self.links
        return self._pieces


class PreparedBody(NamedTuple):
    """A body that can be attached at once: its cover is fitted and proved."""

    link: str
    """The link that it is fixed to, whose joint moves it."""
    body: AttachedBody
    cover: Cover
    """Of this body alone."""

    @property
    def name(self) -> str:
        """What the new link is to be called."""
        return self.body.links[0]


def _read_geometry(offender: str, geometry: Any) -> tuple[FloatArray, FloatArray]:
    """Triangles and patches."""
    if isinstance(geometry, coal.CollisionGeometry):
        triangles = triangulate(offender, geometry)
        return triangles, make_patches(geometry, triangles)
    try:
        triangles = np.array(geometry, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise RobotError(
            offender,
            f"has geometry of type {type(geometry).__name__}",
            expected="a Coal shape, or triangles of shape (n, 3, 3) in metres",
        ) from error
    if not (triangles.ndim == 3 and triangles.shape[1:] == (3, 3) and len(triangles)):
        raise RobotError(
            offender, f"has triangles of shape {triangles.shape}", expected="(n, 3, 3), n > 0"
        )
    if not np.isfinite(triangles).all():
        raise RobotError(offender, "has a vertex that is not finite")
    return triangles, swell_nothing(triangles)


def _read_placement(offender: str, placement: pinocchio.SE3 | ArrayLike | None) -> pinocchio.SE3:
    if placement is None:
        return pinocchio.SE3.Identity()
    try:
        matrix = np.array(
            placement.homogeneous if isinstance(placement, pinocchio.SE3) else placement,
            dtype=np.float64,
        )
    except (TypeError, ValueError) as error:
        raise RobotError(
            offender, f"has placement {placement!r}", expected="an SE3 or a matrix of shape (4, 4)"
        ) from error
    if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
        raise RobotError(
            offender, f"has placement {matrix.tolist()}", expected="finite, of shape (4, 4)"
        )
    if not (is_rotation(matrix[:3, :3]) and (matrix[3] == [0.0, 0.0, 0.0, 1.0]).all()):
        raise RobotError(
            offender,
            f"has placement {matrix.tolist()}",
            expected="a rigid motion: orthonormal, right-handed, last row 0 0 0 1",
        )
    return pinocchio.SE3(matrix[:3, :3], matrix[:3, 3])
