"""Contact time of a whole arm that follows a plan, against free obstacles.

Time is cut into the slabs of a `PlannedCourse`. Some unit vector n from sphere to obstacle proves
that they do not touch within one of them:

    n.x - contact_distance - (deviation of the sphere along n) - max(D2(start), D2(end)) > 0

for every point of the obstacle's hull, D2 being its free bound, convex in time. What one sphere
does not prove, its children in the cover's tree may. Balls around all that a link sweeps in some
slabs, and the arm in all of them, spare most obstacles an evaluation sphere by sphere.

Where contact with an obstacle is permitted, a sphere that may be touched must be harmless from that
slab on (`harmless`). What it owns is not asked about any more then.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from armguard.bounds.joint_box import Vector, stays_within
from armguard.bounds.planned.course import (
    BLOCK,
    ArmShape,
    PlannedCourse,
    find_center,
    set_slab,
)
from armguard.bounds.planned.harmless import find_harmless_speed
from armguard.bounds.table_time import is_usable, obstacle_room, separating_direction
from armguard.contact.bodies import Bounds, Hull
from armguard.jit.arrays import FloatArray, IntArray
from armguard.jit.kernels import kernel, merged_kernel
from armguard.jit.numerics import SUM_ROUNDING
from armguard.obstacles.partners import ALONE, NO_PARTNER, find_partner
from armguard.obstacles.possible_states import is_known, possible_states, state_at
from armguard.obstacles.regions import ContactLimit, RegionLimits, strictest_limit
from armguard.obstacles.table import Marks, States
from armguard.obstacles.tethers import Tethers

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
    permitted_speed: float
    """How fast a surface can be at most in a contact that is permitted, and possible, in [m]/[s]; 0
    where none is. Of what was looked at: of all pairs where time is inf."""
    permitted_pair: int
    """The pair of that contact; NONE where there is none."""


class Permissions(NamedTuple):
    """What contact with obstacles is permitted."""

    limits: RegionLimits
    """By region."""
    obstacle_speeds: float | FloatArray = NONE
    """Of each pair, how fast something is at most that the link may press the obstacle against, in
    [m]/[s]: contact is permitted only once the way left is short enough as well. Negative where
    there is nothing but the arm's own links. Shape (m,) or ()."""


class Surroundings(NamedTuple):
    """An arm, and what is known of the obstacles around it."""

    arm: ArmShape
    bodies: States
    """Accepted states, by row."""
    refused_bodies: States
    """Refused samples beside them."""
    marks: Marks
    """Which of those may be true."""
    limits: RegionLimits
    """What contact is permitted."""
    tethers: Tethers
    """Between obstacles."""
    harmless_from: IntArray
    """Room to work in: the slab from which on each sphere is harmless to the obstacle at hand, as
    far as that was asked. Shape (n,)."""


def make_surroundings(
    arm: ArmShape,
    bodies: States,
    refused_bodies: States,
    marks: Marks,
    limits: RegionLimits,
    tethers: Tethers,
) -> Surroundings:
    """An arm among obstacles."""
    room = np.zeros(len(arm.carrier), dtype=np.int64)
    return Surroundings(arm, bodies, refused_bodies, marks, limits, tethers, room)


class Body(NamedTuple):
    """One state of an obstacle that may be true, and how near to it counts as contact."""

    hull: Hull
    reach: float
    """What counts as contact from the hull on, in [m]."""


@merged_kernel
def _make_body(states: States, row: int, radius: float, age: float, margin: float) -> Body:
    error = states.position_error[row]
    makes_sense = radius >= 0.0 and error >= 0.0 and margin >= 0.0
    bounds = Bounds(states.accel[row], states.speed[row], states.velocity_error[row], age)
    hull = Hull(states.points[row], states.velocities[row], states.point_count[row], bounds)
    return Body(hull, radius + margin + error if makes_sense else math.nan)


@merged_kernel
def _find_room(place: Vector, body: Body, start: float, end: float) -> tuple[float, Vector]:
    """Least n.x of a body from `start` to `end` after its stamp, and n, from a place towards it."""
    normal = separating_direction(place, body.hull, end)
    return obstacle_room(normal, place, body.hull, start, end), normal


@kernel
def _find_reach(radius: float, body: Body) -> float:
    """How near a body may come to the centre of a ball without touching it, in [m]."""
    return (radius + body.reach) * (1.0 + SUM_ROUNDING)


