"""Converts collision geometry of Coal to arrays of its surface.

Covers are fitted to pieces of surface and proved from them: boxes, meshes, spheres and capsules are
given exactly, a cylinder as a prism that contains it. Exact hulls need points, and drawings need
triangles: for these, round shapes are polyhedra that contain them. Geometry that cannot be
converted is refused by name: geometry never vanishes.
"""

from __future__ import annotations

from typing import Any

import coal
import numpy as np

from armguard.cover.patches import ROUND_UP, swell_nothing
from armguard.exceptions import RobotError
from armguard.jit.arrays import FloatArray

SIDES = 32  # of the prism around a cylinder: 0.5 % wider than the cylinder at its edges
EQUATOR = 32  # corners that the triangles on a unit sphere have on it
FLAT = 1e-6  # of the largest extent: thinner has no hull

_BOX_CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
_BOX_TRIANGLES = np.array(
    [
        *([0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]),
        *([2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),
    ]
)


def triangulate(name: str, geometry: Any) -> FloatArray:
    """The surface of one collision geometry, or of a polyhedron that contains it.

    Args:
        name: What to call the geometry in an error.
        geometry: Coal's shape or mesh; a mesh's scale is already in its vertices.

    Returns:
        Triangles in the geometry's own frame, in [m]. Shape (n, 3, 3), n > 0.

    Raises:
        RobotError: The geometry is empty, not finite, or of a kind that has no triangles.
    """
    for key in ("radius", "halfLength", "halfSide"):
        size = np.asarray(getattr(geometry, key, 1.0))
        if not ((size > 0.0) & (size < np.inf)).all():
            raise RobotError(name, f"has {key} = {size}", expected="positive and finite")
    if isinstance(geometry, coal.ShapeBase) and geometry.getSweptSphereRadius() != 0.0:
        raise RobotError(name, "has a swept sphere radius", remedy="put it into the shape's sizes")
    if isinstance(geometry, coal.BVHModelBase):
        triangles = _mesh_triangles(geometry)
    elif isinstance(geometry, coal.Box):
        triangles = (_BOX_CORNERS * np.asarray(geometry.halfSide))[_BOX_TRIANGLES]
    elif isinstance(geometry, coal.Sphere):
        triangles = _ball_triangles(geometry.radius)
    elif isinstance(geometry, coal.Cylinder):
        triangles = _prism_triangles(geometry.radius, geometry.halfLength)
    elif isinstance(geometry, coal.Capsule):
        ball = _ball_triangles(geometry.radius)
        end = np.array([0.0, 0.0, geometry.halfLength])
        triangles = hull_triangles(name, np.concatenate([ball - end, ball + end]).reshape(-1, 3))
    elif isinstance(geometry, coal.ConvexBase):
        triangles = hull_triangles(name, np.array(geometry.points(), dtype=np.float64))
    else:
        raise RobotError(
            name,
            f"has collision geometry of kind {type(geometry).__name__}",
            expected="a mesh, box, sphere, cylinder, capsule or convex hull",
            remedy="replace it in the URDF",
        )
    if not len(triangles):
        raise RobotError(name, "has no triangles", remedy="check its mesh file")
    if not np.isfinite(triangles).all():
        raise RobotError(name, "has a vertex that is not finite", remedy="check its mesh file")
    return np.ascontiguousarray(triangles, dtype=np.float64)


def make_patches(geometry: Any, triangles: FloatArray) -> FloatArray:
    """The surface of one collision geometry, spheres and capsules as what they are.

    Args:
        geometry: As for `triangulate`.
        triangles: What that made of it, for all other kinds.

    Returns:
        Patches in the geometry's own frame, in [m]. Shape (n, 3, 6), n > 0.
    """
    if isinstance(geometry, coal.Sphere):
        swelling = geometry.radius * _unit_triangles()
        return np.concatenate([np.zeros_like(swelling), swelling], axis=2)
    if isinstance(geometry, coal.Capsule):
        return _capsule_patches(geometry.radius, geometry.halfLength)
    return swell_nothing(triangles)


def hull_triangles(name: str, points: FloatArray) -> FloatArray:
    """The surface of the convex hull of points, wound outwards.

    Args:
        name: What to call them in an error.
        points: In [m], finite. Shape (n, 3).

    Returns:
        Triangles in [m]. Shape (m, 3, 3).

    Raises:
        RobotError: The points lie in one plane.
    """
    points = np.unique(points, axis=0)
    # Qhull's own error would end the process, so flatness is found beforehand.
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if not (len(points) > 3 and spread[2] > FLAT * spread[0]):
        raise RobotError(
            name, "has no convex hull: its points lie in one plane", remedy="give it a thickness"
        )
    vertices = coal.StdVec_Vec3s()
    vertices.extend(list(points))
    hull = coal.Convex.convexHull(vertices, True, "Qt")
    corners = [hull.polygons(i) for i in range(hull.num_polygons)]
    indices = np.array([[corner[0], corner[1], corner[2]] for corner in corners])
    triangles: FloatArray = np.array(hull.points())[indices]
    sides = triangles[:, 1:] - triangles[:, :1]
    outwards = triangles[:, 0] - points.mean(axis=0)
    is_inverted = np.einsum("ij,ij->i", np.cross(sides[:, 0], sides[:, 1]), outwards) < 0.0
    triangles[is_inverted] = triangles[is_inverted, ::-1]
    return triangles


def _mesh_triangles(mesh: Any) -> FloatArray:
    faces = [mesh.tri_indices(i) for i in range(mesh.num_tris)]
    indices = np.array([[face[0], face[1], face[2]] for face in faces], dtype=np.int64)
    vertices: FloatArray = np.array(mesh.vertices(), dtype=np.float64)
    return vertices[indices.reshape(-1, 3)]


def _prism_triangles(radius: float, half_length: float) -> FloatArray:
    angle = 2.0 * np.pi * np.arange(SIDES) / SIDES
    corner = radius / np.cos(np.pi / SIDES) * ROUND_UP
    ring = np.stack([corner * np.cos(angle), corner * np.sin(angle), np.zeros(SIDES)], axis=1)
    top = np.array([0.0, 0.0, half_length])
    lower, upper = ring - top, ring + top
    after = np.roll(np.arange(SIDES), -1)
    center = np.zeros((SIDES, 3))
    return np.concatenate(
        [
            np.stack([lower, lower[after], upper[after]], axis=1),
            np.stack([lower, upper[after], upper], axis=1),
            np.stack([center - top, lower[after], lower], axis=1),
            np.stack([center + top, upper, upper[after]], axis=1),
        ]
    )


def _capsule_patches(radius: float, half_length: float) -> FloatArray:
    """Half a ball at either end, and the side between neighbouring directions on the equator."""
    ball = radius * _unit_triangles()
    top = np.array([0.0, 0.0, half_length])
    ends = np.where((ball[:, :, 2].mean(axis=1) > 0.0)[:, None, None], top, -top)
    ends = np.broadcast_to(ends, ball.shape)
    angle = 2.0 * np.pi * np.arange(EQUATOR) / EQUATOR
    ring = radius * np.stack([np.cos(angle), np.sin(angle), np.zeros(EQUATOR)], axis=1)
    after = np.roll(ring, -1, axis=0)
    low, high = np.broadcast_to(-top, ring.shape), np.broadcast_to(top, ring.shape)
    core = [(low, high, high), (low, low, high)]
    swelling = [(ring, after, ring), (ring, after, after)]
    return np.concatenate(
        [
            np.concatenate([ends, ball], axis=2),
            *(
                np.concatenate([np.stack(inner, axis=1), np.stack(outer, axis=1)], axis=2)
                for inner, outer in zip(core, swelling, strict=True)
            ),
        ]
    )


def _unit_triangles(subdivisions: int = 3) -> FloatArray:
    """An octahedron, subdivided on the unit sphere; wound outwards."""
    x, y, z = np.eye(3)
    triangles = np.array(
        [[i * x, j * y, i * j * k * z] for i in (1, -1) for j in (1, -1) for k in (1, -1)]
    )
    triangles[1::2] = triangles[1::2, ::-1]
    for _ in range(subdivisions):
        a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
        ab, bc, ca = a + b, b + c, c + a
        corners = ([a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca])
        triangles = np.concatenate([np.stack(corner, axis=1) for corner in corners])
        triangles /= np.linalg.norm(triangles, axis=2, keepdims=True)
    return triangles


def _ball_triangles(radius: float) -> FloatArray:
    """Triangles on the unit sphere, grown until they clear the ball."""
    triangles = _unit_triangles()
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    clearance = np.abs(np.einsum("ij,ij->i", normals, triangles[:, 0])).min()
    grown: FloatArray = triangles * (radius / clearance * ROUND_UP)
    return grown
