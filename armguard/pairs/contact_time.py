"""Contact time of one link and one obstacle: descends the link's sphere tree, bound by bound.

Each bound on the arm's motion is a proof by itself, so the latest of their times stands, and they
are tried from the cheapest to the dearest: what the link cannot leave, its spheres as free bodies,
its joints within their limits. A node's bound holds for everything that it owns. Its children are
opened only while their times could matter to the verdict, and what is later than the soonest
sphere found so far is not refined.

What is called once a pair takes the handle of a scene: to hand over its arrays themselves, a
hundred of them, takes longer than most evaluations.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from armguard.bounds.surface_speed import find_harmless_node, harmless_time
from armguard.bounds.table_time import (
    is_free_at_once,
    is_free_until,
    table_contact_time,
)
from armguard.contact.advancement import row_contact_time
from armguard.contact.bodies import Ball, Bounds, Hull
from armguard.jit.arrays import BoolArray
from armguard.jit.kernels import kernel, separate_kernel
from armguard.jit.numerics import SUM_ROUNDING, TERM_ROUNDING
from armguard.obstacles.partners import ALONE, NO_PARTNER, Partner, find_partner
from armguard.obstacles.possible_states import is_known, possible_states, state_at
from armguard.obstacles.regions import ContactLimit, strictest_limit
from armguard.obstacles.table import States
from armguard.obstacles.tethers import TIED
from armguard.pairs.clamping import (
    can_links_clamp,
    find_clamp,
    find_near_obstacles,
    find_short_way_node,
)
from armguard.pairs.scene import ADVANCES, ISOTROPIC, JOINT, REACH, Scene, sphere_of

REACH_ADVANCES = 2
"""Steps of conservative advancement against what stands still: the second is nearly always last."""


@kernel
def bounds_of(bodies: States, row: int, age: float) -> Bounds:
    """What holds a body back; its age in [s]."""
    return Bounds(bodies.accel[row], bodies.speed[row], bodies.velocity_error[row], age)


@kernel
def hull_of(bodies: States, row: int, age: float) -> Hull:
    """A body with what holds it back; its age in [s]."""
    bounds = bounds_of(bodies, row, age)
    return Hull(bodies.points[row], bodies.velocities[row], bodies.point_count[row], bounds)


class StatePlace(NamedTuple):
    """Which state of a body is meant."""

    place: int
    """Where it stands among those."""
    is_refused: bool
    """Whether it is among the refused states; else the accepted ones."""
    age: float
    """Of the state, in [s]."""
    radius: float
    """Around its hull, in [m]: its own, or that within which what is tethered to it is."""


@kernel
def own_place(scene: Scene, row: int, number: int, now: float) -> StatePlace:
    """One of an obstacle's own states that may be true, by its number; see `possible_states`."""
    bodies, place, age = state_at(scene.bodies, scene.refused, scene.marks, row, number, now)
    return StatePlace(place, number > 0, age, bodies.radius[place])


@kernel
def partner_of(scene: Scene, row: int, now: float, horizon: float) -> Partner:
    """By whose state an obstacle is judged beside its own, in the `horizon` [s] to come."""
    if scene.tethers.numbers[TIED] == 0:
        # Else all these arrays would be handed over for nothing.
        return ALONE
    return find_partner(
        scene.tethers, scene.bodies, scene.refused, scene.marks, scene.contact_limits,
        row, now, horizon, scene.arm.arm_ball,
    )  # fmt: skip


@kernel
def partner_place(scene: Scene, partner: Partner, now: float) -> StatePlace:
    """A partner's state, with the radius within which what is tethered to it is."""
    row = max(partner.row, 0)
    return StatePlace(row, bool(0), now - scene.bodies.stamp[row], partner.radius)


@kernel
def reach_time(
    x: float, y: float, z: float, radius: float, bodies: States, state: StatePlace, margin: float
) -> float:
    """Contact time of a body and a ball that stands still for ever."""
    row, age = state.place, state.age
    distance = (radius + state.radius + margin + bodies.position_error[row]) * (1.0 + TERM_ROUNDING)
    time: float = row_contact_time(
        Ball(x, y, z, 0.0, 0.0, 0.0, Bounds(0.0, 0.0, 0.0, 0.0)),
        bodies.points, bodies.velocities, row, bodies.point_count[row],
        bounds_of(bodies, row, age), distance, np.int64(REACH_ADVANCES), None,
    )  # fmt: skip
    return time if time >= 0.0 else 0.0


