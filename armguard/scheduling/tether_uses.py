"""Proofs about tethered obstacles by their partners' states, and the end of these proofs.

A proof about an obstacle b that used a tether to a rests on a state a0 of a, beside what it rests
on anyway. It holds while a's measured states agree with a0. To compare a's newer states with the
state that a's own certificates rest on is not enough. That one, a1, is newer than a0 once a was
evaluated again, and agreement is not transitive: each comparison allows for the errors of both
states, so a2 may agree with a1, a1 with a0, and a2 not with a0. So each proof has a copy of a0, its
*use* of the tether, and all samples of a are compared with that. A sample of b itself is compared
with it as well: it must lie within the tether of a0's motion.

A proof ends, and its obstacle is evaluated anew in that tick, as soon as one of these is not so:

- Each sample of a was compared. Of two between ticks the first one was not.
- a has an accepted state, and no refused one that may be true as well.
- That state agrees with a0, and neither a's radius nor its bounds have grown.
- b's accepted state, where it is new, can be within the tether of what a0 allows for.
- The tether is stated, of the same length, between the same rows, and not broken.

A tether is broken where both obstacles have an accepted state, and nothing else that may be true,
and these are farther apart than its length, both errors, and what one of them can have moved
between both stamps. It is used again once samples of both, no more than `FRESH` apart, have agreed
with it for a while. Both are found at ticks.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from armguard.bounds.free_body import free_displacement, length_above, top_speed
from armguard.contact.gjk import distance_to_hull
from armguard.jit.arrays import FloatArray, IntArray
from armguard.jit.kernels import kernel
from armguard.jit.numerics import ACCEPTANCE_SLACK
from armguard.obstacles.partners import NO_PARTNER, Partner, is_confirmed
from armguard.obstacles.table import Marks, States, copy_state, make_states, resize_states
from armguard.obstacles.tethers import TORN, Tethers

FRESH = 0.1
"""Two samples that are farther apart than this, in [s], do not show that a tether holds."""

USES = 5
"""Proofs of each row that may use a tether: its certificates, and of each of its two proofs of a
stop what was asked, and the certificates by which some links were not."""

CERTIFICATE, ASKED, NOT_ASKED = 0, 1, 3
"""Their places; of the last two kinds those for an arm at any speed, before those for one that
keeps to a speed scale."""


class TetherUses(NamedTuple):
    """Partners' states that proofs rest on, `USES` places for each row."""

    states: States
    """Accepted states as they were used."""
    partner: IntArray
    """Rows of these; NO_PARTNER where no tether was used. Shape (rows × USES,)."""
    length: FloatArray
    """Of the tether, in [m]. Shape (rows × USES,)."""


def make_uses(rows: int, width: int) -> TetherUses:
    """Room for the proofs of so many rows, none of which uses a tether."""
    places = rows * USES
    return TetherUses(
        make_states(places, width), np.full(places, NO_PARTNER, dtype=np.int64), np.zeros(places)
    )


def resize_uses(uses: TetherUses, rows: int, width: int) -> TetherUses:
    """The same with room for more rows, or for states of more points."""
    resized = make_uses(rows, width)
    known = len(uses.partner)
    resized.partner[:known] = uses.partner
    resized.length[:known] = uses.length
    kept = np.flatnonzero(uses.partner != NO_PARTNER)
    return resized._replace(states=resize_states(uses.states, rows * USES, width, kept))


@kernel
def keep_use(uses: TetherUses, bodies: States, row: int, use: int, partner: Partner) -> None:
    """Keep what a proof about a row, made now, rests on beside the row's own state."""
    place = row * USES + use
    uses.partner[place] = partner.row
    if partner.row != NO_PARTNER:
        uses.length[place] = partner.length
        copy_state(bodies, partner.row, uses.states, place)


@kernel
def copy_use(uses: TetherUses, row: int, use: int, copy: int) -> None:
    """Let one proof about a row rest on what another one rests on."""
    place, to = row * USES + use, row * USES + copy
    uses.partner[to] = uses.partner[place]
    if uses.partner[place] != NO_PARTNER:
        uses.length[to] = uses.length[place]
        copy_state(uses.states, place, uses.states, to)


