"""Distance of a link's true geometry from an obstacle: Coal on convex hulls, with proof.

It shows closest points to observers, and is what tests compare sphere covers with. A link is the
convex hull of its vertices (as loaded, meshes are hollow surfaces: a ball in the middle of one
would be "46 mm away"). Coal finds the pair of closest points to within a tolerance, on either side
of the truth. So only the direction between them is believed: along any unit vector, the gap between
the two bodies is at most their distance, and that gap is computed from all vertices.
"""

from __future__ import annotations

import math
from typing import Any

import coal
import numpy as np
import numpy.typing as npt
import pinocchio

from armguard.bounds.levers import MOST_KEPT
from armguard.exceptions import ArmguardError
from armguard.jit.arrays import FloatArray
from armguard.jit.kept_results import keep_results
from armguard.jit.numerics import HULL_ROUNDING
from armguard.robot.kinematics import Kinematics
from armguard.robot.robot import Robot

THINNEST = 1e-4
"""Hulls flatter than this share of their length are fattened for Coal, which needs a volume."""

Z_AXIS = np.array([0.0, 0.0, 1.0])


class HullDistance:
    """Distances from the true geometry of the arm's links to obstacles.

    Placements are those of the last `Kinematics.compute`.

    Attributes:
        vertices: Of each link, in the frame of its parent joint, in [m]. Shapes (v, 3).
        joints: Pinocchio's index of each link's parent joint.
    """

    def __init__(self, robot: Robot, kinematics: Kinematics) -> None:
        """Build one hull for each link.

        Args:
            robot: Whose links are measured.
            kinematics: Where they are.
        """
        self.vertices = [np.ascontiguousarray(robot.hull(link)) for link in robot.links]
        self._reach = [float(np.abs(vertices).max()) for vertices in self.vertices]
        self._hulls = [_build_hull(vertices) for vertices in self.vertices]
        self.joints = [robot.joint_index(link) for link in robot.links]
        self._data = kinematics.data
        self._request = coal.DistanceRequest()
        self._result = coal.DistanceResult()
        self._sphere = coal.Sphere(0.0)
        self._capsule = coal.Capsule(0.0, 0.0)

    def distance(
        self, link_index: int, points: npt.ArrayLike, radius: float
    ) -> tuple[float, FloatArray, FloatArray]:
        """Distance from a link to the convex hull of some points, rounded by a radius.

        Coal gets a sphere for one point, a capsule for two, and a hull for more. A hull that is
        flat, or has corners that coincide, may be measured less sharply by Coal, and then the
        distance comes out too small: the proof never rests on the shape that Coal was given.

        Args:
            link_index: Index in `robot.links`.
            points: Corners of the obstacle in the world, in [m]. Shape (k, 3), k >= 1.
            radius: In [m], >= 0.

        Returns:
            The distance in [m], never above the true one and at most about 1e-5 below it while
            the bodies are apart; negative where they overlap. Then a closest point on the link
            and one on the obstacle, in the world, in [m], to within Coal's tolerance; both of
            shape (3,). They are for showing.

        Raises:
            ArmguardError: No such link, points of another shape or not finite, a radius that is
                negative or not finite, or no joint state computed yet.
        """
        if not 0 <= link_index < len(self._hulls):
            raise ArmguardError(
                "link index", f"is {link_index}", expected=f"0 to {len(self._hulls) - 1}"
            )
        corners = np.ascontiguousarray(points, dtype=np.float64)
        if not (corners.ndim == 2 and corners.shape[1] == 3 and len(corners) > 0):
            raise ArmguardError("points", f"have shape {corners.shape}", expected="(k, 3), k >= 1")
        placement = self._data.oMi[self.joints[link_index]]
        rotation, translation = placement.rotation, placement.translation
        largest = float(np.abs(corners).max()) + float(np.abs(translation).max())
        if not (0.0 <= radius < np.inf and largest < np.inf):
            raise ArmguardError(
                "obstacle or arm",
                f"is not finite: radius {radius} m, largest coordinate {largest} m",
                expected="finite points, joint values and radius, radius >= 0",
            )
        shape, pose = self._make_shape(corners, float(radius))
        self._result.clear()
        coal.distance(
            self._hulls[link_index],
            coal.Transform3s(rotation, translation),
            shape,
            pose,
            self._request,
            self._result,
        )
        normal = _unit(self._result.normal)
        if normal is None:
            normal = _unit(corners.mean(axis=0) - translation)
        if normal is None:
            normal = Z_AXIS
        vertices = self.vertices[link_index]
        front = float((vertices @ (normal @ rotation)).max()) + float(normal @ translation)
        slack = HULL_ROUNDING * (largest + self._reach[link_index] + radius)
        gap = float((corners @ normal).min()) - front - radius - slack
        return (
            gap,
            np.array(self._result.getNearestPoint1()),
            np.array(self._result.getNearestPoint2()),
        )

    def _make_shape(self, corners: FloatArray, radius: float) -> tuple[Any, Any]:
        """Coal's shape of an obstacle, and its placement."""
        if len(corners) == 1:
            self._sphere.radius = radius
            return self._sphere, coal.Transform3s(np.eye(3), corners[0])
        if len(corners) == 2:
            axis = corners[1] - corners[0]
            direction = _unit(axis)
            turn = pinocchio.Quaternion.Identity()
            if direction is not None:
                turn = pinocchio.Quaternion.FromTwoVectors(Z_AXIS, direction)
            self._capsule.radius = radius
            self._capsule.halfLength = 0.5 * math.hypot(*axis)
            return self._capsule, coal.Transform3s(turn.matrix(), 0.5 * (corners[0] + corners[1]))
        hull = coal.Convex(_vectors(corners), _fan(len(corners)))
        hull.setSweptSphereRadius(radius)
        return hull, coal.Transform3s.Identity()


@keep_results(MOST_KEPT)
def _build_hull(vertices: FloatArray) -> Any:
    """Convex hull of a link's vertices, which Coal only reads."""
    centered = vertices - vertices.mean(axis=0)
    extents = np.ptp(centered @ np.linalg.svd(centered, full_matrices=False)[2].T, axis=0)
    if not (len(extents) == 3 and extents.min() > THINNEST * extents.max()):
        # Qhull crashes on flat input. The proof keeps the true vertices, so fattening is safe.
        tip = max(THINNEST * float(extents.max()), 1e-6)
        tips = tip * np.concatenate([np.eye(3), -np.eye(3)])
        vertices = (vertices[:, None] + tips).reshape(-1, 3)
    return coal.Convex.convexHull(_vectors(vertices), True, "Qt")


def _fan(count: int) -> Any:
    """Triangles that touch every corner; Coal searches the corners of small hulls one by one."""
    triangles = coal.StdVec_Triangle()
    for i in range(count):
        triangles.append(coal.Triangle(i, (i + 1) % count, (i + 2) % count))
    return triangles


def _vectors(points: FloatArray) -> Any:
    vectors = coal.StdVec_Vec3s()
    vectors.extend(list(points))
    return vectors


def _unit(vector: FloatArray) -> FloatArray | None:
    """The vector's direction; None if it has none."""
    largest = float(np.abs(vector).max())
    if not 0.0 < largest < np.inf:
        return None
    scaled = vector / largest
    unit: FloatArray = scaled / np.sqrt(scaled @ scaled)
    return unit