@kernel
def contact_distance(scene: Scene, node: int, bodies: States, state: StatePlace) -> float:
    """Distance of a sphere's centre and a body's hull that counts as contact, errors included."""
    reach: float = scene.tree.radius[node] + state.radius + scene.settings.margin
    reach += scene.arm.position_error[node] + bodies.position_error[state.place]
    return reach * (1.0 + TERM_ROUNDING)


@kernel
def _free_time(
    scene: Scene, node: int, bodies: States, row: int, arm_age: float, age: float, distance: float
) -> float:
    """Contact time of a sphere as a free body."""
    arm = scene.arm
    sphere = Ball(
        arm.centers[node, 0], arm.centers[node, 1], arm.centers[node, 2],
        arm.velocities[node, 0], arm.velocities[node, 1], arm.velocities[node, 2],
        Bounds(arm.accel[node], arm.speed[node], arm.velocity_error[node], arm_age),
    )  # fmt: skip
    time: float = row_contact_time(
        sphere, bodies.points, bodies.velocities, row, bodies.point_count[row],
        bounds_of(bodies, row, age), distance, ADVANCES, None,
    )  # fmt: skip
    return time if time >= 0.0 else 0.0


@separate_kernel
def link_time(
    handle: Any,
    link: int,
    state: StatePlace,
    arm_age: float,
    lower_bound: float,
    lower_bound_kind: int,
    refinement_threshold: float,
    cut_off: float,
) -> tuple[float, int, int, int]:
    """Earliest contact of one link and one body, whose `root_time` is known.

    Args:
        handle: On the tick's `Scene`.
        link: Of the arm.
        state: Of the body.
        arm_age: Age of the joint state, in [s].
        lower_bound: What is known of the whole link already, in [s]: its `root_time`, or later.
        lower_bound_kind: What that rests on.
        refinement_threshold: Nodes that could be touched before this, in [s], are refined.
        cut_off: What is later than this, in [s], need not be known any better.

    Returns:
        Contact time in [s], the sphere that decided, what its time rests on, and evaluations.
    """
    scene = handle.content
    tree, settings = scene.tree, scene.settings
    row, is_refused, age, _ = state
    bodies = scene.refused if is_refused else scene.bodies
    node_time, node_bound = scene.node_time, scene.node_bound
    best = np.inf
    best_node = node = tree.root[link]
    best_bound = lower_bound_kind
    evaluations = 0
    # Depth first, without a stack: `first_child` goes down, `skip` on to what is not below a node.
    # Invariant: what the nodes passed so far own is not touched before `best`.
    while node >= 0:
        # The parent's bound holds for all that this node owns, so the later of the two stands.
        parent = tree.parent[node]
        time = lower_bound if parent < 0 else node_time[parent]
        bound = lower_bound_kind if parent < 0 else node_bound[parent]
        limit = min(best, cut_off)
        distance = contact_distance(scene, node, bodies, state)
        # The sphere as a free body: cheap, and enough for most nodes. The root's is known.
        if parent >= 0:
            free = _free_time(scene, node, bodies, row, arm_age, age, distance)
            evaluations += 1
            if not time >= free:
                time, bound = free, ISOTROPIC
        # Joints within their limits: dearer, and only where the time could still decide.
        if settings.with_joints and time < limit:
            hull = hull_of(bodies, row, age)
            slower = table_contact_time(
                sphere_of(scene, node), scene.table, hull, distance, time, limit
            )
            evaluations += 1
            if slower > time:
                time, bound = slower, JOINT
        node_time[node] = time
        node_bound[node] = bound
        scene.sphere_time[node] = min(scene.sphere_time[node], time)
        # Refine a node that matters and has children; else its time stands for all that it owns.
        if tree.first_child[node] >= 0 and time < refinement_threshold and time < limit:
            node = tree.first_child[node]
            continue
        if time < best:
            best, best_node, best_bound = time, node, bound
        node = tree.skip[node]
    return best, best_node, best_bound, evaluations


