"""Where a link can clamp a part of a body: near to anything else that its distance from can fall.

A body part that gives way takes up no more than what its own mass brings (`surface_speed`). One
that is clamped cannot give way: it is pressed until the arm rests, with a force of its stiffness
times the way that is left. So wherever a link can get closer than a gap to something that is not of
the same person, contact is permitted only once the way left is short enough.

What a link can clamp a part against:

- Another obstacle. What moves by itself goes on until the arm rests, so its way adds up.
- Another link of the arm, as far as joints between the two can move. Of two links that share a
  joint those spheres count whose distance can vary by more than the part is thick, as in an elbow
  that folds.
- What of the arm no joint moves, its base: balls stand for that.

Whatever is uncertain counts as near. The way between two links is bounded by levers: their distance
depends on the joints between them alone, and by a radian of one of these it changes by no more than
a point of the link that this joint moves can be away from its axis.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from armguard.bounds.free_body import free_displacement, length_above, top_speed
from armguard.bounds.joint_table import JointTable, set_span
from armguard.bounds.link_gaps import find_closing_lever
from armguard.bounds.surface_speed import set_joints, way_from
from armguard.bounds.table_time import ArmSphere
from armguard.contact.gjk import distance_to_hull
from armguard.jit.arrays import BoolArray, FloatArray
from armguard.jit.kernels import kernel
from armguard.jit.numerics import SUM_ROUNDING
from armguard.obstacles.regions import NO_REGION, ContactLimit
from armguard.obstacles.table import Marks, States
from armguard.pairs.scene import Scene


class Clamp(NamedTuple):
    """What a sphere of the arm can clamp a body part against."""

    by_link: bool
    """Whether against another link; `ClampRoom.weight` says how the gap closes."""
    by_obstacle: bool
    """Whether against an obstacle."""
    obstacle_speed: float
    """How fast that goes at most, in [m/s]."""


@kernel
def is_same_person(marks: Marks, row: int, other: int) -> bool:
    """Whether two obstacles are parts of one person: both have regions, and are named alike."""
    for one in (row, other):
        regions = marks.regions[one]
        if regions == 0 or (regions & NO_REGION) != 0:
            return False
    same: bool = marks.person[row] == marks.person[other]
    return same


@kernel
def _reach(lever: FloatArray, node: int, table: JointTable) -> float:
    """How far from its measured place a sphere's centre can get in the table's span, in [m]."""
    reach = 0.0
    for j in range(lever.shape[1]):
        reach += lever[node, j] * (table.box.span[2, j] + table.box.position_error[j])
    return reach * (1.0 + SUM_ROUNDING)


@kernel
def is_obstacle_near(
    center: FloatArray,
    reach: float,
    bodies: States,
    marks: Marks,
    other: int,
    now: float,
    until: float,
) -> tuple[bool, float]:
    """Whether an obstacle can be within reach of a place until then, and how fast it may be."""
    count = bodies.point_count[other]
    known = marks.has_state[other] and not marks.refused[other] and count > 0
    if not known:
        return True, np.inf
    age = 0.0 if marks.static[other] else now - bodies.stamp[other]
    distance, _, _, _ = distance_to_hull(
        center[0], center[1], center[2], bodies.points[other], bodies.velocities[other], count
    )
    pace, error = 0.0, bodies.velocity_error[other]
    for k in range(count):
        velocity = bodies.velocities[other, k]
        pace = max(pace, length_above(velocity[0], velocity[1], velocity[2]))
    top = top_speed(pace, bodies.speed[other], error)
    # A stamp may be later than the tick; the body may have come from any side then. The way is no
    # number without any bound, and nothing is away by that.
    moved = free_displacement(pace + error, bodies.accel[other], top, abs(age) + abs(until))
    reach += bodies.radius[other] + bodies.position_error[other] + moved
    is_away = distance > reach + SUM_ROUNDING * (
        abs(center[0]) + abs(center[1]) + abs(center[2]) + reach + distance
    )
    return not is_away, top


@kernel
def find_near_obstacles(
    scene: Scene,
    link: int,
    row: int,
    table: JointTable,
    last: int,
    now: float,
    limit: ContactLimit,
) -> int:
    """List the obstacles that a link can clamp a row against, until a node's time; how many.

    `clamp_room.near` is filled with them. More than fit in are counted, but not filled in.

    Args:
        scene: The tick.
        link: Of the arm.
        row: The one that may be touched.
        table: Where joints can be.
        last: Number of the node until whose time it is asked, above 0.
        now: Time of the tick on the obstacles' clock, in [s].
        limit: Of the row: how near is near.
    """
    tree, marks, near = scene.tree, scene.marks, scene.clamp_room.near
    node = tree.root[link]
    center = scene.arm.centers[node]
    set_span(table, 0, last, 1.0)
    gap = limit.gap + scene.settings.margin
    reach = tree.radius[node] + gap + _reach(scene.arm.lever, node, table)
    count = 0
    for other in range(marks.alive.shape[0]):
        if not marks.alive[other] or other == row or is_same_person(marks, row, other):
            continue
        # One that stands still is where it is: it has no reference state while nobody watches it.
        states = scene.bodies if marks.static[other] else scene.references
        is_near, _ = is_obstacle_near(center, reach, states, marks, other, now, table.time[last])
        if is_near:
            if count < near.shape[0]:
                near[count] = other
            count += 1
    return count


@kernel
def find_clamp(
    scene: Scene,
    node: int,
    table: JointTable,
    last: int,
    now: float,
    near_count: int,
    limit: ContactLimit,
) -> Clamp:
    """What a sphere of the arm can clamp a body part against, until a node's time.

    `clamp_room.weight` says how a gap between links closes.

    Args:
        scene: The tick.
        node: The sphere.
        table: Where joints can be.
        last: Number of the node until whose time it is asked, above 0.
        now: Time of the tick on the obstacles' clock, in [s].
        near_count: What `find_near_obstacles` returned, whose list is read.
        limit: Of the part: how near is near, and how thick it is.
    """
    placement, tree, gaps, room = scene.placement, scene.tree, scene.link_gaps, scene.clamp_room
    lever, marks, gap = scene.arm.lever, scene.marks, limit.gap + scene.settings.margin
    centers, weight = placement.centers, room.weight
    set_span(table, 0, last, 1.0)
    size = table.box.span[2]
    x, y, z = centers[node, 0], centers[node, 1], centers[node, 2]
    joints = weight.shape[0]
    weight[:] = 0.0
    by_link = False
    mine = placement.moves[placement.joint[node]]
    for c in range(gaps.parts.shape[0]):
        if gaps.variation[node, c] <= limit.thickness:
            continue
        part = gaps.parts[c]
        theirs = placement.moves[placement.joint[part]]
        closes = 0.0
        for j in range(joints):
            if mine[j] != theirs[j]:
                one = node if mine[j] else part
                closes += (
                    find_closing_lever(lever, tree.radius, table.box.turning, one, j) * size[j]
                )
        dx, dy, dz = x - centers[part, 0], y - centers[part, 1], z - centers[part, 2]
        distance = np.sqrt(dx * dx + dy * dy + dz * dz)
        reach = tree.radius[node] + tree.radius[part] + gap + closes
        for j in range(joints):
            reach += (lever[node, j] + lever[part, j]) * table.box.position_error[j]
        if distance > reach * (1.0 + SUM_ROUNDING) + SUM_ROUNDING * (abs(x) + abs(y) + abs(z)):
            continue
        by_link = True
        for j in range(joints):
            if mine[j] != theirs[j]:
                one = node if mine[j] else part
                arm = find_closing_lever(lever, tree.radius, table.box.turning, one, j)
                weight[j] = max(weight[j], arm)
    closes = 0.0
    for j in range(joints):
        if mine[j]:
            arm = find_closing_lever(lever, tree.radius, table.box.turning, node, j)
            closes += arm * size[j] + lever[node, j] * table.box.position_error[j]
    for c in range(gaps.base.shape[0]):
        ball = gaps.base[c]
        dx, dy, dz = x - ball[0], y - ball[1], z - ball[2]
        distance = np.sqrt(dx * dx + dy * dy + dz * dz)
        reach = tree.radius[node] + ball[3] + gap + closes
        if distance > reach * (1.0 + SUM_ROUNDING) + SUM_ROUNDING * (abs(x) + abs(y) + abs(z)):
            continue
        by_link = True
        for j in range(joints):
            if mine[j]:
                arm = find_closing_lever(lever, tree.radius, table.box.turning, node, j)
                weight[j] = max(weight[j], arm)
        break  # it closes in on all of the base alike
    if near_count > room.near.shape[0]:
        return Clamp(by_link, True, np.inf)
    by_obstacle, fastest = False, 0.0
    reach = tree.radius[node] + gap + _reach(lever, node, table)
    for k in range(near_count):
        other = room.near[k]
        states = scene.bodies if marks.static[other] else scene.references
        is_near, speed = is_obstacle_near(
            centers[node], reach, states, marks, other, now, table.time[last]
        )
        if is_near:
            by_obstacle = True
            fastest = max(fastest, speed)
    return Clamp(by_link, by_obstacle, fastest)


@kernel
def _closing_way(table: JointTable, weight: FloatArray, node: int) -> float:
    """By how much the gaps between links can still close from a node's time on, in [m]."""
    last = table.time.shape[0] - 1
    way = 0.0
    for j in range(weight.shape[0]):
        if not weight[j] > 0.0:
            continue
        travel = 0.0
        for k in range(node, last):
            pace = max(table.fastest[k, j], -table.slowest[k, j])
            travel += pace * (table.time[k + 1] - table.time[k])
        way += weight[j] * travel
    return way * (1.0 + SUM_ROUNDING)


