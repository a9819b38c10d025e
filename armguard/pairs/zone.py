"""Convex zones of the world, and proofs that obstacles stay in a zone for some time.

That is what contact only within a region rests on. Wherever an arm touches an obstacle, the place
belongs to the obstacle; so as long as all of the obstacle is in the region, whatever it does within
its bounds, nothing can touch it outside.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import coal
import numpy as np
from numpy.typing import NDArray

from armguard.bounds.free_body import displacement_at, length_above, top_speed
from armguard.exceptions import ArmguardError
from armguard.jit.arrays import FloatArray, IntArray
from armguard.jit.kernels import kernel
from armguard.obstacles.possible_states import is_known, possible_states, state_at
from armguard.obstacles.table import MAXIMUM_POINTS, States

THINNEST = 1e-3
"""Of a zone, in [m]: what is flatter holds nothing."""

FARTHEST = 1000.0
"""From the origin, in [m], that a corner may be."""

SLIMMEST = 1e-4
"""Least height of a triangle of the surface, as a share of the length of the zone: of slimmer ones
it is not known well enough which way they face."""

KEPT = 1e-6
"""What a body stays away from each face, in [m]. It is far above what rounding does to a face: a
triangle as slim as `SLIMMEST` faces the right way to 4 e / `SLIMMEST`, with e the unit of rounding,
so anywhere on a zone of length L its plane is off by less than 1e-11 L, that is 1e-8 m at most."""


class Zone(NamedTuple):
    """A convex region."""

    points: FloatArray
    """Whose hull it is, in [m]. Shape (k, 3)."""
    faces: FloatArray
    """Unit vectors that point out of it, and how far out each goes, in [m]. Shape (f, 4)."""


def read_zone(points: object) -> Zone:
    """The hull of some points, checked.

    Args:
        points: Its corners in the world, in [m]. Shape (k, 3), 4 <= k <= 8.

    Raises:
        ArmguardError: They are no points, not finite, too many, or enclose no room, or corners are
            so near to each other or to an edge that the faces between them are not known.
    """
    offender = "zone"
    try:
        corners = np.array(points, dtype=np.float64)
    except (TypeError, ValueError):
        raise ArmguardError(offender, f"is {points!r}", expected=_EXPECTED) from None
    if corners.ndim != 2 or corners.shape[1] != 3 or not 4 <= len(corners) <= MAXIMUM_POINTS:
        raise ArmguardError(offender, f"has shape {corners.shape}", expected=_EXPECTED)
    if not np.abs(corners).max() <= FARTHEST:
        raise ArmguardError(
            offender,
            f"has the corners {corners.tolist()}",
            expected=f"finite coordinates in metres, {FARTHEST:g} at most",
        )
    centered = corners - corners.mean(axis=0)
    axes = np.linalg.svd(centered, full_matrices=False)[2]
    extents = np.ptp(centered @ axes.T, axis=0)
    length = float(extents.max())
    # Coal's hull fails on what is flat.
    if not extents.min() >= max(THINNEST, SLIMMEST * length):
        raise ArmguardError(
            offender,
            f"is {extents.min():.2g} m thick and encloses no room",
            expected="corners that are not in a plane, in metres",
        )
    vectors = coal.StdVec_Vec3s()
    vectors.extend(list(corners))
    hull = coal.Convex.convexHull(vectors, True, "Qt")
    vertices = np.array(hull.points())
    triangles = vertices[
        [[hull.polygons(i)[k] for k in range(3)] for i in range(hull.num_polygons)]
    ]
    edges = np.roll(triangles, -1, axis=1) - triangles
    normals = np.cross(edges[:, 0], edges[:, 1])
    area = np.linalg.norm(normals, axis=1)
    height = area / np.linalg.norm(edges, axis=2).max(axis=1)
    if not height.min() >= SLIMMEST * length:
        raise ArmguardError(
            offender,
            f"has corners that are as good as in a line: {corners.tolist()}",
            expected="corners apart from each other and from the edges between others",
        )
    normals /= area[:, None]
    inwards = (normals * (corners.mean(axis=0) - triangles[:, 0])).sum(axis=1) > 0.0
    normals[inwards] *= -1.0
    offsets = (triangles @ normals[:, :, None])[:, :, 0].min(axis=1) - KEPT
    faces = np.unique(np.column_stack([normals, offsets]), axis=0)
    corners.flags.writeable = False
    return Zone(corners, faces)


_EXPECTED = f"4 to {MAXIMUM_POINTS} corners of a convex region, of shape (k, 3), in [m]"


@kernel
def _stays(bodies: States, place: int, faces: FloatArray, earliest: float, latest: float) -> bool:
    """Whether one state of an obstacle stays behind all faces, from `earliest` to `latest` [s].

    Both are counted from its stamp, and may be before it. A body is the hull of points, rounded by
    a radius, so it is farthest out where one of its points is. How far that has moved along the
    face's normal at the most is convex in time on either side of the stamp, and 0 there: within a
    span of time it is greatest at an end of the span, or is 0 at the stamp.
    """
    accel, error = bodies.accel[place], bodies.velocity_error[place]
    size = bodies.radius[place] + bodies.position_error[place]
    for k in range(bodies.point_count[place]):
        x, y, z = bodies.points[place, k, 0], bodies.points[place, k, 1], bodies.points[place, k, 2]
        vx, vy, vz = (
            bodies.velocities[place, k, 0],
            bodies.velocities[place, k, 1],
            bodies.velocities[place, k, 2],
        )
        top = top_speed(length_above(vx, vy, vz), bodies.speed[place], error)
        for face in range(faces.shape[0]):
            nx, ny, nz = faces[face, 0], faces[face, 1], faces[face, 2]
            out = nx * vx + ny * vy + nz * vz
            front = nx * x + ny * y + nz * z + size
            at_first = front + displacement_at(out, error, accel, top, earliest)
            at_last = front + displacement_at(out, error, accel, top, latest)
            # One by one, so that what is no number fails.
            if not (at_first <= faces[face, 3] and at_last <= faces[face, 3]):
                return False
            if earliest < 0.0 and not front <= faces[face, 3]:
                return False
    return True


@kernel
def find_staying(
    table_handle: Any,
    faces: FloatArray,
    rows: IntArray,
    now: float,
    horizon: float,
    staying: NDArray[np.bool_],
) -> None:
    """Find the obstacles that certainly stay in a zone from now on for some time.

    All states of an obstacle that may be true must stay there, refused ones among them, each with
    its errors, its age and its bounds; one that could be anywhere does not.

    Args:
        table_handle: On the obstacle table's `Rows`.
        faces: Of the zone.
        rows: Of the obstacles. Shape (n,).
        now: Time of the tick, in [s].
        horizon: For how long, in [s].
        staying: Is filled. Shape (n,).
    """
    table = table_handle.content
    for i in range(rows.shape[0]):
        row = rows[i]
        stays = is_known(table.marks, row)
        if stays:
            for number in possible_states(table.marks, row):
                bodies, place, age = state_at(
                    table.accepted, table.refused, table.marks, row, number, now
                )
                stays = stays and _stays(bodies, place, faces, age, age + horizon)
        staying[i] = stays
