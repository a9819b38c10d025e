"""Finds where a link can clamp a body part: near anything that the link can approach.

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

Whatever is uncertain counts as near. How a gap between two links closes, `closing` bounds joint by
joint. What is pressed may slip from one link to another, so what counts in each step is the gap
that closes most in it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from armguard.bounds.closing import fill_arms, find_approach
from armguard.bounds.free_body import free_displacement, length_above, top_speed
from armguard.bounds.joint_box import JointBox
from armguard.bounds.joint_table import JointTable, set_span
from armguard.bounds.surface_speed import set_joints, way_from
from armguard.bounds.table_time import ArmSphere
from armguard.contact.gjk import distance_to_hull
from armguard.jit.arrays import BoolArray, FloatArray
from armguard.jit.kernels import kernel
from armguard.jit.numerics import SUM_ROUNDING
from armguard.obstacles.regions import NO_REGION, ContactLimit
from armguard.obstacles.table import Marks, States
from armguard.pairs.scene import Scene, sphere_of


class Clamp(NamedTuple):
    """What a sphere of the arm can clamp a body part against."""

    links: int
    """Against so many parts of other links; `ClampRoom.closing` says how gaps close."""
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
def _find_most(scene: Scene, box: JointBox) -> float:
    """By how much any two spheres of the arm come nearer at most in a box, in [m]."""
    weight, most = scene.link_gaps.weight, 0.0
    for j in range(weight.shape[0]):
        most += weight[j] * (box.span[2, j] + box.position_error[j])
    return most * (1.0 + SUM_ROUNDING)


@kernel
def _count_parts(scene: Scene) -> int:
    """How many spheres stand for links, and balls for the base."""
    count: int = scene.link_gaps.parts.shape[0] + scene.link_gaps.base.shape[0]
    return count


@kernel
def _find_part(scene: Scene, sphere: ArmSphere, c: int) -> tuple[ArmSphere, float, BoolArray]:
    """A sphere that stands for a link, or after those a ball for the base; its radius; what moves.

    The base has no levers, nor are any asked for: no joint moves it.
    """
    placement, gaps = scene.placement, scene.link_gaps
    parts = gaps.parts.shape[0]
    if c < parts:
        part = gaps.parts[c]
        moves = placement.moves[placement.joint[part]]
        return sphere_of(scene, part), scene.tree.radius[part], moves
    ball = gaps.base[c - parts]
    place = ball[0], ball[1], ball[2]
    base = ArmSphere(*place, sphere.jacobian, sphere.lever, sphere.slope_error)
    return base, ball[3], placement.moves[0]


@kernel
def _find_room(sphere: ArmSphere, other: ArmSphere, reach: float) -> float:
    """How much farther than so far two centres are apart, in [m], rounded down."""
    dx, dy, dz = other.x - sphere.x, other.y - sphere.y, other.z - sphere.z
    distance = math.sqrt(dx * dx + dy * dy + dz * dz) * (1.0 - SUM_ROUNDING)
    room: float = distance - reach
    return room - SUM_ROUNDING * (abs(sphere.x) + abs(sphere.y) + abs(sphere.z))


@kernel
def _is_part_near(
    scene: Scene, sphere: ArmSphere, node: int, c: int, table: JointTable, most: float, gap: float
) -> bool:
    """Whether what stands for a link or the base can come near a sphere.

    Then `clamp_room.pair` is filled.

    Args:
        scene: The tick.
        sphere: The sphere.
        node: Its number.
        c: Which of the parts, and after them of the base's balls.
        table: Where joints can be.
        most: By how much any two spheres come nearer there, in [m].
        gap: How near is near, in [m].
    """
    placement, pair, radius = scene.placement, scene.clamp_room.pair, scene.tree.radius[node]
    other, other_radius, theirs = _find_part(scene, sphere, c)
    room = _find_room(sphere, other, radius + other_radius + gap)
    if room > most:
        return False
    mine, box = placement.moves[placement.joint[node]], table.box
    # Most that are left are away by levers already, which are there.
    closes = 0.0
    for j in range(mine.shape[0]):
        if mine[j] != theirs[j]:
            arm = sphere.lever[j] if mine[j] else other.lever[j]
            if box.turning[j]:
                arm += radius if mine[j] else other_radius
            closes += arm * (box.span[2, j] + box.position_error[j])
    if room > closes * (1.0 + SUM_ROUNDING):
        return False
    fill_arms(sphere, radius, mine, other, other_radius, theirs, box, pair)
    return not room > find_approach(pair, table.box)


@kernel
def _may_clamp(scene: Scene, node: int, c: int, limit: ContactLimit) -> bool:
    """Whether the distance of a sphere from a part, or from the base, can vary by enough."""
    gaps = scene.link_gaps
    if c >= gaps.parts.shape[0]:
        return True
    varies: bool = gaps.variation[node, c] > limit.thickness
    return varies


@kernel
def can_links_clamp(
    scene: Scene, node: int, table: JointTable, last: int, limit: ContactLimit
) -> bool:
    """Whether a sphere can clamp a body part against another link, until a node's time.

    Arguments as for `find_clamp`.
    """
    gap, radius = limit.gap + scene.settings.margin, scene.tree.radius[node]
    sphere, count = sphere_of(scene, node), _count_parts(scene)
    # Most links have another one near now, and the same as before.
    nearest = scene.clamp_room.nearest
    for k in range(count):
        c = (nearest[node] + k) % count
        other, other_radius, _ = _find_part(scene, sphere, c)
        room = _find_room(sphere, other, radius + other_radius + gap)
        if not room > 0.0 and _may_clamp(scene, node, c, limit):
            nearest[node] = c
            return True
    set_span(table, 0, last, 1.0)
    most = _find_most(scene, table.box)
    for c in range(count):
        if _may_clamp(scene, node, c, limit) and _is_part_near(
            scene, sphere, node, c, table, most, gap
        ):
            return True
    return False


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

    `clamp_room.closing` is filled with how gaps between links close.

    Args:
        scene: The tick.
        node: The sphere.
        table: Where joints can be.
        last: Number of the node until whose time it is asked, above 0.
        now: Time of the tick on the obstacles' clock, in [s].
        near_count: What `find_near_obstacles` returned, whose list is read.
        limit: Of the part: how near is near, and how thick it is.
    """
    tree, gaps, room = scene.tree, scene.link_gaps, scene.clamp_room
    marks, gap = scene.marks, limit.gap + scene.settings.margin
    set_span(table, 0, last, 1.0)
    sphere, most = sphere_of(scene, node), _find_most(scene, table.box)
    count = 0
    for c in range(_count_parts(scene)):
        if _may_clamp(scene, node, c, limit) and _is_part_near(
            scene, sphere, node, c, table, most, gap
        ):
            for j in range(gaps.weight.shape[0]):
                room.closing[count, 0, j] = room.pair.forth[j]
                room.closing[count, 1, j] = room.pair.back[j]
            count += 1
    if near_count > room.near.shape[0]:
        return Clamp(count, True, np.inf)
    by_obstacle, fastest = False, 0.0
    center = scene.arm.centers[node]
    reach = tree.radius[node] + gap + _reach(scene.arm.lever, node, table)
    for k in range(near_count):
        other = room.near[k]
        states = scene.bodies if marks.static[other] else scene.references
        is_near, speed = is_obstacle_near(
            center, reach, states, marks, other, now, table.time[last]
        )
        if is_near:
            by_obstacle = True
            fastest = max(fastest, speed)
    return Clamp(count, by_obstacle, fastest)


