"""Computes why contact limits forbid a contact, in figures for people, after the verdict.

The stop decision asks whether a link is harmless before it can touch. Where it is not, this says of
the first sphere that fails by how much: how fast it could be when contact is possible first, or how
far it could still go on where it can clamp the part.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from armguard.bounds.surface_speed import find_harmless_node, set_joints, speed_from
from armguard.bounds.table_time import is_free_until
from armguard.jit.kernels import kernel
from armguard.obstacles.partners import NO_PARTNER
from armguard.obstacles.possible_states import possible_states
from armguard.obstacles.regions import ContactLimit
from armguard.pairs.clamping import (
    find_clamp,
    find_near_obstacles,
    find_short_way_node,
    is_obstacle_near,
)
from armguard.pairs.contact_time import (
    TOUCHES,
    StatePlace,
    contact_distance,
    hull_of,
    limit_of,
    moves_of,
    own_place,
    partner_of,
    partner_place,
    rests_in_time,
)
from armguard.pairs.scene import Scene, sphere_of

PERMITTED, NEVER, TOO_FAST, CLAMPED = range(4)
"""Answers of `find_forbidden`: nothing is forbidden; the obstacle may never be touched; the link
could be too fast; it could press the obstacle too far."""

NOBODY = -1
"""In place of a row, where none is meant."""

MANY = 1_000_000
"""Evaluations that one link never takes."""

MOST_WAY = 64.0
"""How many times the way that is permitted a way is looked for."""

WAY_STEPS = 9
"""Steps in which it is found, to about 1 %."""


class Forbidden(NamedTuple):
    """Why a contact is forbidden."""

    why: int
    """NEVER, TOO_FAST or CLAMPED; PERMITTED where it is not."""
    link: int
    """The link that could touch."""
    figure: float
    """TOO_FAST: bound on the speed of the surface at the contact, in [m]/[s]. CLAMPED: bound on how
    far it could go on then, in [m]; inf where that is more than `MOST_WAY` times the limit."""
    against: int
    """CLAMPED: row of an obstacle that the part can be pressed against; NOBODY where it is the arm
    itself, or more than can be listed."""


@kernel
def _find_contact_node(scene: Scene, node: int, state: StatePlace) -> int:
    """The last node of the braking table before which a sphere surely does not touch a body."""
    bodies = scene.refused if state.is_refused else scene.bodies
    hull, distance = (
        hull_of(bodies, state.place, state.age), contact_distance(scene, node, bodies, state)
    )  # fmt: skip
    sphere, table = sphere_of(scene, node), scene.braking
    # Invariant: it is free until `free`, and not known to be until `met`.
    free, met = 0, table.time.shape[0] - 1
    while met - free > 1:
        middle = (free + met) // 2
        if is_free_until(sphere, table, hull, distance, middle):
            free = middle
        else:
            met = middle
    return free


@kernel
def _explain_sphere(
    scene: Scene, link: int, node: int, row: int, touch: int, limit: ContactLimit, now: float
) -> Forbidden:
    """Why a sphere is not harmless from a node of the braking table on."""
    if not limit.max_speed > 0.0:
        return Forbidden(NEVER, link, 0.0, NOBODY)
    sphere, table = sphere_of(scene, node), scene.braking
    radius, moves = scene.tree.radius[node], moves_of(scene, node)
    harmless, _ = find_harmless_node(sphere, radius, moves, table, limit.max_speed)
    if harmless > touch:
        count = set_joints(sphere, moves, table.box)
        speed = speed_from(radius, count, table, touch, np.inf) if count >= 0 else np.inf
        return Forbidden(TOO_FAST, link, speed, NOBODY)
    last = table.time.shape[0] - 1
    near_count = find_near_obstacles(scene, link, row, table, last, now, limit)
    clamp = find_clamp(scene, node, table, last, now, near_count, limit)
    closing = scene.clamp_room.closing
    # Invariant: the way left is at most `way`, if that is known at all, and more than `less`.
    less, way = limit.max_way, np.inf
    if limit.max_way > 0.0:
        trial = MOST_WAY * limit.max_way
        for _ in range(WAY_STEPS):
            if find_short_way_node(sphere, radius, moves, table, closing, clamp, trial) <= touch:
                way = trial
            else:
                less = trial
            if way == np.inf:
                break
            trial = np.sqrt(less * way)
    against = NOBODY
    listed = min(near_count, scene.clamp_room.near.shape[0])
    for k in range(listed if clamp.by_obstacle else 0):
        other = scene.clamp_room.near[k]
        states = scene.bodies if scene.marks.static[other] else scene.references
        reach = radius + limit.gap + scene.settings.margin
        for j in range(moves.shape[0]):
            size = table.box.span[2, j] + table.box.position_error[j]
            reach += scene.arm.lever[node, j] * size
        is_near, _ = is_obstacle_near(
            scene.arm.centers[node], reach, states, scene.marks, other, now, table.time[last]
        )
        if is_near:
            against = other
            break
    return Forbidden(CLAMPED, link, way, against)


@kernel
def find_forbidden(handle: Any, first: int, row: int, watched: Any, now: float) -> Forbidden:
    """Why a contact of an obstacle with an arm that brakes is forbidden; as `rests_in_time` asks.

    Args:
        handle: On the tick's `Scene`, its arm prepared and its table of braking filled.
        first: The link that is asked first.
        row: Of the obstacle. Where its whereabouts are unknown there is nothing to say.
        watched: Which links are watched against it. Shape (links,).
        now: Time of the tick on the obstacles' clock, in [s].
    """
    scene = handle.content
    marks, links = scene.marks, scene.tree.root.shape[0]
    for number in range(links):
        link = (first + number) % links
        if not watched[link]:
            continue
        answer, _, _, node = rests_in_time(handle, link, row, now, MANY)
        if answer != TOUCHES or node < 0:
            continue
        touch = last = scene.braking.time.shape[0] - 1
        for k in possible_states(marks, row):
            touch = min(touch, _find_contact_node(scene, node, own_place(scene, row, k, now)))
        partner = partner_of(scene, row, now, scene.braking.time[last])
        if partner.row != NO_PARTNER:
            # It is where both say.
            by_partner = _find_contact_node(scene, node, partner_place(scene, partner, now))
            touch = max(touch, by_partner)
        return _explain_sphere(scene, link, node, row, touch, limit_of(scene, row), now)
    return Forbidden(PERMITTED, first, 0.0, NOBODY)