@merged_kernel
def _is_ball_free(ball: FloatArray, body: Body, start: float, end: float) -> bool:
    """Whether a body stays out of a ball from `start` to `end`, counted from its stamp."""
    room, _ = _find_room((ball[0], ball[1], ball[2]), body, start, end)
    return room > _find_reach(ball[3], body)


@kernel
def _is_sphere_free(
    node: int,
    slab: int,
    course: PlannedCourse,
    arm: ArmShape,
    body: Body,
    start: float,
    end: float,
) -> bool:
    """Whether a body stays out of a sphere of the arm in one slab."""
    center = find_center(arm, course.placement[slab], node)
    room, normal = _find_room(center, body, start, end)
    room -= _find_reach(arm.tree.radius[node], body)
    if not room > 0.0:
        return False
    if not set_slab(arm, course, slab, center):
        return False
    # Columns are of a point whose place was rounded.
    room -= SUM_ROUNDING * (abs(center[0]) + abs(center[1]) + abs(center[2]))
    jacobian, lever = course.jacobian[slab], arm.lever[node]
    is_free: bool = stays_within(room, normal, jacobian, lever, arm.exact, arm.box)
    return is_free


@kernel
def _find_harmless_owner(
    node: int,
    slab: int,
    permitted: ContactLimit,
    obstacle_speed: float,
    course: PlannedCourse,
    arm: ArmShape,
) -> tuple[int, float]:
    """The uppermost sphere that owns a leaf and is harmless from a slab on, and how fast it is.

    NONE where the leaf itself is not known to be harmless.
    """
    owner, greatest = NONE, 0.0
    while node >= 0:
        speed = find_harmless_speed(node, slab, permitted, obstacle_speed, course, arm)
        if speed == math.inf:
            break
        owner, greatest = node, speed
        node = arm.tree.parent[node]
    return owner, greatest


@kernel
def _find_contact(
    link: int,
    first: int,
    limit: int,
    offset: float,
    course: PlannedCourse,
    arm: ArmShape,
    body: Body,
    permitted: ContactLimit,
    obstacle_speed: float,
    harmless_from: IntArray,
) -> tuple[int, int, int, float]:
    """First slab before `limit` that is not proved free, the sphere that is not, and evaluations.

    `limit` where all are free, or harmless from the first slab on in which they are not. Last is
    how fast those are at most, in [m]/[s].
    """
    evaluated, greatest = 0, 0.0
    root = arm.tree.root[link]
    is_limited = permitted.max_speed > 0.0
    slab = first
    # Invariant: in every slab from `first` up to `slab` the link is proved free, or harmless.
    while slab < limit:
        if is_limited and slab >= harmless_from[root]:
            break
        start = body.hull.bounds.age + max(course.start[slab] - offset, 0.0)
        if slab == first or slab % BLOCK == 0:
            # A ball around all that the link sweeps in the slabs of a block may prove them at once.
            block = slab // BLOCK
            last = min((block + 1) * BLOCK, course.end.shape[0]) - 1
            evaluated += 1
            end = body.hull.bounds.age + (course.end[last] - offset)
            if _is_ball_free(course.block_balls[block, link], body, start, end):
                slab = last + 1
                continue
        end = body.hull.bounds.age + (course.end[slab] - offset)
        # Else the slab by itself: down the tree, to the children of spheres that are not free.
        node = root
        while node >= 0:
            if is_limited and slab >= harmless_from[node]:
                node = arm.tree.skip[node]
                continue
            evaluated += 1
            if _is_sphere_free(node, slab, course, arm, body, start, end):
                node = arm.tree.skip[node]
            elif arm.tree.first_child[node] >= 0:
                node = arm.tree.first_child[node]
            elif is_limited:
                owner, speed = _find_harmless_owner(
                    node, slab, permitted, obstacle_speed, course, arm
                )
                if owner == NONE:
                    return slab, node, evaluated, greatest
                harmless_from[owner] = slab
                greatest = max(greatest, speed)
                node = arm.tree.skip[owner]
            else:
                return slab, node, evaluated, greatest
        slab += 1
    return limit, NONE, evaluated, greatest