@kernel
def link_reach_time(scene: Scene, link: int, state: StatePlace, lower_bound: float) -> float:
    """Time before which a body cannot be where a link can be, in [s].

    Args:
        scene: The tick.
        link: Of the arm.
        state: Of the body.
        lower_bound: What the arm's reach says of all links, in [s].
    """
    bodies = scene.refused if state.is_refused else scene.bodies
    ball = scene.arm.link_balls[link]
    time = reach_time(ball[0], ball[1], ball[2], ball[3], bodies, state, scene.settings.margin)
    return max(lower_bound, time)


@kernel
def root_time(
    scene: Scene, link: int, state: StatePlace, arm_age: float, lower_bound: float
) -> tuple[float, int]:
    """What the sphere around a whole link says of it and a body: one evaluation.

    Args:
        scene: The tick.
        link: Of the arm.
        state: Of the body.
        arm_age: Age of the joint state, in [s].
        lower_bound: What reach says of the link, in [s].

    Returns:
        Contact time in [s], and what it rests on.
    """
    place, is_refused, age, _ = state
    bodies = scene.refused if is_refused else scene.bodies
    node = scene.tree.root[link]
    distance = contact_distance(scene, node, bodies, state)
    free = _free_time(scene, node, bodies, place, arm_age, age, distance)
    time, bound = lower_bound, REACH
    if not time >= free:
        time, bound = free, ISOTROPIC
    return time, bound


@kernel
def state_time(
    handle: Any,
    link: int,
    state: StatePlace,
    arm_age: float,
    lower_bound: float,
    lower_bound_kind: int,
    refinement_threshold: float,
    cut_off: float,
) -> tuple[float, int, int, int]:
    """Earliest contact of one link and one body; arguments and results as of `link_time`.

    `lower_bound` is what is known of all links already, or of the link itself.
    """
    scene = handle.content
    # Of one type wherever it comes from: each other one would be compiled for.
    bound: Any = np.int64(lower_bound_kind)
    node, evaluations = scene.tree.root[link], 1
    time = link_reach_time(scene, link, state, lower_bound)
    if time > lower_bound:
        bound = np.int64(REACH)
    if time < refinement_threshold and time < cut_off:
        known = time
        time, found = root_time(scene, link, state, arm_age, known)
        evaluations += 1
        if time > known:
            bound = np.int64(found)
    if time < refinement_threshold and time < cut_off:
        time, node, bound, spent = link_time(
            handle, link, state, arm_age, time, bound, refinement_threshold, cut_off
        )
        evaluations += spent
    return time, node, bound, evaluations


@kernel
def pair_time(
    handle: Any,
    link: int,
    row: int,
    now: float,
    arm_age: float,
    lower_bound: float,
    refinement_threshold: float,
    cut_off: float,
) -> tuple[float, int, int, int]:
    """Earliest contact of one link and one obstacle, whichever of its states is true.

    Where it is tethered, that is the later one of this and of what its partner's state says.

    Args:
        handle: On the tick's `Scene`.
        link: Of the arm.
        row: Of the obstacle, of which something is known; see `possible_states`.
        now: Time of the tick on the obstacles' clock, in [s].
        arm_age: Age of the joint state, in [s].
        lower_bound: What the arm's reach says of all links, in [s].
        refinement_threshold: As for `link_time`.
        cut_off: As for `link_time`.

    Returns:
        As `link_time`.
    """
    scene = handle.content
    best, best_bound, floor_bound = np.inf, REACH, REACH
    best_node, evaluations, floor = scene.tree.root[link], 0, lower_bound
    partner = partner_of(scene, row, now, refinement_threshold)
    if partner.row != NO_PARTNER and floor < refinement_threshold:
        floor, _, floor_bound, evaluations = state_time(
            handle, link, partner_place(scene, partner, now), arm_age, floor, floor_bound,
            refinement_threshold, cut_off,
        )  # fmt: skip
    # Invariant: by the states so far, there is no contact before `best`.
    for number in possible_states(scene.marks, row):
        time, node, bound, spent = state_time(
            handle, link, own_place(scene, row, number, now), arm_age, floor, floor_bound,
            refinement_threshold, cut_off,
        )  # fmt: skip
        evaluations += spent
        if time < best:
            best, best_node, best_bound = time, node, bound
    return best, best_node, best_bound, evaluations


