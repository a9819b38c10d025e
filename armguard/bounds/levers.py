"""Levers: bounds on the distance of a point of a chain of joints from each joint's axis.

The lever of a point and a joint is the point's reach about the joint. Drake calls it lambda, and
robot dynamics the moment arm at its longest.

From the point inwards, the set of all places that it can take is enclosed in the convex hull of a
few circles, written in a frame whose z axis is the axis of the joint at hand:

- The distance from the axis, and any c (distance) + s (height along it) with c >= 0, is a convex
  function of the place, so over the hull of some circles it is greatest on one of them. A circle
  lies inside the regular polygon around it, and over that a convex function is greatest at a
  corner: evaluating corners bounds the circle.
- A revolute joint is taken through all angles, limited or not. Distance and height do not change
  by it, so the bounds on c (distance) + s (height) for a fan of tangents enclose the whole solid
  of revolution, and that lies in the hull of the circles on which neighbouring tangents meet.
- A prismatic joint moves the hull along its axis: the circles at both ends of its travel span
  all that it sweeps.

So every reach about a joint is a proved bound over all configurations. Neither step loses more
than a factor 1.0012, which makes it the supremum over unlimited revolute joints up to about a
percent.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from armguard.bounds.checks import read_only
from armguard.exceptions import ArmguardError
from armguard.jit.arrays import FloatArray
from armguard.jit.kept_results import keep_results
from armguard.jit.kernels import kernel
from armguard.jit.numerics import SUM_ROUNDING
from armguard.robot.joints import is_prismatic

CORNERS = 64
"""Corners of the polygon around a circle; it sticks out of it by a factor 1.0012."""
TANGENTS = 33
"""Tangents from -90 to 90 degrees; where two meet sticks out by a factor 1.0012."""
MOST_KEPT = 256
"""Results that are kept of each kind: those of the links of a dozen arms."""


def bound_levers(model: Any, joint: int, points: FloatArray, travel: FloatArray) -> FloatArray:
    """Proved bounds on the distance of points from the axis lines of the joints that move them.

    Args:
        model: `pinocchio.Model` whose joints have one degree of freedom each.
        joint: Index of the joint that carries the points.
        points: In that joint's frame, in [m]. Shape (n, 3).
        travel: Least and greatest joint positions; used for prismatic joints. Shape (nv, 2).

    Returns:
        Distances in [m]; 1 for a prismatic joint, 0 for one that does not move the points.
        Shape (n, nv).

    Raises:
        ArmguardError: A joint that moves the points is neither revolute nor prismatic, or slides
            without limits.
    """
    reach, _ = _walk(model, joint, points, travel)
    levers = np.zeros((len(points), model.nv))
    levers[:, [model.idx_vs[number] for number in moving_joints(model, joint)]] = reach
    return levers


def bound_outlines(
    model: Any, joint: int, points: FloatArray, travel: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Where points can get to, seen from the axis of the first revolute joint that moves them.

    Args:
        model: As for `bound_levers`; at least one joint that moves the points is revolute.
        joint: Index of the joint that carries the points.
        points: In that joint's frame, in [m]. Shape (n, 3).
        travel: Least and greatest joint positions; used for prismatic joints. Shape (nv, 2).

    Returns:
        Distance from that axis and height along it, in [m], of the corners of a polygon that
        contains all that each point takes, up to a part with negative distances. Shape
        (n, TANGENTS - 1, 2). And that axis, a unit vector in the frame of its joint. Shape (3,).
    """
    _, supports = _walk(model, joint, points, travel)
    tangents = _tangents()
    before, after = tangents[:-1], tangents[1:]
    determinant = before[:, 0] * after[:, 1] - after[:, 0] * before[:, 1]
    distance = supports[:, :-1] * after[:, 1] - supports[:, 1:] * before[:, 1]
    height = supports[:, 1:] * before[:, 0] - supports[:, :-1] * after[:, 0]
    first = next(k for k in moving_joints(model, joint) if not is_prismatic(model, k))
    corners = np.stack([distance / determinant, height / determinant], axis=-1)
    return corners, _axis_frame(model, first)[:, 2]