@kernel
def find_planned_contact(
    handle: Any,
    course: PlannedCourse,
    pairs: IntArray,
    obstacle_speeds: FloatArray,
    now: float,
    margin: float,
) -> tuple[float, int, int, int, float, int]:
    """Earliest possible contact of all pairs while the arm follows a course.

    Args:
        handle: On the `Surroundings` of the arm.
        course: Where the arm can be.
        pairs: Pair numbers, obstacle row × links + link; quickest in ascending order. Shape (m,).
        obstacle_speeds: Of each pair, how fast something is at most that the link may press the
            obstacle against, in [m]/[s]: contact is permitted only once the way left is no longer
            than `max_way`. Negative where there is nothing but the arm's own links. Shape (m,).
        now: In [s] on the clock of the obstacles' stamps.
        margin: Distance that counts as contact already, in [m].

    Returns:
        The fields of `PlannedContact`.
    """
    arm, bodies, refused, marks = (
        handle.content.arm,
        handle.content.bodies,
        handle.content.refused_bodies,
        handle.content.marks,
    )
    limits, harmless_from = handle.content.limits, handle.content.harmless_from
    tethers = handle.content.tethers
    permitted = strictest_limit(limits, 0)
    links = arm.tree.root.shape[0]
    slabs = course.start.shape[0]
    offset = now - course.epoch
    # The slab that the arm is in now.
    first = 0
    while first < slabs and not course.end[first] > offset:
        first += 1
    if not (first < slabs and offset >= 0.0):
        return 0.0, NONE, NONE, 0, 0.0, NONE
    left = course.end[slabs - 1] - offset
    limit = slabs
    evaluated = 0
    seen = NONE
    away = False
    partner = ALONE
    deciding_pair = NONE
    deciding_sphere = NONE
    permitted_speed, permitted_pair = 0.0, NONE
    # Invariant: the pairs before `index` are free, or harmless, in every slab before `limit`.
    for index in range(pairs.shape[0]):
        row, link = pairs[index] // links, pairs[index] % links
        if row != seen:
            # A new obstacle: is it known, and is it away from all that the arm sweeps?
            if not is_known(marks, row):
                return 0.0, pairs[index], NONE, evaluated, 0.0, NONE
            seen = row
            stated = strictest_limit(limits, marks.regions[row])
            permitted = ContactLimit(
                stated.max_speed, stated.max_way, stated.gap + margin, stated.thickness
            )
            away = True
            for number in possible_states(marks, row):
                states, place, age = state_at(bodies, refused, marks, row, number, now)
                body = _make_body(states, place, states.radius[place], age, margin)
                if not is_usable(body.hull, body.reach):
                    return 0.0, pairs[index], NONE, evaluated, 0.0, NONE
                away &= _is_ball_free(course.arm_ball, body, age, age + left)
            evaluated += 1
            partner = ALONE
            if not away:
                partner = find_partner(
                    tethers, bodies, refused, marks, limits, row, now, left, course.arm_ball
                )
            if partner.row != NO_PARTNER:
                age = now - bodies.stamp[partner.row]
                body = _make_body(bodies, partner.row, partner.radius, age, margin)
                away = _is_ball_free(course.arm_ball, body, age, age + left)
                evaluated += 1
            if permitted.max_speed > 0.0 and not away:
                # Nothing is known yet to be harmless to this one.
                harmless_from[:] = slabs
        if away:
            continue
        # Each of its states that may be true: slab by slab, up to the first contact so far.
        for number in possible_states(marks, row):
            states, place, age = state_at(bodies, refused, marks, row, number, now)
            body = _make_body(states, place, states.radius[place], age, margin)
            slab, sphere, spent, speed = _find_contact(
                link, first, limit, offset, course, arm, body, permitted, obstacle_speeds[index],
                harmless_from,
            )  # fmt: skip
            evaluated += spent
            if slab < limit and partner.row != NO_PARTNER:
                # As far as one of both states proves it, it is so.
                age = now - bodies.stamp[partner.row]
                body = _make_body(bodies, partner.row, partner.radius, age, margin)
                later, node, spent, other = _find_contact(
                    link, first, limit, offset, course, arm, body, permitted,
                    obstacle_speeds[index], harmless_from,
                )  # fmt: skip
                evaluated += spent
                if later > slab:
                    slab, sphere, speed = later, node, max(speed, other)
            if speed > permitted_speed:
                permitted_speed, permitted_pair = speed, pairs[index]
            if slab < limit:
                limit, deciding_pair, deciding_sphere = slab, pairs[index], sphere
    if limit == slabs:
        return math.inf, NONE, NONE, evaluated, permitted_speed, permitted_pair
    begin = max(float(course.start[limit] - offset), 0.0) * (1.0 - SUM_ROUNDING)
    return begin, deciding_pair, deciding_sphere, evaluated, permitted_speed, permitted_pair