@kernel
def arm_reach_time(scene: Scene, row: int, now: float) -> tuple[float, int]:
    """Time before which an obstacle cannot be where any part of the arm can be; evaluations.

    By its own states; see `partner_reach_time`.
    """
    if not is_known(scene.marks, row):
        return 0.0, 0
    soonest = np.inf
    evaluations = 0
    for number in possible_states(scene.marks, row):
        state = own_place(scene, row, number, now)
        soonest = min(soonest, _state_reach_time(scene, state))
        evaluations += 1
    return soonest, evaluations


@kernel
def partner_reach_time(scene: Scene, partner: Partner, now: float) -> float:
    """The same by the state of a partner that the obstacle is tethered to, in [s]."""
    return _state_reach_time(scene, partner_place(scene, partner, now))


@kernel
def _state_reach_time(scene: Scene, state: StatePlace) -> float:
    bodies = scene.refused if state.is_refused else scene.bodies
    ball = scene.arm.arm_ball
    return reach_time(ball[0], ball[1], ball[2], ball[3], bodies, state, scene.settings.margin)


@kernel
def limit_of(scene: Scene, row: int) -> ContactLimit:
    """What contact with an obstacle is permitted."""
    return strictest_limit(scene.contact_limits, scene.marks.regions[row])


@kernel
def moves_of(scene: Scene, node: int) -> BoolArray:
    """Which joints move a sphere of the arm. Shape (nv,)."""
    placement = scene.placement
    return placement.moves[placement.joint[node]]


@kernel
def find_harm_time(
    scene: Scene, link: int, row: int, now: float, limit: ContactLimit, contact_time: float
) -> float:
    """Before when no contact of a link and an obstacle can do harm, in [s] from the tick.

    A contact that is not permitted comes at the later of two times at the earliest: that of the
    contact, and that from which on the link can be too fast for it.

    By the tick's table of free joints, so the arm must be prepared. Where the link can clamp the
    obstacle it could press it until it rests, so that it ends before. A level that uses this time
    lets the arm rest by then, so what could clamp later does not matter.

    Args:
        scene: The tick.
        link: Of the arm.
        row: Of the obstacle.
        now: Time of the tick on the obstacles' clock, in [s].
        limit: What contact with it is permitted.
        contact_time: Of both, in [s].
    """
    table, node = scene.table, scene.tree.root[link]
    end = table.time.shape[0] - 1
    first = 0
    while first < end and not table.time[first] > contact_time:
        first += 1
    if not table.time[first] > contact_time:
        return contact_time
    # Most links are near others of the arm by then already.
    if can_links_clamp(scene, node, table, first, limit):
        return contact_time
    time: float = harmless_time(
        sphere_of(scene, node), scene.tree.radius[node], moves_of(scene, node), table,
        limit.max_speed,
    )  # fmt: skip
    last = first
    while table.time[last] < time:
        last += 1
    # Half as long each time, until nothing can be near by then, or nothing is gained.
    while table.time[last] > contact_time:
        clamps = can_links_clamp(scene, node, table, last, limit)
        if not clamps and find_near_obstacles(scene, link, row, table, last, now, limit) == 0:
            harmless = min(time, table.time[last] * (1.0 - SUM_ROUNDING))
            return max(contact_time, harmless)
        last //= 2
    return contact_time


RESTS, TOUCHES, UNDECIDED = range(3)
"""Answers of `rests_in_time`."""


@kernel
def _is_sphere_harmless(
    scene: Scene,
    node: int,
    hull: Hull,
    distance: float,
    limit: ContactLimit,
    near_count: int,
    now: float,
) -> tuple[bool, float]:
    """Whether a sphere is harmless for good before a contact, and a bound on its speed then.

    In [m]/[s]. `near_count` is what `find_near_obstacles` found for the link.
    """
    sphere, table = sphere_of(scene, node), scene.braking
    last = table.time.shape[0] - 1
    radius, moves = scene.tree.radius[node], moves_of(scene, node)
    clamp = find_clamp(scene, node, table, last, now, near_count, limit)
    harmless, speed = find_harmless_node(sphere, radius, moves, table, limit.max_speed)
    if clamp.links > 0 or clamp.by_obstacle:
        short = find_short_way_node(
            sphere, radius, moves, table, scene.clamp_room.closing, clamp, limit.max_way
        )
        harmless = max(harmless, short)
    if harmless == 0 or is_free_until(sphere, table, hull, distance, harmless):
        return True, speed
    return False, 0.0