def _walk(
    model: Any, joint: int, points: FloatArray, travel: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Reaches about the joints that move the points, (n, joints); supports, (n, TANGENTS)."""
    chain = moving_joints(model, joint)
    columns = [model.idx_vs[number] for number in chain]
    prismatic = np.array([is_prismatic(model, number) for number in chain])
    for number, column, slides in zip(chain, columns, prismatic, strict=True):
        if slides and not (-np.inf < travel[column, 0] <= travel[column, 1] < np.inf):
            raise ArmguardError(
                f"joint {model.names[number]}",
                f"slides between {travel[column].tolist()} m",
                expected="finite position limits, lower before upper",
            )
    frames = [_axis_frame(model, number) for number in chain]
    steps = np.zeros((len(chain), 3, 4))
    for k in range(1, len(chain)):
        placement = model.jointPlacements[chain[k]]
        steps[k, :, :3] = frames[k - 1].T @ placement.rotation @ frames[k]
        steps[k, :, 3] = frames[k - 1].T @ placement.translation

    local = np.ascontiguousarray(points @ frames[-1])
    return _bound_places(local, steps, prismatic, travel[columns])


@keep_results(MOST_KEPT)
def _bound_places(
    points: FloatArray, steps: FloatArray, prismatic: npt.NDArray[np.bool_], travel: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """As `_walk`, of points in the frame of the outermost axis; both read-only.

    Args:
        points: In [m]. Shape (n, 3).
        steps: From the frame of each axis to that of the next one outwards. Shape (joints, 3, 4).
        prismatic: Which joints are. Shape (joints,).
        travel: Least and greatest joint positions. Shape (joints, 2).
    """
    tangents = _tangents()
    turn = 2.0 * np.pi * np.arange(CORNERS) / CORNERS
    around = (1.0 + SUM_ROUNDING) / np.cos(np.pi / CORNERS)
    corners = around * np.column_stack([np.cos(turn), np.sin(turn)])
    circles = np.empty((_most_circles(prismatic), 3, 3))
    reach = np.empty((len(points), len(steps)))
    supports = np.full((len(points), TANGENTS), np.inf)
    _walk_inwards(points, steps, prismatic, travel, tangents, corners, circles, reach, supports)
    return read_only(reach), read_only(supports)


def _tangents() -> FloatArray:
    """Directions of the tangents: distance and height. Shape (TANGENTS, 2)."""
    angle = np.linspace(-0.5 * np.pi, 0.5 * np.pi, TANGENTS)
    tangents = np.column_stack([np.cos(angle), np.sin(angle)])
    # The outermost tangents bound the height alone, and the middle one the distance alone.
    tangents[0], tangents[TANGENTS // 2], tangents[-1] = (0.0, -1.0), (1.0, 0.0), (0.0, 1.0)
    return tangents


def moving_joints(model: Any, joint: int) -> list[int]:
    """Indices of the joints that move what a joint carries, from the base outwards."""
    return list(model.supports[joint])[1:]


def _axis_frame(model: Any, joint: int) -> FloatArray:
    """A rotation whose third column is the joint's axis in the joint's own frame. Shape (3, 3)."""
    subspace = np.ravel(model.joints[joint].createData().S)
    return _turn_upright(subspace[:3] if is_prismatic(model, joint) else subspace[3:])


@keep_results(MOST_KEPT)
def _turn_upright(axis: FloatArray) -> FloatArray:
    """A rotation whose third column is along an axis; read-only. Shape (3, 3)."""
    axis = axis / np.linalg.norm(axis)
    first = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    first /= np.linalg.norm(first)
    return read_only(np.column_stack([first, np.cross(axis, first), axis]))


def _most_circles(prismatic: npt.NDArray[np.bool_]) -> int:
    """Most circles alive at once: each prismatic joint doubles them, a revolute one resets them."""
    count = most = 1
    for slides in prismatic[::-1]:
        count = 2 * count if slides else TANGENTS - 1
        most = max(most, count)
    return most


@kernel
def _walk_inwards(
    points: FloatArray,
    steps: FloatArray,
    prismatic: npt.NDArray[np.bool_],
    travel: FloatArray,
    tangents: FloatArray,
    corners: FloatArray,
    circles: FloatArray,
    levers: FloatArray,
    outlines: FloatArray,
) -> None:
    """Fill `levers`; a circle is its centre and two perpendicular radii, rows of a (3, 3) block.

    `outlines` takes the supports of each point about the first revolute joint's axis.
    """
    for i in range(points.shape[0]):
        supports = outlines[i]
        # The point itself is a circle without radii, in the frame of the outermost joint's axis.
        for axis in range(3):
            circles[0, 0, axis] = points[i, axis]
            circles[0, 1, axis] = circles[0, 2, axis] = 0.0
        count = 1
        scale = 0.0
        # Invariant: all places that the joints behind joint j can bring the point to lie in the
        # convex hull of the circles, written in the frame of the axis of joint j.
        for j in range(steps.shape[0] - 1, -1, -1):
            if prismatic[j]:
                levers[i, j] = 1.0
                count = _slide(circles, count, travel[j, 0], travel[j, 1])
            else:
                # Supports of all places, about this axis; the middle one is the reach about it.
                scale = max(scale, _bound_meridian(circles, count, tangents, corners, supports))
                for k in range(supports.shape[0]):
                    supports[k] += SUM_ROUNDING * scale
                levers[i, j] = supports[tangents.shape[0] // 2]
                # Turned through all angles: circles that enclose the solid.
                count = _enclose(tangents, supports, circles)
            if j > 0:
                _step(circles, count, steps[j])


@kernel
def _bound_meridian(
    circles: FloatArray, count: int, tangents: FloatArray, corners: FloatArray, supports: FloatArray
) -> float:
    """Bound c (distance) + s (height) over all circles for each tangent; the largest length met."""
    supports[:] = -np.inf
    largest = 0.0
    for k in range(count):
        center, first, second = circles[k, 0], circles[k, 1], circles[k, 2]
        for m in range(1 if _is_point(circles[k]) else corners.shape[0]):
            a, b = corners[m, 0], corners[m, 1]
            x = center[0] + a * first[0] + b * second[0]
            y = center[1] + a * first[1] + b * second[1]
            z = center[2] + a * first[2] + b * second[2]
            distance = math.sqrt(x * x + y * y)
            largest = max(largest, distance, abs(z))
            for n in range(tangents.shape[0]):
                supports[n] = max(supports[n], tangents[n, 0] * distance + tangents[n, 1] * z)
    return largest


@kernel
def _is_point(circle: FloatArray) -> bool:
    found = True
    for axis in range(3):
        found = found and circle[1, axis] == 0.0 and circle[2, axis] == 0.0
    return found


@kernel
def _enclose(tangents: FloatArray, supports: FloatArray, circles: FloatArray) -> int:
    """Circles on which neighbouring tangents meet; how many there are."""
    count: int = tangents.shape[0] - 1
    for k in range(count):
        c1, s1 = tangents[k, 0], tangents[k, 1]
        c2, s2 = tangents[k + 1, 0], tangents[k + 1, 1]
        determinant = c1 * s2 - c2 * s1
        distance = (supports[k] * s2 - supports[k + 1] * s1) / determinant
        height = (c1 * supports[k + 1] - c2 * supports[k]) / determinant
        circles[k] = 0.0
        circles[k, 0, 2] = height
        circles[k, 1, 0] = circles[k, 2, 1] = distance
    return count


@kernel
def _slide(circles: FloatArray, count: int, lowest: float, highest: float) -> int:
    """The circles at both ends of a prismatic joint's travel."""
    for k in range(count):
        for part in range(3):
            for axis in range(3):
                circles[count + k, part, axis] = circles[k, part, axis]
        circles[k, 0, 2] += lowest
        circles[count + k, 0, 2] += highest
    return 2 * count


@kernel
def _step(circles: FloatArray, count: int, step: FloatArray) -> None:
    """Write circles in the axis frame of the joint before."""
    for k in range(count):
        for part in range(3):
            x, y, z = circles[k, part, 0], circles[k, part, 1], circles[k, part, 2]
            for row in range(3):
                value = step[row, 0] * x + step[row, 1] * y + step[row, 2] * z
                circles[k, part, row] = value + step[row, 3] if part == 0 else value