@kernel
def find_short_way_node(
    sphere: ArmSphere,
    radius: float,
    moves: BoolArray,
    table: JointTable,
    weight: FloatArray,
    clamp: Clamp,
    max_way: float,
) -> int:
    """From which node of a braking table on a sphere presses a clamped part no farther than a way.

    Args:
        sphere: Of the arm.
        radius: Its radius, in [m].
        moves: Which joints move it. Shape (nv,).
        table: Of an arm that brakes until it rests, with velocities.
        weight: That of the room that `find_clamp` wrote. Shape (nv,).
        clamp: What that returned.
        max_way: The way, in [m].
    """
    last = table.time.shape[0] - 1
    count = set_joints(sphere, moves, table.box)
    if not (count >= 0 and max_way > 0.0):
        return last
    sooner, later = -1, last
    # Invariant: the way is short enough from `later` on, and not known to be from `sooner` on.
    while later - sooner > 1:
        middle = (sooner + later) // 2
        is_short = True
        if clamp.by_link:
            is_short = _closing_way(table, weight, middle) <= max_way
        if is_short and clamp.by_obstacle:
            way = way_from(radius, count, table, middle)
            way += clamp.obstacle_speed * (table.time[last] - table.time[middle])
            is_short = way <= max_way
        if is_short:
            later = middle
        else:
            sooner = middle
    return later
