"""Contact time of a whole arm that follows a plan, against free obstacles.

Time is cut into the slabs of a `PlannedCourse`. Some unit vector n from sphere to obstacle proves
that they do not touch within one of them:

    n.x - contact_distance - (deviation of the sphere along n) - max(D2(start), D2(end)) > 0

for every point of the obstacle's hull, D2 being its free bound, convex in time. What one sphere
does not prove, its children in the cover's tree may. Balls around all that a link sweeps in some
slabs, and the arm in all of them, spare most obstacles an evaluation sphere by sphere.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from armguard.bounds.free_body import saturation_time
from armguard.bounds.planned.course import (
    BLOCK,
    ArmShape,
    PlannedCourse,
    close_deviation_along,
    deviation_along,
)
from armguard.bounds.table_time import obstacle_room
from armguard.contact.bodies import Bounds, Hull
from armguard.contact.gjk import nearest_on_hull
from armguard.jit.arrays import FloatArray, IntArray
from armguard.jit.kernels import kernel
from armguard.jit.numerics import SUM_ROUNDING
from armguard.obstacles.possible_states import is_known, possible_states, state_at
from armguard.obstacles.table import Marks, States

NONE = -1
"""In place of a pair's or a sphere's number, where none decides."""


class PlannedContact(NamedTuple):
    """The earliest contact that a plan allows for."""

    time: float
    """No contact before this, in [s] from now; inf: none before the arm rests after the plan."""
    pair: int
    """The pair that decides, obstacle row × links + link; NONE where time is inf, and where the
    course does not say where the arm is now."""
    sphere: int
    """The sphere that decides; NONE where there is no such pair, and where nothing is known of the
    obstacle."""
    evaluated: int
    """Spheres evaluated, for one slab and one obstacle each."""


@kernel
def _find_room(
    px: float, py: float, pz: float, bodies: States, row: int, start: float, end: float
) -> tuple[float, float, float, float]:
    """Least n.x of a body from `start` to `end` after its stamp, and n, from p towards it."""
    bounds = Bounds(bodies.accel[row], bodies.speed[row], bodies.velocity_error[row], 0.0)
    hull = Hull(bodies.points[row], bodies.velocities[row], bodies.point_count[row], bounds)
    points, velocities, count, _ = hull
    ux, uy, uz = velocities[0, 0], velocities[0, 1], velocities[0, 2]
    # Beyond that time the obstacle may be headed anywhere.
    ahead = min(end, saturation_time(ux, uy, uz, bounds.accel, bounds.speed))
    x, y, z = nearest_on_hull(px, py, pz, points, velocities, count, ahead)
    length = math.sqrt(x * x + y * y + z * z)
    nx, ny, nz = x / length, y / length, z / length
    room = obstacle_room((nx, ny, nz), (px, py, pz), hull, start, end)
    return room, nx, ny, nz


@kernel
def _is_usable(bodies: States, row: int, age: float, margin: float) -> bool:
    return (
        bodies.point_count[row] >= 1
        and bodies.accel[row] >= 0.0
        and bodies.speed[row] >= 0.0
        and bodies.velocity_error[row] >= 0.0
        and bodies.radius[row] >= 0.0
        and bodies.position_error[row] >= 0.0
        and margin >= 0.0
        and abs(age) < math.inf
    )


@kernel
def _is_ball_free(
    ball: FloatArray, bodies: States, row: int, start: float, end: float, margin: float
) -> bool:
    """Whether a body stays out of a ball from `start` to `end`, counted from its stamp."""
    room, _, _, _ = _find_room(ball[0], ball[1], ball[2], bodies, row, start, end)
    reach = ball[3] + bodies.radius[row] + margin + bodies.position_error[row]
    return room > reach * (1.0 + SUM_ROUNDING)


@kernel
def _is_sphere_free(
    node: int,
    slab: int,
    course: PlannedCourse,
    arm: ArmShape,
    bodies: States,
    row: int,
    start: float,
    end: float,
    margin: float,
) -> bool:
    """Whether a body stays out of a sphere of the arm in one slab."""
    center = course.centers[slab, node]
    px, py, pz = center[0], center[1], center[2]
    room, nx, ny, nz = _find_room(px, py, pz, bodies, row, start, end)
    reach = arm.radius[node] + bodies.radius[row] + margin + bodies.position_error[row]
    room -= reach * (1.0 + SUM_ROUNDING)
    if not room > 0.0:
        return False
    deviation = deviation_along(
        nx, ny, nz, px, py, pz,
        course.jacobian[slab], course.half[slab], arm.lever[node], arm.turning,
    )  # fmt: skip
    if room > deviation or arm.child_count[node] > 0:
        return room > deviation
    # Children would see a sphere more closely, but a leaf has none.
    deviation = close_deviation_along(
        nx, ny, nz, px, py, pz,
        course.jacobian[slab], course.half[slab], arm.lever[node], arm.turning,
    )  # fmt: skip
    return room > deviation


@kernel
def _find_contact(
    link: int,
    first: int,
    limit: int,
    offset: float,
    course: PlannedCourse,
    arm: ArmShape,
    bodies: States,
    row: int,
    age: float,
    margin: float,
) -> tuple[int, int, int]:
    """First slab before `limit` that is not proved free, the sphere that is not, and evaluations.

    `limit` where all are.
    """
    evaluated = 0
    slab = first
    # Invariant: the link is proved free in every slab from `first` up to `slab`.
    while slab < limit:
        start = age + max(course.start[slab] - offset, 0.0)
        if slab == first or slab % BLOCK == 0:
            # A ball around all that the link sweeps in the slabs of a block may prove them at once.
            block = slab // BLOCK
            last = min((block + 1) * BLOCK, course.end.shape[0]) - 1
            evaluated += 1
            end = age + (course.end[last] - offset)
            if _is_ball_free(course.block_balls[block, link], bodies, row, start, end, margin):
                slab = last + 1
                continue
        end = age + (course.end[slab] - offset)
        # Else the slab by itself: down the tree, to the children of spheres that are not free.
        arm.stack[0] = arm.root[link]
        waiting = 1
        while waiting > 0:
            waiting -= 1
            node = arm.stack[waiting]
            evaluated += 1
            if _is_sphere_free(node, slab, course, arm, bodies, row, start, end, margin):
                continue
            if arm.child_count[node] == 0:
                return slab, node, evaluated
            for child in range(arm.child_count[node]):
                arm.stack[waiting] = arm.first_child[node] + child
                waiting += 1
        slab += 1
    return limit, NONE, evaluated


@kernel
def find_planned_contact(
    pairs: IntArray,
    now: float,
    margin: float,
    course: PlannedCourse,
    arm: ArmShape,
    bodies: States,
    refused_bodies: States,
    marks: Marks,
) -> tuple[float, int, int, int]:
    """Earliest possible contact of all pairs while the arm follows a course.

    Args:
        pairs: Pair numbers, obstacle row × links + link; quickest in ascending order. Shape (m,).
        now: In [s] on the clock of the obstacles' stamps.
        margin: Distance that counts as contact already, in [m].
        course: Where the arm can be.
        arm: Its spheres.
        bodies: Accepted states of obstacles, by row.
        refused_bodies: Refused ones.
        marks: Which of those may be true.

    Returns:
        The fields of `PlannedContact`.
    """
    links = arm.root.shape[0]
    slabs = course.start.shape[0]
    offset = now - course.epoch
    # The slab that the arm is in now.
    first = 0
    while first < slabs and not course.end[first] > offset:
        first += 1
    if not (first < slabs and offset >= 0.0):
        return 0.0, NONE, NONE, 0
    left = course.end[slabs - 1] - offset
    limit = slabs
    evaluated = 0
    seen = NONE
    away = False
    deciding_pair = NONE
    deciding_sphere = NONE
    # Invariant: the pairs before `index` are free in every slab before `limit`.
    for index in range(pairs.shape[0]):
        row, link = pairs[index] // links, pairs[index] % links
        if row != seen:
            # A new obstacle: is it known, and is it away from all that the arm sweeps?
            if not is_known(marks, row):
                return 0.0, pairs[index], NONE, evaluated
            seen = row
            away = True
            for number in possible_states(marks, row):
                states, place, age = state_at(bodies, refused_bodies, marks, row, number, now)
                if not _is_usable(states, place, age, margin):
                    return 0.0, pairs[index], NONE, evaluated
                away &= _is_ball_free(course.arm_ball, states, place, age, age + left, margin)
            evaluated += 1
        if away:
            continue
        # Each of its states that may be true: slab by slab, up to the first contact so far.
        for number in possible_states(marks, row):
            states, place, age = state_at(bodies, refused_bodies, marks, row, number, now)
            slab, sphere, spent = _find_contact(
                link, first, limit, offset, course, arm, states, place, age, margin
            )
            evaluated += spent
            if slab < limit:
                limit, deciding_pair, deciding_sphere = slab, pairs[index], sphere
    if limit == slabs:
        return math.inf, NONE, NONE, evaluated
    begin = float(course.start[limit] - offset)
    return max(begin, 0.0) * (1.0 - SUM_ROUNDING), deciding_pair, deciding_sphere, evaluated
