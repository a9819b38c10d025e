"""Contact time of a sphere of an arm with bounded joints, against a free obstacle.

An interval [a, b] is free of contact if some unit vector n from sphere to obstacle proves it:

    n.x - contact_distance - D1(a, b) - max(D2(a), D2(b)) > 0

for every point of the obstacle's hull. D1 bounds the sphere's displacement along n from a to b, and
comes from a table of joint displacements that serves all pairs; D2 is the bound of a free body,
convex in time. The search strides ahead: while intervals turn out free they grow, and one that its
direction does not prove is halved, at last within a single step of the table. Each interval gets a
separating direction of its own, which points from the middle of where the sphere can be by its end
to where the obstacle is headed. What the search reaches is a proved lower bound, whichever
intervals and directions it took.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from armguard.bounds.free_body import (
    displacement_at,
    length_above,
    saturation_time,
    top_speed,
)
from armguard.bounds.joint_box import Vector, set_columns, stays_within
from armguard.bounds.joint_table import JointTable, set_span
from armguard.contact.bodies import Hull
from armguard.contact.gjk import nearest_on_hull
from armguard.jit.arrays import FloatArray
from armguard.jit.kernels import kernel, merged_kernel, separate_kernel
from armguard.jit.numerics import SUM_ROUNDING, TABLE_END_SLACK

HALVINGS = 3
"""How often the step of the table in which it ends is halved."""


class ArmSphere(NamedTuple):
    """A sphere of the arm whose joints are bounded, at the arm's stamp."""

    x: float
    """Of its centre in the world, in [m]; y and z likewise."""
    y: float
    z: float
    jacobian: FloatArray
    """Pinocchio's `data.J`, in the world. Shape (6, nv)."""
    lever: FloatArray
    """The sphere's row of the motion's `lever`. Shape (nv,)."""
    slope_error: FloatArray
    """The sphere's row of the motion's `slope_error`. Shape (nv,)."""


@merged_kernel
def obstacle_room(normal: Vector, place: Vector, hull: Hull, start: float, end: float) -> float:
    """Least n.x over a hull at any time from `start` to `end`, counted from its stamp.

    Args:
        normal: The direction n, of length 1.
        place: From where x counts, in [m].
        hull: The obstacle's.
        start: In [s].
        end: In [s].
    """
    nx, ny, nz = normal
    px, py, pz = place
    points, velocities, count, bounds = hull
    accel, speed, velocity_error, _ = bounds
    least = math.inf
    # The bound of a free body is convex in time, so the ends of the interval decide.
    for k in range(count):
        x, y, z = points[k, 0] - px, points[k, 1] - py, points[k, 2] - pz
        ux, uy, uz = velocities[k, 0], velocities[k, 1], velocities[k, 2]
        pace = length_above(ux, uy, uz)
        top = top_speed(pace, speed, velocity_error)
        closing = -(nx * ux + ny * uy + nz * uz)
        error = velocity_error + SUM_ROUNDING * pace
        room = nx * x + ny * y + nz * z - SUM_ROUNDING * (abs(x) + abs(y) + abs(z))
        before = room - displacement_at(closing, error, accel, top, start)
        after = room - displacement_at(closing, error, accel, top, end)
        if math.isnan(before + after):
            return math.nan
        least = min(least, before, after)
    return least


@merged_kernel
def separating_direction(place: Vector, hull: Hull, ahead: float) -> Vector:
    """From a place towards where a hull is headed by a time after its stamp, in [s]."""
    x, y, z = place
    points, velocities, count, bounds = hull
    ux, uy, uz = velocities[0, 0], velocities[0, 1], velocities[0, 2]
    # From then on the obstacle may be headed anywhere.
    ahead = min(ahead, saturation_time(ux, uy, uz, bounds.accel, bounds.speed))
    x, y, z = nearest_on_hull(x, y, z, points, velocities, count, ahead)
    length = math.sqrt(x * x + y * y + z * z)
    return x / length, y / length, z / length


@merged_kernel
def aim(sphere: ArmSphere, table: JointTable, node: int, hull: Hull) -> Vector:
    """A separating direction for the time of a node, from the middle of where the sphere can be."""
    x, y, z, _, lever, _ = sphere
    for j in range(lever.shape[0]):
        if lever[j] > 0.0:
            high = min(table.high[node, j], table.highest[j])
            low = max(table.low[node, j], table.lowest[j])
            middle = 0.5 * (high + low)
            x += table.box.columns[0, j] * middle
            y += table.box.columns[1, j] * middle
            z += table.box.columns[2, j] * middle
    return separating_direction((x, y, z), hull, hull.bounds.age + table.time[node])


@merged_kernel
def is_interval_free(
    sphere: ArmSphere,
    table: JointTable,
    hull: Hull,
    contact_distance: float,
    normal: Vector,
    interval: tuple[int, int, float],
) -> bool:
    """Whether a direction separates both from one node on to a fraction of the time to another.

    `table.box.columns` are the sphere's.
    """
    x, y, z, jacobian, lever, slope_error = sphere
    first, last, part = interval
    start = table.time[first]
    end = start + part * (table.time[last] - start)
    set_span(table, first, last, part)
    age = hull.bounds.age
    room = obstacle_room(normal, (x, y, z), hull, age + start, age + end)
    room -= contact_distance * (1.0 + SUM_ROUNDING)
    is_free: bool = stays_within(room, normal, jacobian, lever, slope_error, table.box)
    return is_free