@kernel
def _find_closed_node(table: JointTable, closing: FloatArray, count: int, max_way: float) -> int:
    """From which node on gaps between links close by no more than a way until the arm rests."""
    way, node = 0.0, table.time.shape[0] - 1
    while node > 0:
        duration = (table.time[node] - table.time[node - 1]) * (1.0 + SUM_ROUNDING)
        most = 0.0
        for c in range(count):
            rate = 0.0
            for j in range(table.box.turning.shape[0]):
                forth, back = closing[c, 0, j], closing[c, 1, j]
                # What closes nothing may be as fast as it likes.
                if forth > 0.0:
                    forth *= table.fastest[node - 1, j]
                if back > 0.0:
                    back *= -table.slowest[node - 1, j]
                # The greater of both; no number where either is none.
                rate += 0.5 * (forth + back + abs(forth - back))
            if not rate <= most:
                most = rate
        way += most * duration
        if not way <= max_way:
            break
        node -= 1
    return node


@kernel
def find_short_way_node(
    sphere: ArmSphere,
    radius: float,
    moves: BoolArray,
    table: JointTable,
    closing: FloatArray,
    clamp: Clamp,
    max_way: float,
) -> int:
    """From which node of a braking table on a sphere presses a clamped part no farther than a way.

    Args:
        sphere: Of the arm.
        radius: Its radius, in [m].
        moves: Which joints move it. Shape (nv,).
        table: Of an arm that brakes until it rests, with velocities.
        closing: That of the room that `find_clamp` filled.
        clamp: What that returned.
        max_way: The way, in [m].
    """
    last = table.time.shape[0] - 1
    count = set_joints(sphere, moves, table.box)
    if not (count >= 0 and max_way > 0.0):
        return last
    first = _find_closed_node(table, closing, clamp.links, max_way)
    if not clamp.by_obstacle:
        return first
    sooner, later = first - 1, last
    # Invariant: the way is short enough from `later` on, and not known to be from `sooner` on.
    while later - sooner > 1:
        middle = (sooner + later) // 2
        way = way_from(radius, count, table, middle)
        way += clamp.obstacle_speed * (table.time[last] - table.time[middle])
        if way <= max_way:
            later = middle
        else:
            sooner = middle
    return later