@kernel
def _is_safe(
    scene: Scene,
    node: int,
    link: int,
    row: int,
    state: StatePlace,
    limit: ContactLimit,
    near_count: int,
    now: float,
) -> tuple[bool, float, int]:
    """Whether a sphere rests, or is harmless for good, before it meets a state of an obstacle.

    Args:
        scene: The tick.
        node: The sphere.
        link: Its link.
        row: Of the obstacle.
        state: The obstacle's own, or its partner's.
        limit: What contact with the obstacle is permitted.
        near_count: What `find_near_obstacles` found for the link; below 0: not known yet.
        now: Time of the tick on the obstacles' clock, in [s].

    Returns:
        That; a bound on its speed in a contact, in [m/s]; and `near_count` as it is known now.
    """
    bodies = scene.refused if state.is_refused else scene.bodies
    table = scene.braking
    last = table.time.shape[0] - 1
    hull, distance = (
        hull_of(bodies, state.place, state.age), contact_distance(scene, node, bodies, state)
    )  # fmt: skip
    if not limit.max_speed > 0.0:
        return is_free_until(sphere_of(scene, node), table, hull, distance, last), 0.0, near_count
    # Most spheres are away from the obstacle.
    if is_free_at_once(sphere_of(scene, node), table, hull, distance):
        return True, 0.0, near_count
    # What is dear is asked of the finest ones alone: others clamp nearly always.
    if scene.tree.first_child[node] >= 0:
        return False, 0.0, near_count
    if near_count < 0:
        near_count = find_near_obstacles(scene, link, row, table, last, now, limit)
    is_safe, speed = _is_sphere_harmless(scene, node, hull, distance, limit, near_count, now)
    return is_safe, speed, near_count


@kernel
def rests_in_time(
    handle: Any, link: int, row: int, now: float, budget: int
) -> tuple[int, int, float, int]:
    """Whether a link is proved to be at rest before contact if the arm brakes after the next tick.

    Where contact with the obstacle is permitted, it has to be slow enough for good before contact.
    Descends to the spheres that fail; the scene's table of braking ends when the arm rests. Of what
    is tethered, a sphere is safe that is safe from its partner's state.

    Args:
        handle: On the tick's `Scene`, its arm prepared.
        link: Of the arm.
        row: Of the obstacle.
        now: Time of the tick on the obstacles' clock, in [s].
        budget: Evaluations after which there is no answer.

    Returns:
        RESTS if it does, TOUCHES if it might not, UNDECIDED if the budget did not suffice to know;
        evaluations; the greatest speed of a contact before it rests, in [m]/[s], 0 where there
        is none; and the sphere that might touch, -1 if there is none, or nothing is known of the
        obstacle.
    """
    scene = handle.content
    if not is_known(scene.marks, row):
        return TOUCHES, 0, 0.0, -1
    tree, limit, table = scene.tree, limit_of(scene, row), scene.braking
    evaluations, greatest = 0, 0.0
    partner = partner_of(scene, row, now, table.time[table.time.shape[0] - 1])
    partners_state = partner_place(scene, partner, now)
    for number in possible_states(scene.marks, row):
        state = own_place(scene, row, number, now)
        # Invariant: whatever the nodes passed so far own rests before it is touched, or is
        # harmless from then on.
        node = tree.root[link]
        near_count: Any = np.int64(-1)  # not known yet
        while node >= 0:
            if not evaluations < budget:
                return UNDECIDED, evaluations, 0.0, -1
            evaluations += 1
            is_safe, speed, near_count = _is_safe(
                scene, node, link, row, state, limit, near_count, now
            )
            if not is_safe and partner.row != NO_PARTNER:
                evaluations += 1
                is_safe, speed, near_count = _is_safe(
                    scene, node, link, row, partners_state, limit, near_count, now
                )
            if is_safe:
                greatest = max(greatest, speed)
                node = tree.skip[node]
            elif tree.first_child[node] >= 0:
                node = tree.first_child[node]
            else:
                return TOUCHES, evaluations, 0.0, node
    return RESTS, evaluations, greatest, -1