@kernel
def is_usable(hull: Hull, contact_distance: float) -> bool:
    """Whether an obstacle is made of numbers that make sense."""
    accel, speed, velocity_error, age = hull.bounds
    return (
        hull.size >= 1
        and contact_distance >= 0.0
        and accel >= 0.0
        and speed >= 0.0
        and velocity_error >= 0.0
        and abs(age) < math.inf
    )


@kernel
def is_free_at_once(
    sphere: ArmSphere, table: JointTable, hull: Hull, contact_distance: float
) -> bool:
    """Whether one direction proves that both do not touch before the table ends.

    Arguments as for `is_free_until`, which may prove what this does not.
    """
    nodes = table.time.shape[0] - 1
    are_finite = set_columns(sphere.x, sphere.y, sphere.z, sphere.jacobian, table.box)
    if not (is_usable(hull, contact_distance) and are_finite):
        return False
    normal = aim(sphere, table, nodes, hull)
    interval = 0, nodes, 1.0
    found: bool = is_interval_free(sphere, table, hull, contact_distance, normal, interval)
    return found


@kernel
def is_free_until(
    sphere: ArmSphere, table: JointTable, hull: Hull, contact_distance: float, last: int
) -> bool:
    """Whether it is proved that a sphere and a rounded hull do not touch before a node's time.

    The last node is when an arm that brakes has come to rest. Both can be farthest from where they
    are now in the end, so nearly always the direction for the end proves the whole time at once.
    And it is the direction of every interval up to the end: what it does not prove of the last step
    it proves of no longer one, so that no search would get there. (A table that interpolates has
    parts of steps, which end before.) Between the two, `table_contact_time` searches: what that
    proves is proved here.

    Args:
        sphere: The one.
        table: What the motion's `tabulate` filled for this tick.
        hull: The other; speeds and accelerations may be infinite.
        contact_distance: Both radii, margin and position errors, the arm's included, in [m].
        last: Number of the node, above 0.
    """
    are_finite = set_columns(sphere.x, sphere.y, sphere.z, sphere.jacobian, table.box)
    if not (is_usable(hull, contact_distance) and are_finite):
        return False
    normal = aim(sphere, table, last, hull)
    for first in (0, last - 1):
        interval = first, last, 1.0
        is_free = is_interval_free(sphere, table, hull, contact_distance, normal, interval)
        if is_free == (first == 0):
            return is_free
    end = table.time[last] * (1.0 - TABLE_END_SLACK)
    enough = math.inf if last == table.time.shape[0] - 1 else end
    return table_contact_time(sphere, table, hull, contact_distance, 0.0, enough) >= end


@separate_kernel
def table_contact_time(
    sphere: ArmSphere,
    table: JointTable,
    hull: Hull,
    contact_distance: float,
    free_until: float,
    enough: float = math.inf,
) -> float:
    """Earliest time at which a sphere of the arm and a rounded hull could touch.

    Args:
        sphere: The one.
        table: What the motion's `tabulate` filled for this tick.
        hull: The other; speeds and accelerations may be infinite.
        contact_distance: Both radii, margin and position errors, the arm's included, in [m].
        free_until: Time in [s] that another proof has shown free of contact; 0: none.
        enough: Time in [s] beyond which the search may stop.

    Returns:
        Time from now in [s], no earlier than `free_until`, before which there is no contact. The
        end of the table is the most that it can say by itself.
    """
    time = table.time
    nodes = time.shape[0] - 1
    reached = free_until if free_until > 0.0 else 0.0
    if not (is_usable(hull, contact_distance) and reached < time[nodes]):
        return reached
    # Begin at the step of the table up to which another proof reaches.
    first = 0
    while time[first + 1] <= reached:
        first += 1
    if not set_columns(sphere.x, sphere.y, sphere.z, sphere.jacobian, table.box):
        return reached
    # Mostly what is enough can be had at once: one direction for all the time until then.
    last = first + 1
    while last < nodes and time[last] * (1.0 - SUM_ROUNDING) < enough:
        last += 1
    if time[last] * (1.0 - SUM_ROUNDING) >= enough:
        normal = aim(sphere, table, last, hull)
        if is_interval_free(sphere, table, hull, contact_distance, normal, (first, last, 1.0)):
            return max(reached, time[last] * (1.0 - SUM_ROUNDING))
    stride = 1  # mostly another proof has reached nearly as far
    failing = nodes + 1  # the last node that failed; beyond the table: none
    part, proved, failed = 1.0, 0.0, 1.0
    halvings = 0
    normal = (math.nan, math.nan, math.nan)
    # Invariant: there is no contact before `reached`, nor before the time of node `first`.
    while first < nodes and reached < enough:
        # Choose the interval, and what joints can do in it.
        last = min(first + stride, nodes)
        end = time[first] + part * (time[last] - time[first])
        # Try to separate both: one direction an interval, kept where only its part is halved.
        if halvings == 0:
            normal = aim(sphere, table, last, hull)
        interval = first, last, part
        free = is_interval_free(sphere, table, hull, contact_distance, normal, interval)
        if free:
            reached = max(reached, end * (1.0 - SUM_ROUNDING))
        if halvings > 0 or (not free and stride == 1):
            # Within the last step: between the part of it that is proved and the least that failed.
            if free:
                proved = part
            else:
                failed = part
            if halvings == HALVINGS:
                break
            halvings += 1
            part = 0.5 * (proved + failed)
        elif free:
            # Go on from there: half-way to the node that failed, or with twice the stride.
            first = last
            if first < failing <= nodes:
                stride = max(1, (failing - first) // 2)
            else:
                stride *= 2
                failing = nodes + 1
        else:
            # Try again with half the stride.
            failing = last
            stride //= 2
    return reached