@kernel
def drop_uses(uses: TetherUses, row: int) -> bool:
    """Let no proof about a row use a tether; whether one did."""
    some = False
    for place in range(row * USES, (row + 1) * USES):
        some = some or uses.partner[place] != NO_PARTNER
        uses.partner[place] = NO_PARTNER
    return some


@kernel
def _find_motion(states: States, place: int, duration: float) -> float:
    """How far points of a body get in a time at most, in [m]."""
    pace, error = 0.0, states.velocity_error[place]
    for k in range(states.point_count[place]):
        velocity = states.velocities[place, k]
        pace = max(pace, length_above(velocity[0], velocity[1], velocity[2]))
    top = top_speed(pace, states.speed[place], error)
    motion: float = free_displacement(pace + error, states.accel[place], top, duration)
    return motion


@kernel
def find_excess(states0: States, place0: int, states1: States, place1: int, length: float) -> float:
    """By how much points of body 1 are surely farther from body 0 than a tether allows, in [m].

    With the time h between both stamps: the distance of a point from the hull, less the length,
    both position errors, and what one of the bodies moves within h. At the stamp of either, it is
    where it was measured, and the other one has moved since or is about to; so the lesser way
    counts.

    Args:
        states0: Where body 0's state stands.
        place0: Its place there.
        states1: Where body 1's state stands.
        place1: Its place there.
        length: Of the tether, in [m].

    Returns:
        0 where they agree with the tether, and where body 0 has no state.
    """
    if states0.point_count[place0] == 0:
        return 0.0
    stamp0, stamp1 = states0.stamp[place0], states1.stamp[place1]
    duration = abs(stamp1 - stamp0) + ACCEPTANCE_SLACK * (abs(stamp0) + abs(stamp1))
    motion = 0.0
    if stamp1 != stamp0:
        motion = min(
            _find_motion(states0, place0, duration), _find_motion(states1, place1, duration)
        )
    allowed = length + states0.position_error[place0] + states1.position_error[place1] + motion
    excess = 0.0
    for k in range(states1.point_count[place1]):
        point = states1.points[place1, k]
        distance, _, _, _ = distance_to_hull(
            point[0], point[1], point[2], states0.points[place0], states0.velocities[place0],
            states0.point_count[place0],
        )  # fmt: skip
        size = abs(point[0]) + abs(point[1]) + abs(point[2]) + distance + allowed
        excess = max(excess, distance - allowed - ACCEPTANCE_SLACK * size)
    return excess


@kernel
def follow_tether(
    tethers: Tethers, number: int, bodies: States, marks: Marks, now: float, mending: float
) -> bool:
    """Find whether a tether agrees with the states of both obstacles, of which one is new.

    Args:
        tethers: Written.
        number: Of the tether.
        bodies: Accepted states.
        marks: What is known of each row.
        now: Time of the tick, in [s].
        mending: For how long states must agree with one that is broken, in [s].

    Returns:
        Whether it has just been broken.
    """
    one, other = tethers.rows[number, 0], tethers.rows[number, 1]
    was_broken = tethers.is_broken[number]
    if not (is_confirmed(marks, one) and is_confirmed(marks, other)):
        tethers.agrees_since[number] = math.inf
        return False
    length = tethers.length[number]
    excess = max(
        find_excess(bodies, one, bodies, other, length),
        find_excess(bodies, other, bodies, one, length),
    )
    if excess > 0.0:
        tethers.excess[number], tethers.agrees_since[number] = excess, math.inf
        tethers.is_broken[number] = True
        tethers.numbers[TORN] += not was_broken
        return not was_broken
    if was_broken and abs(bodies.stamp[one] - bodies.stamp[other]) <= FRESH:
        since = min(tethers.agrees_since[number], now)
        tethers.agrees_since[number] = since
        if now - since >= mending:
            tethers.is_broken[number] = False
            tethers.numbers[TORN] -= 1
    return False
